"""Training plans of the benchmarks: domains, epochs and options."""

from __future__ import annotations

import hashlib
import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.contract import SpecError
from motion_gym.data.domains import TrainingSet, no_sources, spec_of, training_set

PLACES = ("eth", "hotel", "univ", "zara1", "zara2")
WEIGHTS = Path(__file__).parent.parent / "weights"
"""Folder of the weights that come with the package: a folder for each training, a file for each of its rows."""

OTHER_PLACES = tuple(f"{name}/{place}" for name in ("spurious", "original") for place in PLACES)
"""Names of weights that were trained on all places but one: the place in the name, except for ``spurious``, eth."""

SIDES, DISTANCES = ("left", None, "right"), (0.1, 0.3, 0.5)
UNSEEN = (("left", 0.3), ("right", 0.5))
"""Combinations of the side of passing and the distance d that are left out of training: d between those of training
with this side, and beyond them. The mirror images of their scenes, which are as hard to forecast, are in training."""
FACTOR_SOURCES = tuple({"side": s, "d": d} for s in SIDES for d in DISTANCES if (s, d) not in UNSEEN)
FACTOR_EPOCHS = (30, 15, 5, 90)

JOINT: Mapping[str, Any] = {"epochs": (40, 30, 30), "joint": True}
"""Options of ``fit`` of the STGAT family; ``trainings`` says why."""


@dataclass(frozen=True)
class Training:
    """How the predictors of a benchmark are trained.

    Attributes:
        domain: The test domain; predictors are trained on its sources.
        sources: Options of the domain's ``sources``.
        options: Options of ``fit`` for the predictors whose training program takes all of them.
        further: Further options of ``fit``, by the name of a predictor.
    """

    domain: str
    sources: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    further: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def options_of(self, predictor: Any) -> dict[str, Any]:
        """Options of ``fit`` for a predictor."""
        common = self.options if self.options.keys() <= _options_of_program(predictor).keys() else {}
        return {**common, **self.further.get(predictor.name, {})}

    @property
    def unit(self) -> str:
        """Unit of the validation errors."""
        return catalog.domain(self.domain).card.unit

    @property
    def folder(self) -> str:
        """Name of a folder for the weights of a domain of the user's."""
        name = re.sub(r"[^\w.=-]+", "_", self.domain).strip("_.")
        return name if len(name) <= 80 else f"{name[:60]}_{hashlib.sha256(self.domain.encode()).hexdigest()[:12]}"

    def names(self) -> list[str]:
        """Specs of the domains to train on."""
        domain: Any = catalog.domain(self.domain)
        return [spec_of(source) for source in domain.sources(**self.sources)]

    def data(self) -> TrainingSet:
        """Windows to train and to select on, one Truth for each environment."""
        return training_set(catalog.domain(self.domain), **self.sources)


def trainings() -> dict[str, Training]:
    """All trainings, by the name of their weights.

    The released program trains for 150, 100 and 150 epochs (300, 200 and 300 on the original data). These plans have
    fewer, so that all rows can be trained with five seeds each on two cores; ``--epochs`` sets other numbers. Every
    step holds scenes of all environments, for all rows. The plans named ``paper`` are those of the released program:
    its epochs, and each recording an environment, whose steps follow one another (spurious shift) or are joined
    (original data, 16 scenes of each).
    """
    joint = JOINT
    plans = {"spurious": Training("eth:alpha=1", options=joint)}
    plans |= {f"spurious/{place}": Training(f"{place}:alpha=1", options=joint) for place in PLACES[1:]}
    plans["spurious/past"] = Training("eth:alpha=1,sigma=past", options=joint)
    # Every place occurs with every alpha, so an epoch is four times as long.
    crossed = {**joint, "epochs": (10, 8, 10)}
    plans["spurious/crossed"] = Training("eth:alpha=1", {"design": "crossed"}, crossed)
    recordings = {"each": "recording"}
    plans["paper/eth"] = Training("eth:alpha=1", recordings, {"epochs": (150, 100, 150)})
    joined = {"epochs": (300, 200, 300), "joint": True, "scenes": 16 * 7, "until": "shortest"}
    plans["paper/hotel"] = Training("hotel", recordings, joined)
    # Simulated tracks have no noise, and are scored among the same neighbours as in training.
    exact = {"kalman_residual": {"noise": 0.0, "scale": 0.0, "reach": None, "fast": 0.0, "hidden": 0.0}}
    # In simulated crowds the network goes on to learn for long: half an hour on one core, three minutes on a GPU.
    longer = {"kalman_residual": {**exact["kalman_residual"], "epochs": (100,), "agents": 50_000}}
    plans["style"] = Training("orca:d=0.4", further=longer)
    plans["style/held_out"] = Training("orca:d=0.5", {"styles": (0.1, 0.3)})
    plans["style/crowd"] = Training("orca:agents=10,d=0.4,scenes=1000", further={"erm_no_sigma": joint, **longer})
    plans["style/blind"] = Training("orca:d=0.4,radius=7")
    # A third of the scenes and of the epochs of `style`, on more than twice as many domains.
    few = {"epochs": FACTOR_EPOCHS, "scenes": 24, "most": 3000}
    for name, more in (("factors", ""), ("factors/blind", ",radius=7")):
        plans[name] = Training(f"orca:d=0.3{more}", {"styles": FACTOR_SOURCES}, few)
    plans |= {f"original/{place}": Training(place, options=joint) for place in PLACES}
    plans["original/all"] = Training("eth", {"by": "nothing"}, joint)
    plans["vehicles"] = Training("highway:style=brisk", further={"erm_no_sigma": joint, **exact})
    plans["vehicles_spurious"] = Training("highway:style=normal,alpha=1", options=joint)
    # Of each target of low-shot transfer, with label maps of the ground.
    ground = "image=true,background=labels"
    plans["sdd"] = Training(f"sdd:speed=3.25-3.75,{ground}")
    plans["sdd/held_out"] = Training(f"sdd:speed=2.25-2.75,{ground}", {"speeds": ("0.25-0.75", "1.25-1.75")})
    plans["sdd/bikers"] = Training(f"sdd:scene=deathCircle,video=0,class=biker,{ground}")
    plans["sdd/fast_bikers"] = Training(
        f"sdd:scene=deathCircle,class=biker,speed=4-8,{ground}", {"speeds": ("0.5-3.5",)}
    )
    # For streams: weights of other domains than the streamed ones, and oracles of the streamed ones.
    plans["online/places"] = Training("hotel", {"among": ("eth", "zara2")}, joint)
    plans |= {f"online/alpha_{a}": Training("eth:alpha=1", {"alphas": (a,) * 4}, joint) for a in (1, 64)}
    plans["online/traffic_styles"] = Training("highway:style=brisk", {"styles": ("calm", "aggressive")}, further=exact)
    roundabout = {"styles": ("normal",), "scenario": "roundabout"}
    plans["online/roundabout"] = Training("highway:style=brisk", roundabout, further=exact)
    plans["online/orca"] = Training("orca:d=0.4", {"styles": (0.3, 0.6)})
    return plans


def training(name: str) -> Training:
    """The training with this name.

    Raises:
        SpecError: the name is unknown.
    """
    known = trainings()
    if name not in known:
        raise SpecError(
            f"There is no benchmark `{name}` to train for.{catalog.suggest(name, known)} On a domain: --domain {name}."
        )
    return known[name]


def training_for(domain: str, predictor: Any) -> Training:
    """The training on the sources of a domain, with the options that the benchmarks have for the predictor's family.

    Raises:
        SpecError: the domain is unknown, or names no sources.
    """
    plan = Training(domain, options=JOINT if "joint" in _options_of_program(predictor) else {})
    if not plan.names():
        raise no_sources(catalog.domain(domain))
    return plan


def _options_of_program(predictor: Any) -> Mapping[str, Any]:
    program = getattr(predictor, "program", None)
    return inspect.signature(program).parameters if callable(program) else {}
