"""Everybody walks on as before."""

from __future__ import annotations

import numpy as np

from motion_gym.catalog import suggest
from motion_gym.contract import FUTURE, Forecast, Observation, SpecError


class ConstantVelocity:
    """Continues at the velocity of the last step, or at the mean velocity of the history. Deterministic.

    A strong baseline on pedestrians: Schöller et al., "What the constant velocity model can teach us about
    pedestrian motion prediction", RA-L 2020.

    Args:
        velocity: ``"last"`` step, or ``"mean"`` of the 7 observed steps.
    """

    selection = "no weights"

    def __init__(self, velocity: str = "last"):
        if velocity not in ("last", "mean"):
            raise SpecError(
                f"`velocity={velocity}` of constant_velocity is not known.{suggest(str(velocity), ('last', 'mean'))}"
            )
        self.velocity = velocity

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres."""
        xy = observation.xy
        steps = 1 if self.velocity == "last" else xy.shape[1] - 1
        velocity = (xy[:, -1] - xy[:, -1 - steps]) / np.float32(steps)
        ahead = np.arange(1, FUTURE + 1, dtype=np.float32)
        return Forecast((xy[:, -1, None] + ahead[:, None] * velocity[:, None])[:, None])
