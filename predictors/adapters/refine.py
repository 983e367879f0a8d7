"""Test-time refinement: a forecast is corrected until it looks as if it were of the style of the reference scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import Forecast, Observation, PredictorError, Truth
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.predictors.adapters.around import Around
from motion_gym.predictors.networks.pair_network import CODE, walked
from motion_gym.predictors.settings import positive, setting, whole
from motion_gym.predictors.training.style_loss import TEMPERATURE
from motion_gym.stepping.harness import name_of

REFINABLE = ("latent", "from_latent", "embedded", "whole_scenes", "observe", "reset")
"""Methods that a predictor needs for its forecasts to be refined; see ``Modular``."""


@dataclass(eq=False, repr=False, kw_only=True)
class Refine(Around):
    """A predictor around one with a style encoder, that refines each of its forecasts (the paper's section 3.3).

    The style embedding of a forecast is drawn towards those of the reference scenes by a few steps of Adam on the
    latent of each scene: what is minimised is minus the mean scalar product of the two, over the temperature of the
    style loss. Weights are never touched, and with no reference scenes there is nothing to refine towards.

    Args:
        of: See ``Around``; a predictor with a style encoder.
        weights: See ``Around``.
        seed: See ``Around``.
        steps: Number of steps, 0 or more.
        rate: Learning rate.
        memory: Whole scenes, the last ones, that the style is read from; 0 for all that were observed.

    Raises:
        PredictorError: the predictor has no style encoder.
    """

    steps: int = setting(3, whole(0, 10_000))
    rate: float = setting(1e-3, positive)
    memory: int = setting(0, whole(0, 100_000))
    kind: ClassVar[str] = "refine"

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        super().__post_init__(of, weights, seed)
        if not all(hasattr(self.inner, method) for method in REFINABLE):
            raise PredictorError(
                f"{name_of(self.inner)} has no style encoder, so that there is nothing to refine a "
                "forecast by: use modular or modular_invariant."
            )
        self._forget()

    def _forget(self) -> None:
        self.towards, self.scenes = np.zeros(CODE), 0
        """Sum [8] of the style embeddings that forecasts are refined towards, and the number of their scenes."""
        self.shown: list[Truth] = []
        """The last scenes, where the style is read from these alone."""

    @property
    def tune(self) -> Callable[..., None]:
        """Tune the predictor, and forget what was observed; AttributeError if it cannot be tuned. See ``Transfer``."""
        tune = self.inner.tune

        def tuned(scenes: Truth, validation: Truth | None = None) -> None:
            tune(scenes, validation)
            self.reset()

        return tuned

    def observe(self, truth: Truth) -> None:
        """Read the style, and the embeddings to refine towards, from scenes whose 20 steps are all known."""
        whole = self.inner.whole_scenes(truth)
        if whole is None:
            return
        if self.memory:
            last = [*self.shown, *(pick_scenes(whole, [scene]) for scene in range(whole.observation.scenes))]
            self.reset()
            self.shown = last[-self.memory :]
            whole = stack(self.shown)
        self.inner.observe(whole)
        self.towards = self.towards + self._embedded(whole)
        self.scenes += whole.observation.scenes

    def _embedded(self, whole: Truth) -> np.ndarray:
        """Sum [8] of the style embeddings of whole scenes."""
        path = np.concatenate([whole.observation.xy[:, -1:], whole.future], axis=1)
        moves = torch.tensor(np.diff(path, axis=1), dtype=torch.float64).reshape(1, -1, 24)
        with torch.no_grad():
            return self.inner.embedded(whole.observation, moves)[0].double().sum(dim=0).numpy()

    def reset(self) -> None:
        """Forget all that was observed."""
        self.inner.reset()
        self._forget()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres: the first sample alone, refined.

        Raises:
            PredictorError: there are no weights, or the scenes are not such as the predictor takes.
        """
        with torch.no_grad():
            latent = self.inner.latent(observation, seed)
        if self.scenes:
            latent = self._refined(observation, latent.clone(), seed)
        with torch.no_grad():
            moves = self.inner.from_latent(observation, latent, seed)
        return walked(observation, moves)

    def _refined(self, observation: Observation, latent: Tensor, seed: int) -> Tensor:
        goal = torch.tensor(self.towards / self.scenes / TEMPERATURE, dtype=torch.float64)
        with torch.enable_grad():
            latent.requires_grad_()
            adam = torch.optim.Adam([latent], lr=self.rate)
            for _ in range(self.steps):
                embedded = self.inner.embedded(observation, self.inner.from_latent(observation, latent, seed))
                (latent.grad,) = torch.autograd.grad(-(embedded.double() @ goal).sum(), [latent])
                adam.step()
        return latent.detach()
