"""Test-time refinement: forecasts are optimised towards the style of the reference scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import Forecast, Observation, PredictorError, Truth
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.predictors.adapters.around import Around
from motion_gym.predictors.networks.pair_network import CODE, to_forecast
from motion_gym.predictors.settings import positive, setting, whole
from motion_gym.predictors.training.style_loss import TEMPERATURE
from motion_gym.stepping.harness import name_of

REFINABLE = ("latent", "from_latent", "embedded", "whole_scenes", "observe", "reset")
"""Methods that a predictor needs for refinement; see ``Modular``."""


@dataclass(eq=False, repr=False, kw_only=True)
class Refine(Around):
    """Refines each forecast of a predictor with a style encoder (section 3.3 of the paper).

    A few steps of Adam on the latent of each scene draw the style embedding of the forecast towards those of the
    reference scenes. The loss is minus the mean scalar product of the two, divided by the temperature of the style
    loss. The weights do not change. Without reference scenes the forecast is not refined.

    Args:
        of: See ``Around``; a predictor with a style encoder.
        weights: See ``Around``.
        seed: See ``Around``.
        steps: Number of steps, 0 or more.
        rate: Learning rate.
        memory: Number of recent, fully known scenes to read the style from; 0 for all observed scenes.

    Raises:
        PredictorError: the predictor has no style encoder.
    """

    steps: int = setting(3, whole(0, 10_000))
    rate: float = setting(1e-3, positive)
    memory: int = setting(0, whole(0, 100_000))
    kind: ClassVar[str] = "refine"

    def _prepare(self) -> None:
        if not all(hasattr(self.inner, method) for method in REFINABLE):
            raise PredictorError(
                f"{name_of(self.inner)} has no style encoder, so its forecasts cannot be refined: use modular or "
                "modular_invariant."
            )
        self._start()

    def _start(self) -> None:
        self.embeddings, self.scenes = np.zeros(CODE), 0
        """Sum [8] of the style embeddings of the reference scenes, and the number of these scenes."""
        self.recent: list[Truth] = []
        """The last scenes; empty if ``memory`` is 0."""

    @property
    def tune(self) -> Callable[..., None]:
        """Tune the predictor and forget all observed scenes; AttributeError without ``tune``. See ``Transfer``."""
        tune = self.inner.tune

        def tune_and_reset(scenes: Truth, validation: Truth | None = None) -> None:
            tune(scenes, validation)
            self.reset()

        return tune_and_reset

    def observe(self, truth: Truth) -> None:
        """Read the style and the style embeddings from scenes whose 20 steps are all known."""
        scenes = self.inner.whole_scenes(truth)
        if scenes is None:
            return
        if self.memory:
            new = [pick_scenes(scenes, [scene]) for scene in range(scenes.observation.scenes)]
            recent = [*self.recent, *new][-self.memory :]
            self.reset()
            self.recent, scenes = recent, stack(recent)
        self.inner.observe(scenes)
        path = np.concatenate([scenes.observation.xy[:, -1:], scenes.future], axis=1)
        moves = torch.tensor(np.diff(path, axis=1), dtype=torch.float64).reshape(1, -1, 24)
        with torch.no_grad():
            embedded = self.inner.embedded(scenes.observation, moves)[0]
        self.embeddings = self.embeddings + embedded.double().sum(dim=0).numpy()
        self.scenes += scenes.observation.scenes

    def reset(self) -> None:
        """Forget all observed scenes."""
        self.inner.reset()
        self._start()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres: the first sample only, refined.

        Raises:
            PredictorError: there are no weights, or the predictor does not take these scenes.
        """
        with torch.no_grad():
            latent = self.inner.latent(observation, seed)
        if self.scenes:
            latent = self._refined(observation, latent.clone(), seed)
        with torch.no_grad():
            moves = self.inner.from_latent(observation, latent, seed)
        return to_forecast(observation, moves)

    def _refined(self, observation: Observation, latent: Tensor, seed: int) -> Tensor:
        goal = torch.tensor(self.embeddings / self.scenes / TEMPERATURE, dtype=torch.float64)
        with torch.enable_grad():
            latent.requires_grad_()
            adam = torch.optim.Adam([latent], lr=self.rate)
            for _ in range(self.steps):
                embedded = self.inner.embedded(observation, self.inner.from_latent(observation, latent, seed))
                (latent.grad,) = torch.autograd.grad(-(embedded.double() @ goal).sum(), [latent])
                adam.step()
        return latent.detach()
