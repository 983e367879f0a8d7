"""Constant acceleration: every agent goes straight on, and its speed keeps changing as in its last steps."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation
from motion_gym.specs import whole_number


class ConstantAcceleration:
    """Continues straight on at the last velocity, with the mean change of speed of the last steps. Deterministic.

    An agent that slows down stops at a speed of 0 and does not turn back. With few steps the annotation noise of
    pedestrians is extrapolated; with more steps the predictor reacts later. Needs no training.

    Args:
        steps: Number of last steps, 2 to 7, whose speeds a straight line is fitted to; its slope is the acceleration.

    Raises:
        SpecError: ``steps`` has another value.
    """

    selection = "no weights"

    def __init__(self, steps: int = 4):
        self.steps = whole_number("steps", steps, 2, HISTORY - 1)

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres."""
        xy = observation.xy.astype(np.float64)
        moved = np.diff(xy, axis=1)[:, -self.steps :]
        speed = np.linalg.norm(moved, axis=-1)  # metres per step
        time = np.arange(self.steps) - (self.steps - 1) / 2
        slope = speed @ time / (time**2).sum()
        direction = moved[:, -1] / np.maximum(speed[:, -1:], 1e-12)
        lengths = np.maximum(speed[:, -1:] + slope[:, None] * np.arange(1, FUTURE + 1), 0.0)
        path = np.cumsum(lengths, axis=1)[..., None] * direction[:, None]
        return Forecast((xy[:, -1:] + path).astype(np.float32)[:, None])
