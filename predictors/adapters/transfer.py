"""Low-shot transfer: a trained modular predictor is tuned to a new style on a few scenes of it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from motion_gym import catalog
from motion_gym.contract import PredictorError, Truth
from motion_gym.data.windows import check_truth, digest
from motion_gym.predictors.adapters.around import Around
from motion_gym.predictors.adapters.refine import REFINABLE
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.settings import number, one_of, optional, positive, setting, whole
from motion_gym.predictors.training.style_training import mean_code
from motion_gym.predictors.training.transfer_training import BATCH, PARTS, TransferProgram
from motion_gym.stepping.harness import name_of
from motion_gym.training import loop as training
from motion_gym.training.program import Weights

SCHEDULES: Mapping[str, tuple[int, float]] = {
    "all": (100, 1e-4),
    "style": (100, 1e-4),
    "modulator": (100, 1e-3),
    "last_layer": (100, 1e-3),
}
"""Epochs and rate by what is tuned, chosen on a style that was left out of training (`motion-gym run transfer`)."""
PUBLISHED = (300, 1e-3)
"""Epochs and rate of the released program, which takes the epoch that is best on validation scenes of the target."""
KEPT = 8
"""Sets of tuned weights that are kept: all seeds are tuned together, and asked for one after the other."""

_kept: dict[str, Weights] = {}


@dataclass(eq=False, repr=False, kw_only=True)
class Transfer(Around):
    """A predictor around a modular one, that is tuned on a few scenes of a new style (the paper's section 4.2).

    ``tune`` begins with the trained weights each time. Until it is called, forecasts are those of the predictor that it
    begins with.

    Args:
        of: See ``Around``; a modular predictor.
        weights: See ``Around``.
        seed: See ``Around``.
        parts: What is tuned: ``all``; ``style``, all but the scene encoder (psi, f and g of the paper); ``modulator``,
            f alone; ``last_layer``, that of the decoder.
        epochs: Passes over the scenes; by default ``SCHEDULES``, or ``PUBLISHED`` where validation scenes are given.
        rate: Learning rate of Adam; by default as ``epochs``.
        style_weight: Factor of the style loss, which sets the new style apart from those of training.

    Raises:
        SpecError: an argument is not known or not allowed.
        PredictorError: the predictor is not modular.
    """

    parts: str = setting("modulator", one_of(PARTS))
    epochs: int | None = setting(None, optional(whole(1, 10**6)))
    rate: float | None = setting(None, optional(positive))
    style_weight: float = setting(0.05, number)
    kind: ClassVar[str] = "transfer"

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        super().__post_init__(of, weights, seed)
        if not isinstance(self.inner, Modular):
            raise PredictorError(f"{name_of(self.inner)} cannot be tuned to a style: use modular or modular_invariant.")
        self.how = ""
        self.begin: tuple[Weights, dict[str, Any]] | None = None

    @property
    def selection(self) -> str:
        """How the weights were selected, and tuned."""
        return super().selection + self.how

    def schedule(self, published: bool = False) -> tuple[int, float]:
        """Epochs and rate: those that were asked for, else those of ``SCHEDULES``, or the published ones."""
        epochs, rate = PUBLISHED if published else SCHEDULES[self.parts]
        return self.epochs or epochs, self.rate or rate

    def tune(self, scenes: Truth, validation: Truth | None = None) -> None:
        """Tune the weights, of all seeds at once.

        Args:
            scenes: Complete scenes of the new style, a multiple of 64; of two agents.
            validation: Further scenes of it to take the best epoch by, as the released program does: that looks at
                3,000 scenes to select what was tuned on a few. Else the last epoch is taken.

        Raises:
            DataError: it is no proper Truth.
            PredictorError: there are no weights; the scenes are no multiple of 64, not complete, not of two agents, or
                of another length of step; or the style loss needs to know the domains that the weights were trained on.
        """
        count = check_truth(scenes, "The scenes to tune on").observation.scenes
        if not count or count % BATCH:
            raise PredictorError(
                f"{self.name} is tuned on batches of {BATCH} scenes, and was given {count} scenes: give "
                f"{max(count // BATCH, 1) * BATCH}."
            )
        if self.begin is None:
            self.inner.fingerprint  # noqa: B018  # loads the weights, or says that there are none
            self.begin = self.inner.stacked, self.inner.card
        weights, card = self.begin
        truths = [scenes] if validation is None else [scenes, check_truth(validation, "The validation scenes")]
        for truth in truths:
            self.inner._ready(truth.observation)
            if not truth.known.all():
                raise PredictorError(f"{self.name} is tuned on scenes all of whose 20 steps are known: give such.")
        trained_on = card.get("trained_on", ())
        # The style loss depends on nothing that is tuned where these parts stay as they are.
        style_weight = self.style_weight if {"style", "head"} & set(PARTS[self.parts]) else 0.0
        if style_weight and not trained_on:
            raise PredictorError(
                "The style loss compares the new style with those of training, and the weights of "
                f"{self.inner.name} do not name the domains that they were trained on: set style_weight=0."
            )
        epochs, rate = self.schedule(published=validation is not None)
        sources = _windows(tuple(trained_on))
        program = TransferProgram(weights, scenes, sources, self.parts, epochs, rate, style_weight, validation)
        tuned = _trained(program, truths, card.get("seeds", list(range(len(weights["prior.dt"])))))
        if validation is not None:
            chosen = "the best epoch on validation scenes of the domain itself"
        elif self.epochs or self.rate:
            chosen = "as long and as fast as is said, the last epoch"
        else:
            chosen = "as long and as fast as is best on a style that was left out of training, the last epoch"
        self.how = f"; then tuned on scenes of the domain: {chosen}"
        self.inner.use(tuned, card)

    def __getattr__(self, name: str) -> Any:
        """The methods that ``Refine`` needs are those of the tuned predictor."""
        if name not in REFINABLE:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return getattr(self.inner, name)


@lru_cache(maxsize=1)
def _windows(specs: tuple[str, ...]) -> list[Truth]:
    return [catalog.domain(spec).windows("train") for spec in specs]


def _trained(program: TransferProgram, data: Sequence[Truth], seeds: Sequence[int]) -> Weights:
    digests = [digest(truth)["sha256"] for truth in data]
    stages = [(stage.epochs, stage.rates) for stage in program.stages]
    key = hashlib.sha256(repr((digests, stages, program.config, seeds)).encode())
    for name, value in sorted(program.begin.items()):
        key.update(name.encode() + value.numpy().tobytes())
    name = key.hexdigest()
    if name not in _kept:
        trained = training.train(program, seeds).weights
        if program.sources:
            trained["prior.code"] = mean_code([program.pairs, *program.sources], trained)
        _kept[name] = trained
        for old in list(_kept)[:-KEPT]:
            del _kept[old]
    return _kept[name]
