"""Inputs of the ego-frame predictors: each agent with its neighbours, relative to the agent's course.

The *undisturbed course* of an agent is a straight line at the mean velocity of its first 4 observed steps. All inputs
are relative to this line, so they do not depend on the origin or the direction of the axes. A pair of agents is
mirrored if necessary, so that the neighbour always passes on the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from motion_gym.contract import FUTURE, HISTORY, WINDOW, Observation, Truth

FREE = 4
"""Number of observed steps that define the undisturbed course."""
NEIGHBOURS = 8
"""Largest number of neighbours per agent: those with the closest approach on undisturbed courses."""
LEAST = 1e-6

BEFORE, DURING = 7, 22
"""Values of a pair on undisturbed courses, and at the last observed steps."""


@dataclass(frozen=True)
class Scenes:
    """Agents with their neighbours, as tensors; leading axes may be model axes.

    Attributes:
        deviation: [..., A, 16] history minus undisturbed course, metres: along the course and to its left, by step.
        before: [..., A, N, 7] each pair on undisturbed courses: speeds, closest approach, its logarithm, its time.
        during: [..., A, N, 22] each pair at the last observed steps.
        miss: [..., A, N] closest approach of the undisturbed courses, metres.
        side: [..., A, N] 1, or -1 if the pair is mirrored, or 0 if present is no neighbour.
    """

    deviation: Tensor
    before: Tensor
    during: Tensor
    miss: Tensor
    side: Tensor

    def take(self, index: Tensor | slice) -> Scenes:
        """A subset of the agents; A must be the first axis."""
        return Scenes(*(value[index] for value in vars(self).values()))

    @classmethod
    def join(cls, parts: list[Scenes]) -> Scenes:
        """Concatenate the agents [A, ...] of several sets, padded to the largest number of neighbours."""
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
    """Transformation between offsets from undisturbed courses and world positions.

    Attributes:
        line: [A, 12, 2] float64, the undisturbed course at the future steps, metres, world frame.
        heading: [A, 2] float64, direction of the course.
    """

    line: np.ndarray
    heading: np.ndarray

    def into(self, positions: np.ndarray) -> np.ndarray:
        """World positions [A, 12, 2] as offsets [A, 24] from the course, along it and to its left."""
        return _components(positions - self.line, self.heading[:, None]).reshape(len(self.line), -1)

    def out_of(self, offsets: np.ndarray) -> np.ndarray:
        """Offsets [A, 24] as world positions [A, 12, 2]."""
        along, left = np.moveaxis(offsets.reshape(-1, FUTURE, 2), -1, 0)[..., None]
        ahead = self.heading[:, None]
        return self.line + along * ahead + left * np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)


def scenes_of(observation: Observation) -> tuple[Scenes, Frame]:
    """Inputs of the networks, and the transformation of their outputs to the world frame."""
    path, dt = observation.xy.astype(np.float64), observation.dt
    at, velocity = _course(path, dt)
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    heading = direction(velocity)
    line = at[:, None] + velocity[:, None] * dt * (np.arange(WINDOW) - (FREE - 1))[:, None]
    deviation = _components(path - line[:, :HISTORY], heading[:, None])
    other, present = neighbours(observation.scene)
    side, miss, when = _approach(at[other] - at[:, None], velocity[other] - velocity[:, None], (WINDOW - FREE) * dt)
    if other.shape[1] > NEIGHBOURS:
        nearest = np.argsort(np.where(present, miss, np.inf), axis=1, kind="stable")[:, :NEIGHBOURS]
        other, present, side, miss, when = (
            np.take_along_axis(array, nearest, axis=1) for array in (other, present, side, miss, when)
        )
    ahead, mirror = heading[:, None], np.stack([np.ones_like(side), side], axis=-1)
    apart = np.linalg.norm(velocity[other] - velocity[:, None], axis=-1)
    own = np.broadcast_to(speed[:, None], (*other.shape, 1))
    theirs = _components(velocity[other], ahead) * mirror
    before = np.concatenate([own, theirs, np.stack([miss, np.log(miss + 0.01), when, apart], axis=-1)], axis=-1)

    moving = np.diff(path, axis=1)[:, FREE - 1 :] / dt - velocity[:, None]
    mine = _components(moving, heading[:, None])[:, None] * mirror[:, :, None]
    others = _components(moving[other], ahead[:, :, None]) * mirror[:, :, None]
    last = np.diff(path[:, -2:], axis=1)[:, 0] / dt
    toward, relative = path[other, -1] - path[:, None, -1], last[other] - last[:, None]
    _, nearer, then = _approach(toward, relative, FUTURE * dt)
    now = np.stack([nearer, then, np.linalg.norm(relative, axis=-1), np.linalg.norm(toward, axis=-1)], axis=-1)
    parts = [
        mine.reshape(*other.shape, -1),
        others.reshape(*other.shape, -1),
        _components(toward, ahead) * mirror,
        now,
    ]
    arrays = (deviation.reshape(len(path), -1), before, np.concatenate(parts, axis=-1), miss, side * present)
    scenes = Scenes(*(torch.tensor(np.ascontiguousarray(array), dtype=torch.float32) for array in arrays))
    return scenes, Frame(line[:, HISTORY:], heading)


def kept_distances(truth: Truth) -> np.ndarray:
    """Evidence of each scene on the distance that agents keep: [S, 2], a weight and the weight times metres.

    A pair keeps a distance if its closest approach is larger than on its undisturbed courses. The evidence is the
    closest approach, with straight motion between steps; its weight grows with the difference. Pairs that are not known
    over all 20 steps have no weight.
    """
    observation = truth.observation
    path, other, present = known_neighbours(truth)
    relative = path[other] - path[:, None]
    steps = np.diff(relative, axis=2)
    kept = _approach(relative[:, :, :-1], steps, 1.0)[1].min(axis=-1)
    at, velocity = _course(path, observation.dt)
    limit = (WINDOW - FREE) * observation.dt
    undisturbed = _approach(at[other] - at[:, None], velocity[other] - velocity[:, None], limit)[1]
    weight = present * np.clip(1 - undisturbed / (kept + LEAST), 0, 1) ** 2 / 2  # each pair occurs twice
    sums = [np.bincount(observation.scene_index, a.sum(axis=1), observation.scenes) for a in (weight, weight * kept)]
    return np.stack(sums, axis=-1)


def _course(path: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Position at the last step that defines the course, and mean velocity up to it, of paths [A, T, 2]."""
    return path[:, FREE - 1], (path[:, FREE - 1] - path[:, 0]) / ((FREE - 1) * dt)


def _approach(position: np.ndarray, velocity: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closest approach of a neighbour at a relative position and velocity, within ``limit`` seconds.

    Returns:
        Side on which the neighbour passes (1 right, -1 left), distance in metres, and time in seconds.
    """
    time = np.clip(-(position * velocity).sum(axis=-1) / ((velocity**2).sum(axis=-1) + LEAST), 0, limit)
    distance = np.linalg.norm(position + velocity * time[..., None], axis=-1)
    turning = velocity[..., 0] * position[..., 1] - velocity[..., 1] * position[..., 0]
    return np.where(turning >= 0, 1.0, -1.0), distance, time


def _components(vectors: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Components of vectors along a heading and to its left."""
    left = vectors[..., 1] * heading[..., 0] - vectors[..., 0] * heading[..., 1]
    return np.stack([(vectors * heading).sum(axis=-1), left], axis=-1)


def known_neighbours(truth: Truth) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Paths [A, 20, 2] float64, and the ``neighbours``, of which only pairs that are known over all 20 steps count."""
    path = np.concatenate([truth.observation.xy, truth.future], axis=1).astype(np.float64)
    other, present = neighbours(truth.observation.scene)
    known = np.asarray(truth.known.all(axis=1))
    return path, other, np.logical_and(present, known[:, None] & known[other])


def direction(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors along vectors [A, 2]; the x axis for vectors of length zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > LEAST, vectors / np.maximum(length, LEAST), [1.0, 0.0])


def neighbours(scene: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The other agents of each agent's scene, padded to the largest scene: [A, N] index, and [A, N] bool mask."""
    sizes = np.diff(scene)
    first, size = np.repeat(scene[:-1], sizes), np.repeat(sizes, sizes)
    agents = np.arange(len(first))
    slot = np.arange(max(int(sizes.max(initial=1)) - 1, 1))
    other = slot + (slot >= (agents - first)[:, None])
    present = other < size[:, None]
    return np.where(present, first[:, None] + other, agents[:, None]), present
