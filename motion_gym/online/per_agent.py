"""A predictor with a copy for each agent, which learns from the scenes of its agent."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from motion_gym.contract import Forecast, Observation, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ask, guarded, tell

COUNTS = ("updates", "rolled_back")
"""Counts that adapters keep, here summed over all copies."""


class PerAgent:
    """A copy of a predictor for each agent, which learns from the scenes of its agent, other agents included.

    A copy is made at the first observation of its agent, and dropped at the first observation without its agent.

    Args:
        of: The predictor, as it is at the start of a stream.
    """

    def __init__(self, of: Any):
        self.base = of
        self._begin()

    def _begin(self) -> None:
        self.own: dict[int, Any] = {}
        for count in COUNTS:
            if hasattr(self.base, count):
                setattr(self, count, 0)

    def __getattr__(self, name: str) -> Any:
        # Attributes of the predictor, as its name, but none that copying and pickling read before there is a base.
        if name.startswith("__") or name in ("base", "own", "tune", *COUNTS):
            raise AttributeError(name)
        return getattr(self.base, name)

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast each agent by its own copy, which observes the whole scene."""
        positions = ask(self.base, observation, samples, seed).positions
        for agent in np.intersect1d(observation.agent, list(self.own)).tolist():
            rows = observation.agent == agent
            positions[rows] = ask(self.own[agent], observation, samples, seed).positions[rows]
        return Forecast(positions)

    def observe(self, truth: Truth) -> None:
        """Let the copy of each agent observe the scenes of the agent."""
        seen = truth.observation
        present = np.unique(seen.agent).tolist()
        for agent in present:
            if agent not in self.own:
                self.own[agent] = copy.deepcopy(self.base)
            learner = self.own[agent]
            before = {count: getattr(learner, count, 0) for count in COUNTS}
            tell(learner, pick_scenes(truth, np.unique(seen.scene_index[seen.agent == agent])))
            for count in COUNTS:
                if hasattr(self, count):
                    setattr(self, count, getattr(self, count) + getattr(learner, count, 0) - before[count])
        self.own = {agent: self.own[agent] for agent in present}

    def reset(self) -> None:
        """Drop all copies."""
        self._begin()
        if hasattr(self.base, "reset"):
            guarded(self.base, "reset")
