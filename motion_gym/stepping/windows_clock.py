"""The windows clock: each step is the next window, whose ground truth is revealed at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motion_gym.contract import Forecast, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import distance, mean_over_known
from motion_gym.stepping.clocks import Settled, Step, extent_of
from motion_gym.stepping.outstanding import Outstanding


class WindowsClock:
    """Each step is the next window; an agent is one (window, agent) pair and lives for one step.

    Args:
        truth: The windows, as ``domain.windows(split)`` gives them.
    """

    def __init__(self, truth: Truth):
        self.truth = truth
        self.size = len(truth.future)
        self._window = truth.observation.scene_index
        self.reset()

    @property
    def extent(self) -> np.ndarray:
        """[2, 2], lowest and highest x and y."""
        return extent_of(
            np.concatenate([self.truth.observation.xy.reshape(-1, 2), self.truth.future[self.truth.known]])
        )

    def name(self, identity: int) -> str:
        """``window_W_agent_N``."""
        return f"window_{self._window[identity]}_agent_{self.truth.observation.agent[identity]}"

    @property
    def scenes(self) -> int:
        """Number of steps of an episode: one a window."""
        return self.truth.observation.scenes

    @property
    def largest(self) -> float:
        """Largest absolute value of the histories of an episode."""
        return float(np.abs(self.truth.observation.history).max(initial=0.0))

    @property
    def most(self) -> int:
        """Largest number of agents observed at once."""
        return int(np.diff(self.truth.observation.scene).max(initial=0))

    @property
    def time(self) -> int:
        """Number of the current window; after the end, one more than that of the last."""
        return int(self._order[self._at]) if self._at < len(self._order) else self.scenes

    def reset(self, order: Sequence[int] | np.ndarray | None = None) -> Step:
        """Begin with an empty ledger.

        Args:
            order: Numbers of the windows to play; by default all, in the order of time.
        """
        self._order, self._at = np.arange(self.scenes) if order is None else np.asarray(order), 0
        self.ledger = Outstanding(keep=True)
        return self._reveal(np.zeros(0), None)

    def step(self, forecast: Forecast) -> Step:
        """Score the forecasts of this window and go to the next."""
        window, identity = pick_scenes(self.truth, slice(self.time, self.time + 1)), self._identity()
        self.ledger.store(self.time, window.observation, forecast)
        stored, truth = self.ledger.settle(self.time, window.future, window.known)
        error = distance(stored.most_likely().astype(np.float64) - truth.future)
        made = np.full(len(identity), self.time)
        self._at += 1
        reward = -np.nan_to_num(mean_over_known(error, truth.known))
        return self._reveal(reward, Settled(stored, truth, identity, truth.observation.agent, made))

    def _reveal(self, reward: np.ndarray, settled: Settled | None) -> Step:
        observation = pick_scenes(self.truth, slice(self.time, self.time + 1)).observation
        return Step(observation, self._identity(), reward, settled)

    def _identity(self) -> np.ndarray:
        """[A] ids of the agents of the current window."""
        scene = self.truth.observation.scene
        return np.arange(*scene[self.time : self.time + 2]) if self.time < len(scene) - 1 else np.zeros(0, np.int64)
