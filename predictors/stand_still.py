"""Every agent stays at its last observed position."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import FUTURE, Forecast, Observation


class StandStill:
    """Repeats the last observed position: a lower bound for every forecaster. Deterministic; needs no training."""

    selection = "no weights"

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres."""
        last = observation.xy[:, None, -1:]
        return Forecast(np.repeat(last, FUTURE, axis=2))
