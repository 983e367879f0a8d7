"""A predictor that each agent has a copy of, so that what was learned from one is of no use to others."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from motion_gym.contract import Forecast, Observation, Truth
from motion_gym.harness import ask, guarded, tell
from motion_gym.windows import pick_scenes


class PerAgent:
    """Around a predictor: a copy for each agent, which learns from the scenes that the agent is in.

    A copy is made when there is something to learn from for the first time, and dropped with the last scene that its
    agent is in.

    Args:
        of: The predictor, as it is at the start of a stream.
    """

    def __init__(self, of: Any):
        self.base = of
        self.own: dict[int, Any] = {}

    def __getattr__(self, name: str) -> Any:
        # What the predictor says of itself, as its name; not what copying and pickling look for before there is a base.
        if name.startswith("__") or name in ("base", "own", "know", "tune", "updates"):
            raise AttributeError(name)
        return getattr(self.base, name)

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Each agent's forecast by its own copy, which sees the whole scene."""
        positions = ask(self.base, observation, samples, seed).positions
        for agent in np.intersect1d(observation.agent, list(self.own)).tolist():
            rows = observation.agent == agent
            positions[rows] = ask(self.own[agent], observation, samples, seed).positions[rows]
        return Forecast(positions)

    def observe(self, truth: Truth) -> None:
        """Let the copy of each agent see the scenes that the agent is in."""
        seen = truth.observation
        present = np.unique(seen.agent).tolist()
        for agent in present:
            if agent not in self.own:
                self.own[agent] = copy.deepcopy(self.base)
            tell(self.own[agent], pick_scenes(truth, np.unique(seen.scene_index[seen.agent == agent])))
        self.own = {agent: self.own[agent] for agent in present}

    def reset(self) -> None:
        """Drop all copies."""
        self.own = {}
        if hasattr(self.base, "reset"):
            guarded(self.base, "reset")
