"""Pairs of neighbours over all 20 steps, which a style is read from in scenes of any number of agents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import Truth
from motion_gym.predictors.networks.ego_features import neighbours

NEAREST = 4
"""Most neighbours of an agent that count: those who come nearest to it."""
LEAST = 1e-6


@dataclass(frozen=True)
class NeighbourPairs:
    """Who is whose neighbour. Each pair is there twice, once from each side: the order of agents is of no account.

    Attributes:
        agent: [P] int64, from whom it is seen, rising.
        other: [P] int64, the neighbour.
        heading: [P, 2] float32, direction in which the agent went over the observed steps.
        scene: [P] int64, the scene of both.
    """

    agent: np.ndarray
    other: np.ndarray
    heading: np.ndarray
    scene: np.ndarray

    @classmethod
    def of(cls, truth: Truth) -> NeighbourPairs:
        """The nearest neighbours of each agent; those who are not known over all 20 steps are none, and have none."""
        path = np.concatenate([truth.observation.xy, truth.future], axis=1).astype(np.float64)
        x, y = np.ascontiguousarray(path[..., 0]), np.ascontiguousarray(path[..., 1])
        other, there = neighbours(truth.observation.scene)
        whole = np.asarray(truth.known.all(axis=1))
        there = np.logical_and(there, whole[:, None] & whole[other])
        nearest = np.full(other.shape, np.inf)
        for column in range(other.shape[1]):  # one at a time, as the paths of all pairs together can be large
            dx, dy = x[other[:, column]] - x, y[other[:, column]] - y
            nearest[:, column] = np.where(there[:, column], (dx * dx + dy * dy).min(axis=1), np.inf)
        kept = np.argsort(nearest, axis=1, kind="stable")[:, :NEAREST]
        agent, slot = np.nonzero(np.take_along_axis(there, kept, axis=1))
        way = truth.observation.xy[agent, -1] - truth.observation.xy[agent, 0]
        length = np.linalg.norm(way, axis=-1, keepdims=True)
        heading = np.where(length > LEAST, way / np.maximum(length, LEAST), [1.0, 0.0]).astype(np.float32)
        return cls(agent, other[agent, kept[agent, slot]], heading, truth.observation.scene_index[agent])

    def paths(self, path: Tensor) -> Tensor:
        """Where the neighbours are, seen from the agents, along the agents' way and to its left.

        Args:
            path: [A, 20, 2] positions, metres.

        Returns:
            [P, 40], metres.
        """
        off = path[torch.from_numpy(self.other)] - path[torch.from_numpy(self.agent)]
        along, left = torch.from_numpy(self.heading).to(path)[:, None].unbind(dim=-1)
        x, y = off.unbind(dim=-1)
        return torch.stack([x * along + y * left, y * along - x * left], dim=-1).flatten(1)


def whole_paths(truth: Truth) -> Tensor:
    """Positions [A, 20, 2] float32, metres."""
    return torch.from_numpy(np.concatenate([truth.observation.xy, truth.future], axis=1).astype(np.float32))
