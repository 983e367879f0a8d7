"""Constant velocity: every agent continues at its recent velocity."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation
from motion_gym.specs import one_of, whole_number

WINDOWS = {"last": 1, "mean": HISTORY - 1}
"""Number of steps to average the velocity over, by name."""


class ConstantVelocity:
    """Continues at the mean velocity of the last observed steps. Deterministic; needs no training.

    A strong baseline for pedestrians: Schöller et al., "What the constant velocity model can teach us about
    pedestrian motion prediction", RA-L 2020. A mean over several steps suppresses annotation noise, but reacts later.

    Args:
        velocity: Number of steps, 1 to 7, to average the velocity over; ``"last"`` is 1, ``"mean"`` is 7.

    Raises:
        SpecError: ``velocity`` has another value.
    """

    selection = "no weights"

    def __init__(self, velocity: str | int = "last"):
        if isinstance(velocity, str):
            self.steps = WINDOWS[one_of("velocity", velocity, WINDOWS, "constant_velocity (or a number of steps)")]
        else:
            self.steps = whole_number("velocity", velocity, 1, HISTORY - 1)
        self.velocity = velocity

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres."""
        xy = observation.xy
        velocity = (xy[:, -1] - xy[:, -1 - self.steps]) / np.float32(self.steps)
        ahead = np.arange(1, FUTURE + 1, dtype=np.float32)
        return Forecast((xy[:, -1, None] + ahead[:, None] * velocity[:, None])[:, None])
