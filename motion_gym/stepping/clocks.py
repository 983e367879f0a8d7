"""What a step of a clock reveals: observations and ground truth, as arrays.

A clock has ``reset()`` and ``step(forecast)``, which give a Step; the ``time`` of what is observed (number of the
window, or of the listed frame); the ``ledger`` of the episode; the ``extent`` of all positions, for a fixed scale; and
agents with ids 0 .. ``size`` - 1, in the order in which they enter, that never return. ``name(id)`` ends in the number
of the agent in the observation. The windows clock goes from window to window and reveals each ground truth at once. The
stream clock goes from frame to frame and reveals the ground truth of a scene when all of it has happened. Both store a
forecast in their ledger before they reveal anything, and neither hands out a position before its time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.contract import Forecast, Observation, Truth


@dataclass(frozen=True, eq=False)
class Settled:
    """Scenes whose ground truth has just been revealed.

    Each forecast is matured, or censored because its agent left.

    Attributes:
        forecast: The stored forecasts of M agents.
        truth: The ground truth, with the observations that were forecast; whole scenes.
        identity: [M] int64, the clock's id of each agent.
        person: [M] int64, the agent as in ``domain.windows``: an agent that is lost and found again has two ids but is
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
    """What one step of a clock reveals.

    Attributes:
        observation: The agents observed now; A = 0 when the episode is over.
        identity: [A] int64, the clock's id of each of them.
        reward: [P] float64, for each agent of the observation *before*: minus the mean error, in metres, of the points
            that became known, over that agent's outstanding forecasts (most likely sample).
        settled: The scenes that were settled by this step; None if there are none.
    """

    observation: Observation
    identity: np.ndarray
    reward: np.ndarray
    settled: Settled | None


def extent_of(xy: np.ndarray) -> np.ndarray:
    """[2, 2], lowest and highest of positions [N, 2]; the unit square where there are none."""
    return np.stack([xy.min(axis=0), xy.max(axis=0)]) if len(xy) else np.array([[0.0, 0.0], [1.0, 1.0]])
