"""Low-shot transfer: a trained predictor is tuned on a few scenes of a new domain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

from motion_gym import catalog
from motion_gym.contract import PredictorError, Truth
from motion_gym.data import storage
from motion_gym.data.windows import check_truth, digest
from motion_gym.predictors.adapters.around import Around
from motion_gym.predictors.adapters.refine import REFINABLE
from motion_gym.predictors.settings import any_text, optional, positive, setting, whole
from motion_gym.predictors.training.style_training import mean_code
from motion_gym.specs import number, one_of
from motion_gym.stepping.harness import name_of
from motion_gym.training import loop as training
from motion_gym.training.program import Weights

KEPT = 8
"""Number of tuned weight sets to cache: all seeds are tuned together, and requested one after the other."""

_tuned: dict[str, Weights] = {}


@dataclass(eq=False, repr=False, kw_only=True)
class Transfer(Around):
    """Wraps a predictor that is tuned on a few scenes of a new domain (section 4.2 of the paper).

    Predictors name their program in the attribute ``transfer``: ``modular`` and ``modular_invariant`` are tuned on
    batches of 64 scenes of a style, ``heatmap`` on batches of 8 scenes.

    Each call of ``tune`` starts from the trained weights. Before the first call, forecasts are those of the trained
    predictor.

    Args:
        of: See ``Around``; a modular predictor or ``heatmap``.
        weights: See ``Around``.
        seed: See ``Around``.
        parts: Weights to tune: ``all``; ``style``, all but the scene encoder (psi, f and g of the paper);
            ``modulator``, f alone; ``low_rank``, adapters of the encoder; ``last_layer`` of the decoder.
        epochs: Passes over the scenes; by default those of the program for the part, or the published ones with
            validation scenes.
        rate: Learning rate of Adam; the default is that of ``epochs``.
        style_weight: Factor of the style loss, which separates the new style from the training styles.

    Raises:
        SpecError: a setting is unknown or not allowed.
        PredictorError: the predictor cannot be tuned.
    """

    parts: str = setting("modulator", any_text)
    epochs: int | None = setting(None, optional(whole(1, 10**6)))
    rate: float | None = setting(None, optional(positive))
    style_weight: float = setting(0.05, number)
    kind: ClassVar[str] = "transfer"

    def _prepare(self) -> None:
        if not hasattr(type(self.inner), "transfer"):
            raise PredictorError(
                f"{name_of(self.inner)} cannot be tuned to a style: use modular, modular_invariant or heatmap."
            )
        self.program: Any = type(self.inner).transfer
        """Class of the training program, see ``TransferProgram``."""
        one_of("parts", self.parts, self.program.tunable, f"transfer of {name_of(self.inner)}")
        self.tuning = ""
        """Sentence on how the weights were tuned; empty before."""
        self.trained: tuple[Weights, dict[str, Any]] | None = None
        """The trained weights of all seeds and their card; None before the first tuning."""

    @property
    def selection(self) -> str:
        """How the weights were selected and tuned."""
        return super().selection + self.tuning

    def schedule(self, published: bool = False) -> tuple[int, float]:
        """Epochs and learning rate; the defaults are those of the program for the part, or the published ones."""
        epochs, rate = self.program.published if published else self.program.schedules[self.parts]
        return self.epochs or epochs, self.rate or rate

    def tune(self, scenes: Truth, validation: Truth | None = None) -> None:
        """Tune the weights of all seeds at once.

        Args:
            scenes: Complete scenes of the new domain; whole batches of the program.
            validation: Further scenes of the new domain. If given, the epoch with the lowest error on them is selected,
                as in the released program, which uses 3,000 such scenes. Otherwise the last epoch is used.

        Raises:
            DataError: a set is not a valid Truth.
            PredictorError: there are no weights; the scenes are not whole batches, not complete, of the wrong number of
                agents, or of another time step; or the style loss needs the training domains, and the weights do not
                name them.
        """
        count = check_truth(scenes, "The scenes to tune on").observation.scenes
        batch = self.program.scenes_per_batch
        if not count or count % batch:
            raise PredictorError(
                f"{self.name} is tuned on batches of {batch} scenes, and was given {count} scenes: give "
                f"{max(count // batch, 1) * batch}."
            )
        if self.trained is None:
            self.inner.fingerprint  # noqa: B018  # loads the weights, or raises if there are none
            self.trained = self.inner.stacked, self.inner.card
        weights, card = self.trained
        truths = [scenes] if validation is None else [scenes, check_truth(validation, "The validation scenes")]
        for truth in truths:
            self.inner._ready(truth.observation)
            if not truth.known.all():
                raise PredictorError(f"{self.name} is tuned on scenes whose 20 steps are all known: give such scenes.")
        trained_on = tuple(card.get("trained_on", ()))
        # The style loss does not depend on the modulator or the decoder.
        style_weight = self.style_weight if {"style", "head"} & set(self.program.tunable[self.parts]) else 0.0
        if style_weight and not trained_on:
            raise PredictorError(
                "The style loss compares the new style with the training styles, but the weights of "
                f"{self.inner.name} do not name the domains that they were trained on: set style_weight=0."
            )
        epochs, rate = self.schedule(published=validation is not None)
        sources = _windows(trained_on) if self.program.reads_style else []
        program = self.program(weights, scenes, sources, self.parts, epochs, rate, style_weight, validation)
        models = len(next(iter(weights.values())))
        tuned = _train(program, truths, card.get("seeds", list(range(models))))
        if validation is not None:
            chosen = "the best epoch on validation scenes of the domain itself"
        elif self.epochs or self.rate:
            chosen = "as long and as fast as is said, the last epoch"
        else:
            left_out = f"a {self.program.chosen_on} that was left out of training"
            chosen = f"as long and as fast as is best on {left_out}, the last epoch"
        self.tuning = f"; then tuned on scenes of the domain: {chosen}"
        self.inner.use(tuned, card)

    @property
    def observe(self) -> Callable[[Truth], None]:  # type: ignore[override]
        """Read the style from scenes whose 20 steps are all known; only where the wrapped predictor reads a style."""
        return self.inner.observe  # type: ignore[no-any-return]

    def __getattr__(self, name: str) -> Any:
        """Forward the methods that ``Refine`` needs to the tuned predictor."""
        if name not in REFINABLE:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return getattr(self.inner, name)


@lru_cache(maxsize=1)
def _windows(specs: tuple[str, ...]) -> list[Truth]:
    return [catalog.domain(spec).windows("train") for spec in specs]


def _train(program: Any, data: Sequence[Truth], seeds: Sequence[int]) -> Weights:
    """The tuned weights of all seeds, from the cache if the same tuning was done before."""
    stages = [(stage.epochs, stage.rates) for stage in program.stages]
    settings = repr(([digest(truth)["sha256"] for truth in data], stages, program.config, seeds))
    weights = (part for name, value in sorted(program.begin.items()) for part in (name, value.numpy()))
    key = storage.digest(settings, *weights)
    if key not in _tuned:
        tuned = training.train(program, seeds, device=program.device).selected
        if program.sources:
            tuned["prior.code"] = mean_code([program.pairs, *program.sources], tuned)
        _tuned[key] = tuned
        for old in list(_tuned)[:-KEPT]:
            del _tuned[old]
    return _tuned[key]
