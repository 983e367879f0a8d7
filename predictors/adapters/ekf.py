"""Extended Kalman filter on a few weights of a network, with averaging and a gate against outliers."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, SpecError, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.adapters.adapter import KEPT, Adapter, SceneKey, scene_key
from motion_gym.predictors.networks.last_layer import tunable
from motion_gym.predictors.settings import any_text, number, positive, setting, whole

MOST_WEIGHTS = 4096
"""Weights that can be filtered: their covariance has as many squared."""
STEPS = (2, 5, 8, 11)
"""Future steps, from 0, whose positions are the measurements."""


@dataclass(eq=False, repr=False, kw_only=True)
class Ekf(Adapter):
    """Takes the chosen weights for the state of an extended Kalman filter, and true positions for its measurements.

    The weights are a constant that drifts; each scene measures them through the network, linearised where they are.
    After Abuduweili and Liu, "Robust online model adaptation by extended Kalman filter with exponential moving average
    and dynamic multi-epoch strategy" (L4DC 2020): forecasts are made by an exponential average of the weights. Scenes
    whose innovation is implausibly large are skipped.

    Args:
        of: See ``Around``; a predictor of the STGAT or modular family.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        parts: The weights: ``modulator`` (f), ``last_layer``, or others of at most 4096 weights.
        spread: Standard deviation of the weights around the trained ones at the start; above 0.
        drift: Standard deviation of the drift of the weights between scenes; 0 or more.
        noise: Standard deviation of a coordinate of a position, metres; above 0.
        average: Share of the old average that an update leaves, from 0 to below 1.
        gate: A scene is skipped if its innovation, in standard deviations, is above this on root mean square.
        agents: Most agents of a scene that are measured, those of which most is known first.
        every: Scenes that must have come before the next update, which uses one of the last ones.
        least: Future steps of which an agent of a scene must be known for the scene to count, 3 to 12.

    Raises:
        SpecError: an argument is not known or not allowed, or there are too many weights.
        PredictorError: the predictor cannot be tuned, or has no such part.
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

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        super().__post_init__(of, weights, seed)
        self.tuned = tunable(self.inner, self.parts)
        size = sum(self.inner.tensors[name].numel() for name in self.tuned)
        if size > MOST_WEIGHTS:
            raise SpecError(
                f"`parts={self.parts}` of {self.inner.name} are {size} weights, and the covariance of more than "
                f"{MOST_WEIGHTS} is too large to keep: choose a smaller one of {', '.join(self.inner.parts)}."
            )

    def _start(self) -> None:
        super()._start()
        self.state = self.covariance = torch.zeros(0)
        """[n] weights of the filter, and [n, n]."""
        self.outliers = 0
        """Scenes that were left out."""
        self.measured: OrderedDict[SceneKey, None] = OrderedDict()
        """The last scenes that were measured, by ``scene_key``: each is measured once."""
        self.waiting = 0
        """Scenes that have come since the last update."""

    def learn(self, truth: Truth) -> None:
        """Update by the scene in which most agents are known, if enough have come."""
        known_agents = np.bincount(truth.observation.scene_index, truth.known.sum(axis=1) >= self.least)
        scenes = {scene_key(truth, scene): scene for scene in np.flatnonzero(known_agents).tolist()}
        new = {key: scene for key, scene in scenes.items() if key not in self.measured}
        self.waiting += len(new)
        if self.waiting >= self.every and new:
            best = max(new.values(), key=lambda scene: known_agents[scene])
            self._update(pick_scenes(truth, [best]))
            self.waiting = 0
        self.measured.update(dict.fromkeys(new))
        while len(self.measured) > KEPT:
            self.measured.popitem(last=False)

    def _update(self, scene: Truth) -> None:
        if not len(self.state):
            self.state = torch.cat([self.inner.tensors[name].flatten() for name in self.tuned])
            self.covariance = torch.eye(len(self.state)) * self.spread**2
        slope, innovation = self._measured(scene)
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
        self.covariance.addmm_(gain, gain.T, alpha=-1)  # in place, as it is large
        filtered = self._split(state)
        begun = self.inner.tensors
        mean = {name: torch.lerp(filtered[name], begun[name], self.average) for name in self.tuned}
        self.inner.tensors = {**begun, **mean}

    def _measured(self, scene: Truth) -> tuple[Tensor, Tensor]:
        """Slope [m, n] of the measured coordinates with respect to the weights, and their innovation [m], metres.

        The network runs once for each coordinate, side by side, so that one backward pass gives all slopes.
        """
        known = scene.known[:, list(STEPS)]
        chosen = np.argsort(-known.sum(axis=1), kind="stable")[: self.agents]
        agent, step = (torch.from_numpy(index) for index in np.nonzero(known[chosen]))
        agent, step = (
            torch.from_numpy(chosen)[agent].repeat_interleave(2),
            torch.tensor(STEPS)[step].repeat_interleave(2),
        )
        axis = torch.arange(2).repeat(len(agent) // 2)
        models = len(agent)
        free = self._split(self.state)
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

    def _split(self, state: Tensor) -> dict[str, Tensor]:
        """The weights of a state."""
        tensors, first = {}, 0
        for name in self.tuned:
            shape = self.inner.tensors[name].shape
            tensors[name] = state[first : first + shape.numel()].view(shape)
            first += shape.numel()
        return tensors
