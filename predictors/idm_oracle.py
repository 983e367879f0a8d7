"""An oracle for the traffic domain: knows the style and the roads, and simulates."""

from __future__ import annotations

import itertools

import numpy as np

from motion_gym.contract import FUTURE, Forecast, Observation
from motion_gym.predictors.simulating import Simulating


class IdmOracle(Simulating):
    """Simulates each scene on from its history, with the roads and the style of the domain.

    *Oracle*: ``know(domain)`` gives it the style and the scenario, which no forecaster can know. It does not use the
    future. Its remaining error comes from what a history does not show: target speeds, which are computed from the last
    acceleration by solving IDM for them; turns at a crossing, for which it assumes the middle one; the moments of lane
    changes; and vehicles that are not in the scene. Deterministic.
    """

    selection = "no weights; knows the style and the roads"
    kind = "idm_oracle"
    knows = ("highway", "traffic", "`highway`")

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres.

        Raises:
            PredictorError: ``know`` was not called.
            SpecError: highway-env is not installed, or another version is.
        """
        domain, xy = self.known(), observation.xy.astype(np.float64)
        futures = [domain.continued(xy[a:b]) for a, b in itertools.pairwise(observation.scene)]
        future = np.concatenate(futures) if futures else np.zeros((0, FUTURE, 2))
        return Forecast(future.astype(np.float32)[:, None])
