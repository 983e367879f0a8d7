"""An oracle for the traffic domain: knows the style and the roads, and simulates."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, Domain, Forecast, Observation, PredictorError


class IdmOracle:
    """Simulates each scene on from its history, with the roads and the style of the domain.

    *Oracle*: ``know(domain)`` gives it the style and the scenario, which no forecaster can know. It does not use the
    future. Its remaining error comes from what a history does not show: target speeds, which are computed from the last
    acceleration by solving IDM for them; turns at a crossing, for which it assumes the middle one; the moments of lane
    changes; and vehicles that are not in the scene. Deterministic.
    """

    selection = "no weights; knows the style and the roads"

    def __init__(self) -> None:
        self._domain: Any = None

    def know(self, domain: Domain) -> None:
        """Receive the domain.

        Raises:
            PredictorError: the domain is not a traffic domain.
        """
        if domain.card.name != "highway":
            raise PredictorError(f"idm_oracle knows traffic only, not `{domain.card.name}`: score it on `highway`.")
        self._domain = domain

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres.

        Raises:
            PredictorError: ``know`` was not called.
            SpecError: highway-env is not installed, or another version is.
        """
        if self._domain is None:
            raise PredictorError("idm_oracle does not know the domain: call know(domain), or evaluate it by name.")
        xy = observation.xy.astype(np.float64)
        futures = [self._domain.continued(xy[a:b]) for a, b in itertools.pairwise(observation.scene)]
        future = np.concatenate(futures) if futures else np.zeros((0, FUTURE, 2))
        return Forecast(future.astype(np.float32)[:, None])
