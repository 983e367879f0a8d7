"""The interface of clocks, and the windows clock.

A clock has ``reset()`` and ``step(forecast)``, which return a Step; ``time``, the number of the current window or
listed frame; the ``ledger`` of the episode; and the ``extent`` of all positions. Agents have ids 0 .. ``size`` - 1, in
the order in which they enter; an id never returns. ``name(id)`` ends in the number of the agent in the observation. The
windows clock steps from window to window and reveals the ground truth of a window at once. The stream clock steps from
frame to frame and reveals the ground truth of a scene after its last forecast step. Both clocks store a forecast in
their ledger before they reveal anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motion_gym.contract import Forecast, Observation, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import distance, mean_over_known
from motion_gym.stepping.outstanding import Outstanding


@dataclass(frozen=True, eq=False)
class Settled:
    """Scenes whose ground truth was revealed by a step.

    Each forecast is matured, or censored because its agent left.

    Attributes:
        forecast: The stored forecasts of M agents.
        truth: The ground truth, with the observations that were forecast; whole scenes.
        identity: [M] int64, the clock's id of each agent.
        person: [M] int64, the agent as in ``domain.windows``; an agent that is lost and found again has two ids and is
            one person.
        made: [M] int64, clock time of each forecast.
    """

    forecast: Forecast
    truth: Truth
    identity: np.ndarray
    person: np.ndarray
    made: np.ndarray

    @property
    def matured(self) -> np.ndarray:
        """[M] bool, True where all 12 steps happened."""
        return np.all(self.truth.known, axis=1)


@dataclass(frozen=True, eq=False)
class Step:
    """Observation, reward and ground truth of one step of a clock.

    Attributes:
        observation: The agents observed now; A = 0 when the episode is over.
        identity: [A] int64, the clock's id of each agent.
        reward: [P] float64, for each agent of the *previous* observation: minus the mean error, in metres, of the
            points that became known, over the outstanding forecasts of the agent (most likely sample).
        settled: The scenes that this step settled; None if there are none.
    """

    observation: Observation
    identity: np.ndarray
    reward: np.ndarray
    settled: Settled | None


def extent_of(xy: np.ndarray) -> np.ndarray:
    """[2, 2], lowest and highest of positions [N, 2]; the unit square if there are none."""
    return np.stack([xy.min(axis=0), xy.max(axis=0)]) if len(xy) else np.array([[0.0, 0.0], [1.0, 1.0]])


def extent_of_windows(truth: Truth) -> np.ndarray:
    """[2, 2], lowest and highest of all known positions."""
    return extent_of(np.concatenate([truth.observation.xy.reshape(-1, 2), truth.future[truth.known]]))


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
        return extent_of_windows(self.truth)

    def name(self, identity: int) -> str:
        """``window_W_agent_N``."""
        return f"window_{self._window[identity]}_agent_{self.truth.observation.agent[identity]}"

    @property
    def scenes(self) -> int:
        """Number of steps of an episode: one for each window."""
        return self.truth.observation.scenes

    @property
    def most(self) -> int:
        """Largest number of agents observed at once."""
        return int(np.diff(self.truth.observation.scene).max(initial=0))

    @property
    def reach(self) -> float:
        """Largest absolute value of the histories of an episode."""
        return float(np.abs(self.truth.observation.history).max(initial=0.0))

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
