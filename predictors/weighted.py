"""Base class of predictors with trained weights: name, weights on disk, and training of several seeds."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from motion_gym import catalog
from motion_gym.contract import Domain, Observation, PredictorError, SpecError, Truth
from motion_gym.data.storage import digest
from motion_gym.predictors.settings import check_settings, name_of_settings, optional, whole
from motion_gym.specs import whole_number
from motion_gym.training import loop as training
from motion_gym.training.loop import Progress, device_named
from motion_gym.training.program import Program, Weights
from motion_gym.training.provenance import commit, sources_of, versions
from motion_gym.training.weight_files import check_shapes, locate, read, read_card, shipped, write

if TYPE_CHECKING:
    from typing_extensions import Self

DT = 0.4
"""Seconds per step of weights whose card does not state it."""
SIZES = ("scenes", "runs", "seconds", "seed")
"""Parameters of simulated domains that say how much is simulated, and from which seed."""
SEED = optional(whole(0, 2**31))


@dataclasses.dataclass(eq=False, repr=False)
class Weighted:
    """A predictor with trained weights of one or several seeds.

    A subclass defines its name (``kind``), its settings as dataclass fields, the shapes of its weights (``expected``),
    and its training program. Each combination of settings is a row of its own in tables and has its own weight file.

    Args:
        weights: Name of shipped weights (``spurious``, ``style``), or a ``.safetensors`` file. By default, ``auto``,
            one of the shipped ``sets`` that was not trained in the world where the predictor is scored.
        seed: Seed of the trained model to use; by default the first.

    Raises:
        SpecError: a setting is not allowed.
        PredictorError: there are no such weights, or they belong to another predictor.
    """

    weights: str | Path | None = None
    seed: int | None = None
    kind: ClassVar[str]
    sets: ClassVar[tuple[str, ...]]
    """Names of shipped weights to choose from, best first; the first one is used where all have seen the world."""
    program: ClassVar[Callable[..., Program]]
    """Class of the training program; takes the predictor, both sets, a device, and the options of ``fit``."""
    fit_on_demand: ClassVar[bool] = False
    """Evaluations do not train the predictor: without weights, ``predict`` raises and says how to train them."""

    def __post_init__(self) -> None:
        self.seed = SEED("seed", self.seed)
        check_settings(self)
        self.weights = None if self.weights == "auto" else self.weights
        self.tensors: Weights | None = None
        """Weights [1, ...] of the seed; None until they are loaded."""
        self.chosen = self.sets[0]
        """Name of the shipped weights to load if no others are given."""
        self.stacked: Weights = {}
        """Weights [M, ...] of all seeds."""
        self.card: dict[str, Any] = {}
        if self.weights is not None:
            self.load(locate(str(self.weights), self.name))

    @property
    def expected(self) -> dict[str, tuple[int, ...]]:
        """Shape of every weight, without the model axis."""
        raise NotImplementedError

    @property
    def name(self) -> str:
        """Spec with the settings that differ from the defaults."""
        return name_of_settings(self)

    @property
    def fitted(self) -> bool:
        """Whether there are weights: loaded, trained, or shipped for these settings."""
        if self.tensors is None:
            try:
                locate(self.chosen, self.name)
            except PredictorError:
                return False
        return True

    @property
    def fingerprint(self) -> str:
        """sha256 of the weights of the seed."""
        return digest(*(part for name, value in sorted(self._ready().items()) for part in (name, value.numpy())))

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Names of the domains whose windows the weights were trained on."""
        self._ready()
        return tuple(self.card.get("trained_on", ()))

    @property
    def selection(self) -> str:
        """How the weights were selected, according to their card."""
        self._ready()
        return str(self.card.get("selection", "not stated by the weights"))

    def choose_weights(self, domains: Sequence[Domain]) -> None:
        """Choose the shipped weights for a score on domains, unless the predictor has weights.

        A predictor must not be scored in a world that it was trained in, unless the world is simulated anew for each
        split. Of the other ``sets``, this takes the one whose training domains are most like the domains: of the same
        name, then with the most equal parameters, then the first. Sets of a simulated domain are taken for that domain
        alone. The first of ``sets`` is taken if there is none, with a warning if all are of other simulated domains.
        """
        if self.tensors is not None:
            return
        worlds = {domain.world for domain in domains if not _is_simulated(domain)}
        alike: dict[str, tuple[bool, int]] = {}
        unlike: dict[str, list[str]] = {}
        for name in self.sets:
            with contextlib.suppress(PredictorError):  # these settings have no such weights
                trained_on = read_card(shipped(name, self.name))["trained_on"]
                sources = [catalog.domain(source) for source in trained_on]
                likeness = max(_likeness(source, domain) for source in sources for domain in domains)
                if any(map(_is_simulated, sources)) and not likeness[0]:
                    unlike[name] = trained_on
                elif worlds.isdisjoint(source.world for source in sources):
                    alike[name] = likeness
        self.chosen = max(alike, key=lambda name: alike[name], default=self.sets[0])
        if self.chosen in unlike:
            warnings.warn(
                f"{self.name} was not trained on data like `{domains[0].card.name}`: its weights `{self.chosen}` were "
                f"trained on {', '.join(unlike[self.chosen])} and may fail here. Train it on such data "
                "(`motion-gym train`), or take a predictor with weights for it.",
                stacklevel=2,
            )

    def fit(
        self,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        seed: int | Sequence[int] = 0,
        *,
        names: Sequence[str] = (),
        device: str = "cpu",
        checkpoint: Path | None = None,
        resume: bool = False,
        every: int = 10,
        report: Callable[[Progress], None] = lambda progress: None,
        **options: Any,
    ) -> Self:
        """Train all seeds in one pass.

        Args:
            train: Windows of each environment.
            validation: Windows for model selection, of the same environments in the same order.
            seed: One seed or several.
            names: Names of the domains of ``train``, for the card.
            device: ``cpu`` or ``cuda``.
            checkpoint: File for checkpoints; None for none.
            resume: Continue from the checkpoint if it exists; the last stage may have more epochs than before.
            every: Epochs between checkpoints.
            report: Called after each epoch.
            **options: Options of ``program``, such as ``epochs``.

        Returns:
            The predictor itself, with the weights of the best epoch of each seed.

        Raises:
            PredictorError: the sets are not suitable for training, or a loss is not finite.
            SpecError: an option is not allowed, the device is missing, or the checkpoint has another configuration.
        """
        seeds = [whole_number("seed", s, 0, 2**31) for s in (seed if isinstance(seed, Iterable) else [seed])]
        if not seeds or len(set(seeds)) < len(seeds):
            raise SpecError(f"`seed={seed}` must name at least one seed to train, and each once.")
        if self.seed is not None and self.seed not in seeds:
            raise SpecError(f"{self.name} uses seed {self.seed}, but the seeds to train are {seeds}: drop `seed`.")
        options = options if "labels" in options else {**self.labels_of(names), **options}
        program = self.program(self, train, validation, device=device_named(device), **options)
        run = training.train(
            program, seeds, device=device, checkpoint=checkpoint, resume=resume, every=every, report=report
        )
        rounded = {name: value.half().float() for name, value in program.finished(run.selected).items()}
        epochs = [stage.epochs for stage in program.stages]
        card = {
            "predictor": self.name,
            "seeds": seeds,
            "dt": train[0].observation.dt,
            "trained_on": list(names),
            "sources": sources_of(train, names, program.config.get("train", ())),
            "selection": "the epoch of the last stage with the lowest ADE on the validation windows of the sources; "
            f"trained for {'/'.join(map(str, epochs))} epochs",
            "validation_ade": [round(score, 4) for score in run.scores_of(rounded)],
            "epoch": run.best_epoch.tolist(),
            "training": {**program.config, "epochs": epochs},
            "seconds": round(run.seconds, 1),
            "device": device,
            "commit": commit(),
            "versions": versions(),
            "precision": "trained in single, kept in half precision",
            "curve": run.curve,
        }
        self.use(rounded, card)
        return self

    def labels_of(self, names: Sequence[str]) -> dict[str, Any]:
        """The option ``labels`` of a program that compares domains by their parameters; the base class has none."""
        return {}

    def _ready(self, observation: Observation | None = None) -> Weights:
        """The weights of the seed; loads the shipped weights if there are no others.

        Raises:
            PredictorError: there are no weights, or the observation has another time step than the training data.
        """
        if self.tensors is None:
            self.load(locate(self.chosen, self.name))
        dt = float(self.card.get("dt", DT))
        if observation is not None and not math.isclose(observation.dt, dt, rel_tol=1e-3):
            raise PredictorError(
                f"{self.name} was trained on time steps of {dt:.3g} s, and the observation has steps of "
                f"{observation.dt:.3g} s: resample the data to {dt:.3g} s (domain `tracks`: "
                f"step={dt:.3g}), or train on such steps."
            )
        return cast(Weights, self.tensors)

    def use(self, tensors: Weights, card: dict[str, Any], source: str = "the weights") -> None:
        """Use weights [M, ...] of M seeds, with their card.

        Raises:
            PredictorError: the weights belong to another predictor or model, are not finite, or lack the seed.
        """
        predictor = card.get("predictor", self.name)
        if predictor != self.name:
            raise PredictorError(f"{source} has the weights of {predictor}, not of {self.name}: name that predictor.")
        check_shapes(tensors, self.expected, source)
        models = len(next(iter(tensors.values())))
        seeds = card.get("seeds", [None] * models)
        if len(seeds) != models or (self.seed is not None and self.seed not in seeds):
            raise PredictorError(f"{source} of {self.name} hold no seed {self.seed}: {seeds} of {models} are there.")
        index = 0 if self.seed is None else seeds.index(self.seed)
        self.stacked, self.card = tensors, card
        self.tensors = {name: value[index : index + 1].contiguous() for name, value in tensors.items()}
        self.reset()

    def reset(self) -> None:
        """Forget all observed scenes. The base class observes none."""

    def save(self, path: str | Path) -> None:
        """Write the weights of all seeds to ``path``, and their card to the same path with the suffix ``.json``.

        Raises:
            PredictorError: there are no weights.
            StorageError: a file could not be written; the existing files are unchanged.
        """
        self._ready()
        write(Path(path), self.stacked, {**self.card, "predictor": self.name})

    def load(self, path: str | Path) -> None:
        """Read weights that ``save`` wrote.

        Raises:
            PredictorError: the file is missing or damaged, or holds the weights of another model.
        """
        self.use(*read(Path(path)), str(path))


def _is_simulated(domain: Domain) -> bool:
    return bool(getattr(type(domain), "draws_each_split", False))


def _likeness(source: Domain, domain: Domain) -> tuple[bool, int]:
    """Whether two domains have one name, and the number of their equal parameters."""
    first, second = source.card, domain.card
    compared = {name: value for name, value in first.parameters.items() if name not in SIZES}
    equal = sum(second.parameters.get(name, first) == value for name, value in compared.items())
    return first.name == second.name, equal if first.name == second.name else 0
