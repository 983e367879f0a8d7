"""Extended Kalman filter on a few weights of a network, with averaged weights and an outlier gate."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, SpecError, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.adapters.adapter import KEPT, Adapter, SceneKey, scene_key
from motion_gym.predictors.networks.last_layer import tunable
from motion_gym.predictors.settings import any_text, positive, setting, whole
from motion_gym.specs import number

MOST_WEIGHTS = 4096
"""Largest number of filtered weights: the covariance holds its square."""
STEPS = (2, 5, 8, 11)
"""Future steps, from 0, whose positions are the measurements."""


@dataclass(eq=False, repr=False, kw_only=True)
class Ekf(Adapter):
    """An extended Kalman filter whose state is the chosen weights and whose measurements are true positions.

    The state model is a constant with drift. Each scene is a measurement through the network, linearised at the current
    weights. Forecasts use an exponential moving average of the weights. Scenes with an implausibly large innovation are
    skipped. After Abuduweili and Liu, "Robust online model adaptation by extended Kalman filter with exponential moving
    average and dynamic multi-epoch strategy" (L4DC 2020).

    Args:
        of: See ``Around``; a predictor of the STGAT or modular family.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        parts: Weights to filter: ``modulator`` (f), ``last_layer``, or another part of at most 4096 weights.
        spread: Initial standard deviation of the weights around the trained ones; above 0.
        drift: Standard deviation of the drift of the weights between scenes; 0 or more.
        noise: Standard deviation of a measured coordinate, metres; above 0.
        average: Decay of the moving average per update, from 0 to below 1.
        gate: Skip a scene if the root mean square of its innovation, in standard deviations, is above this.
        agents: Largest number of measured agents per scene; those with the most known steps come first.
        every: Number of new scenes before the next update, which uses one of the last ones.
        least: Use a scene only if at least one agent has this many known future steps, 3 to 12.

    Raises:
        SpecError: a setting is unknown or not allowed, or there are too many weights.
        PredictorError: the predictor cannot be tuned, or lacks the part.
    """

    parts: str = setting("last_layer", any_text)
    spread: float = setting(0.03, positive)
    drift: float = setting(1e-4, number)
    noise: float = setting(0.1, positive)
    average: float = setting(0.5, partial(number, most=1, below=True))
    gate: float = setting(5.0, positive)
    agents: int = setting(4, whole(1, 1000))
    every: int = setting(1, whole(1, 10**6))
    least: int = setting(FUTURE, whole(STEPS[0] + 1, FUTURE))
    kind: ClassVar[str] = "ekf"

    def _prepare(self) -> None:
        super()._prepare()
        self.tuned = tunable(self.inner, self.parts)
        size = sum(self.inner.tensors[name].numel() for name in self.tuned)
        if size > MOST_WEIGHTS:
            raise SpecError(
                f"`parts={self.parts}` of {self.inner.name} are {size} weights, and the covariance of more than "
                f"{MOST_WEIGHTS} is too large to keep: choose a smaller part of {', '.join(self.inner.parts)}."
            )

    def _start(self) -> None:
        super()._start()
        self.state = self.covariance = torch.zeros(0)
        """[n] filtered weights and [n, n] their covariance; empty before the first update."""
        self.outliers = 0
        """Number of scenes that the gate rejected."""
        self.measured: deque[SceneKey] = deque(maxlen=KEPT)
        """Keys of the last measured scenes: each scene is measured once."""
        self.waiting = 0
        """Number of new scenes since the last update."""

    def learn(self, truth: Truth) -> None:
        """Update the filter with the scene that has the most known agents, if there are enough new scenes."""
        known_agents = np.bincount(truth.observation.scene_index, truth.known.sum(axis=1) >= self.least)
        scenes = {scene_key(truth, scene): scene for scene in np.flatnonzero(known_agents).tolist()}
        new = {key: scene for key, scene in scenes.items() if key not in self.measured}
        self.waiting += len(new)
        if self.waiting >= self.every and new:
            best = max(new.values(), key=lambda scene: known_agents[scene])
            self._update(pick_scenes(truth, [best]))
            self.waiting = 0
        self.measured.extend(new)

    def _update(self, scene: Truth) -> None:
        if not len(self.state):
            self.state = torch.cat([self.inner.tensors[name].flatten() for name in self.tuned])
            self.covariance = torch.eye(len(self.state)) * self.spread**2
        slope, innovation = self._linearised(scene)
        across = self.covariance @ slope.T + self.drift**2 * slope.T
        total = slope @ across + self.noise**2 * torch.eye(len(innovation))
        root, failed = torch.linalg.cholesky_ex(total)
        if failed or not bool(torch.isfinite(total).all() and torch.isfinite(innovation).all()):
            self.updates, self.rolled_back = self.updates + 1, self.rolled_back + 1
            return
        whitened = torch.linalg.solve_triangular(root, innovation[:, None], upper=False)[:, 0]
        if float(whitened @ whitened) > self.gate**2 * len(innovation):
            self.outliers += 1
            return
        self.updates += 1
        gain = torch.linalg.solve_triangular(root, across.T, upper=False).T
        state = self.state + gain @ whitened
        if not bool(torch.isfinite(state).all() and torch.isfinite(gain).all()):
            self.rolled_back += 1
            return
        self.state = state
        self.covariance.diagonal().add_(self.drift**2)
        self.covariance.addmm_(gain, gain.T, alpha=-1)  # in place, because it is large
        before = self.inner.tensors
        averaged = {
            name: torch.lerp(value, before[name], self.average) for name, value in self._as_weights(state).items()
        }
        self.inner.tensors = {**before, **averaged}

    def _linearised(self, scene: Truth) -> tuple[Tensor, Tensor]:
        """Derivatives [m, n] of the measured coordinates by the weights, and the innovation [m], metres.

        The network runs once per coordinate, as m models side by side, so that one backward pass gives all derivatives.
        """
        known = scene.known[:, list(STEPS)]
        chosen = np.argsort(-known.sum(axis=1), kind="stable")[: self.agents]
        row, column = np.nonzero(known[chosen])
        agent, step = (torch.from_numpy(index).repeat_interleave(2) for index in (chosen[row], np.array(STEPS)[column]))
        models = len(agent)
        axis = torch.arange(2).repeat(models // 2)
        free = self._as_weights(self.state)
        weights = {
            name: free.get(name, value).expand(models, *value.shape[1:]).contiguous()
            for name, value in self.inner.tensors.items()
        }
        with torch.enable_grad():
            for name in self.tuned:
                weights[name].requires_grad_()
            offsets = self.inner.offsets(scene.observation, weights)
            predicted = offsets[torch.arange(models), agent, step, axis]
            slopes = torch.autograd.grad(predicted.sum(), [weights[name] for name in self.tuned])
        target = torch.from_numpy(scene.future - scene.observation.xy[:, -1:])[agent, step, axis]
        return torch.cat([slope.flatten(1) for slope in slopes], dim=1), target - predicted.detach()

    def _as_weights(self, state: Tensor) -> dict[str, Tensor]:
        """The tuned weights, by name, of a state [n]."""
        shapes = [self.inner.tensors[name].shape for name in self.tuned]
        flat = state.split([shape.numel() for shape in shapes])
        return {name: part.view(shape) for name, part, shape in zip(self.tuned, flat, shapes, strict=True)}
