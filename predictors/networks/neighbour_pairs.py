"""Pairs of neighbours over all 20 steps, to read a style from scenes of any number of agents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import Truth
from motion_gym.predictors.networks.ego_features import direction, known_neighbours

NEAREST = 4
"""Largest number of neighbours per agent: those with the smallest distance at any step."""


@dataclass(frozen=True)
class NeighbourPairs:
    """Pairs of an agent and one of its neighbours, independent of the order of agents.

    Attributes:
        agent: [P] int64, index of the agent, ascending.
        other: [P] int64, index of the neighbour.
        heading: [P, 2] float32, direction from the first to the last observed position of the agent.
        scene: [P] int64, the scene of both.
    """

    agent: np.ndarray
    other: np.ndarray
    heading: np.ndarray
    scene: np.ndarray

    @classmethod
    def of(cls, truth: Truth) -> NeighbourPairs:
        """The nearest neighbours of each agent, among the agents that are known over all 20 steps."""
        path, other, present = known_neighbours(truth)
        x, y = np.ascontiguousarray(path[..., 0]), np.ascontiguousarray(path[..., 1])
        nearest = np.full(other.shape, np.inf)
        for column in range(other.shape[1]):  # one column at a time, because the paths of all pairs can be large
            dx, dy = x[other[:, column]] - x, y[other[:, column]] - y
            nearest[:, column] = np.where(present[:, column], (dx * dx + dy * dy).min(axis=1), np.inf)
        kept = np.argsort(nearest, axis=1, kind="stable")[:, :NEAREST]
        agent, slot = np.nonzero(np.take_along_axis(present, kept, axis=1))
        course = truth.observation.xy[agent, -1] - truth.observation.xy[agent, 0]
        heading = direction(course).astype(np.float32)
        return cls(agent, other[agent, kept[agent, slot]], heading, truth.observation.scene_index[agent])

    def paths(self, path: Tensor) -> Tensor:
        """Positions of the neighbours relative to the agents, along the agent's heading and to its left.

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
