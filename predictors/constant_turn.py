"""Constant turn rate and speed: every agent continues on the circle of its last steps."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation
from motion_gym.specs import number, whole_number


class ConstantTurn:
    """Continues at the last speed and turns by the same angle in every step. Deterministic; needs no training.

    The angle is that between the mean directions of the first and the second half of the last steps, divided by the
    number of steps between them. An agent that is slower than ``slowest`` does not turn, because the direction of a
    standing agent is noise. In tracking this is the CTRV model: Schubert, Richter, Wanielik, "Comparison and evaluation
    of advanced motion models for vehicle tracking", FUSION 2008.

    Args:
        steps: Number of last steps, 2 to 7, from which the angle is estimated.
        slowest: Smallest speed of an agent that turns, metres per second, 0 or more.

    Raises:
        SpecError: An argument has another value.
    """

    selection = "no weights"

    def __init__(self, steps: int = 4, slowest: float = 0.3):
        self.steps = whole_number("steps", steps, 2, HISTORY - 1)
        self.slowest = number("slowest", slowest, owner="constant_turn")

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres."""
        xy = observation.xy.astype(np.float64)
        moved = np.diff(xy, axis=1)[:, -self.steps :]
        half = self.steps // 2
        first, second = moved[:, :half].sum(axis=1), moved[:, -half:].sum(axis=1)
        cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        angle = np.arctan2(cross, (first * second).sum(axis=1)) / (self.steps - half)
        speed = np.linalg.norm(moved, axis=-1).mean(axis=1) / observation.dt
        angle = np.where(speed < self.slowest, 0.0, angle)
        turned = angle[:, None] * np.arange(1, FUTURE + 1)
        (x, y), cos, sin = moved[:, -1].T[..., None], np.cos(turned), np.sin(turned)
        steps = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
        return Forecast((xy[:, -1:] + np.cumsum(steps, axis=1)).astype(np.float32)[:, None])
