"""What the ego-frame predictors see: each agent with its neighbours, from where it is and along its course.

The *undisturbed course* of an agent is the straight line of its first 4 observed steps, followed at their mean
velocity. Everything is relative to that line: nothing depends on where the origin is or which way the axes point. A
pair of agents is looked at in the mirror where need be, so that the neighbour always passes on the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from motion_gym.contract import FUTURE, HISTORY, WINDOW, Observation, Truth

FREE = 4
"""Observed steps that an undisturbed course is read from."""
NEIGHBOURS = 8
"""Most neighbours of an agent that count: those whose undisturbed courses come nearest to its own."""
LEAST = 1e-6

BEFORE, DURING = 7, 22
"""Values of a pair on undisturbed courses, and as it is at the last observed steps."""


@dataclass(frozen=True)
class Scenes:
    """Agents with their neighbours, as tensors; the leading axes may be those of models.

    Attributes:
        deviation: [..., A, 16] the history minus the undisturbed course, metres: along it and to its left, by step.
        before: [..., A, N, 7] each pair on undisturbed courses: speeds, closest approach, its logarithm, its time.
        during: [..., A, N, 22] each pair at the last observed steps.
        miss: [..., A, N] closest approach of the undisturbed courses, metres.
        side: [..., A, N] 1, or -1 in the mirror, or 0 where there is no neighbour.
    """

    deviation: Tensor
    before: Tensor
    during: Tensor
    miss: Tensor
    side: Tensor

    def take(self, index: Tensor | slice) -> Scenes:
        """Some of the agents, where A is the first axis."""
        return Scenes(*(value[index] for value in vars(self).values()))

    @classmethod
    def join(cls, parts: list[Scenes]) -> Scenes:
        """Agents [A, ...] of several, one after another; where there are fewer neighbours, some are not there."""
        most = max(part.side.shape[1] for part in parts)

        def padded(value: Tensor) -> Tensor:
            return pad(value, [0, 0] * (value.ndim - 2) + [0, most - value.shape[1]])

        names = ("before", "during", "miss", "side")
        joined = {name: torch.cat([padded(getattr(part, name)) for part in parts]) for name in names}
        return cls(deviation=torch.cat([part.deviation for part in parts]), **joined)

    def for_models(self, models: int) -> Scenes:
        """The same agents for each of M models: [A, ...] to [M, A, ...]."""
        return Scenes(*(value.expand(models, *value.shape) for value in vars(self).values()))


@dataclass(frozen=True)
class Frame:
    """Where the forecasts of agents lie in the world.

    Attributes:
        line: [A, 12, 2] float64, the undisturbed course at the future steps, metres, world frame.
        heading: [A, 2] float64, its direction.
    """

    line: np.ndarray
    heading: np.ndarray

    def into(self, positions: np.ndarray) -> np.ndarray:
        """World positions [A, 12, 2] as offsets [A, 24] from the line, along it and to its left."""
        return _turned(positions - self.line, self.heading[:, None]).reshape(len(self.line), -1)

    def out_of(self, offsets: np.ndarray) -> np.ndarray:
        """Offsets [A, 24] as world positions [A, 12, 2]."""
        along, left = np.moveaxis(offsets.reshape(-1, FUTURE, 2), -1, 0)[..., None]
        ahead = self.heading[:, None]
        return self.line + along * ahead + left * np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)


def scenes_of(observation: Observation) -> tuple[Scenes, Frame]:
    """Inputs of the networks, and the transformation back to the world frame."""
    path, dt = observation.xy.astype(np.float64), observation.dt
    at, velocity = _course(path, dt)
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    heading = np.where(speed > LEAST, velocity / np.maximum(speed, LEAST), [1.0, 0.0])
    line = at[:, None] + velocity[:, None] * dt * (np.arange(WINDOW) - (FREE - 1))[:, None]
    deviation = _turned(path - line[:, :HISTORY], heading[:, None])
    other, there = neighbours(observation.scene)
    side, miss, when = _approach(at[other] - at[:, None], velocity[other] - velocity[:, None], (WINDOW - FREE) * dt)
    if other.shape[1] > NEIGHBOURS:
        nearest = np.argsort(np.where(there, miss, np.inf), axis=1, kind="stable")[:, :NEIGHBOURS]
        other, there, side, miss, when = (
            np.take_along_axis(array, nearest, axis=1) for array in (other, there, side, miss, when)
        )
    ahead, mirror = heading[:, None], np.stack([np.ones_like(side), side], axis=-1)
    apart = np.linalg.norm(velocity[other] - velocity[:, None], axis=-1)
    own = np.broadcast_to(speed[:, None], (*other.shape, 1))
    theirs = _turned(velocity[other], ahead) * mirror
    before = np.concatenate([own, theirs, np.stack([miss, np.log(miss + 0.01), when, apart], axis=-1)], axis=-1)

    moving = np.diff(path, axis=1)[:, FREE - 1 :] / dt - velocity[:, None]
    mine = _turned(moving, heading[:, None])[:, None] * mirror[:, :, None]
    others = _turned(moving[other], ahead[:, :, None]) * mirror[:, :, None]
    last = np.diff(path[:, -2:], axis=1)[:, 0] / dt
    off, relative = path[other, -1] - path[:, None, -1], last[other] - last[:, None]
    _, nearer, then = _approach(off, relative, FUTURE * dt)
    now = np.stack([nearer, then, np.linalg.norm(relative, axis=-1), np.linalg.norm(off, axis=-1)], axis=-1)
    parts = [mine.reshape(*other.shape, -1), others.reshape(*other.shape, -1), _turned(off, ahead) * mirror, now]
    arrays = (deviation.reshape(len(path), -1), before, np.concatenate(parts, axis=-1), miss, side * there)
    scenes = Scenes(*(torch.tensor(np.ascontiguousarray(array), dtype=torch.float32) for array in arrays))
    return scenes, Frame(line[:, HISTORY:], heading)


def kept_distances(truth: Truth) -> np.ndarray:
    """What scenes tell about the distance that agents keep: [S, 2], a weight and the weight times metres.

    A pair that would have come nearer on its undisturbed courses than it did has kept a distance: its closest approach
    (walking straight between steps) counts, the more it had to be brought about. Pairs that are not known over all 20
    steps do not count.
    """
    observation = truth.observation
    path = np.concatenate([observation.xy, truth.future], axis=1).astype(np.float64)
    other, there = neighbours(observation.scene)
    whole = np.asarray(truth.known.all(axis=1))
    there = np.logical_and(there, whole[:, None] & whole[other])
    relative = path[other] - path[:, None]
    steps = np.diff(relative, axis=2)
    kept = _approach(relative[:, :, :-1], steps, 1.0)[1].min(axis=-1)
    at, velocity = _course(path, observation.dt)
    limit = (WINDOW - FREE) * observation.dt
    would = _approach(at[other] - at[:, None], velocity[other] - velocity[:, None], limit)[1]
    weight = there * np.clip(1 - would / (kept + LEAST), 0, 1) ** 2 / 2  # every pair is met twice
    sums = [np.bincount(observation.scene_index, a.sum(axis=1), observation.scenes) for a in (weight, weight * kept)]
    return np.stack(sums, axis=-1)


def _course(path: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Position at the last of the free steps, and mean velocity up to it, of paths [A, T, 2]."""
    return path[:, FREE - 1], (path[:, FREE - 1] - path[:, 0]) / ((FREE - 1) * dt)


def _approach(position: np.ndarray, velocity: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closest approach of something at a relative position and velocity, within so many seconds.

    Returns:
        Side on which it passes (1 right, -1 left), distance in metres, and time in seconds.
    """
    time = np.clip(-(position * velocity).sum(axis=-1) / ((velocity**2).sum(axis=-1) + LEAST), 0, limit)
    distance = np.linalg.norm(position + velocity * time[..., None], axis=-1)
    turning = velocity[..., 0] * position[..., 1] - velocity[..., 1] * position[..., 0]
    return np.where(turning >= 0, 1.0, -1.0), distance, time


def _turned(vectors: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Coordinates of vectors along a heading and to its left."""
    left = vectors[..., 1] * heading[..., 0] - vectors[..., 0] * heading[..., 1]
    return np.stack([(vectors * heading).sum(axis=-1), left], axis=-1)


def neighbours(scene: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The others of each agent's scene, padded to the largest scene: [A, N] index, and which are there."""
    sizes = np.diff(scene)
    first, size = np.repeat(scene[:-1], sizes), np.repeat(sizes, sizes)
    agents = np.arange(len(first))
    slot = np.arange(max(int(sizes.max(initial=1)) - 1, 1))
    other = slot + (slot >= (agents - first)[:, None])
    there = other < size[:, None]
    return np.where(there, first[:, None] + other, agents[:, None]), there
