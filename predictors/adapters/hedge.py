"""Prediction with expert advice: the trained, the adapted and the constant-velocity forecast, by recent errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from motion_gym.contract import FUTURE, Observation, Truth
from motion_gym.metrics.errors import distance
from motion_gym.predictors.adapters.kalman import Kalman
from motion_gym.predictors.constant_velocity import ConstantVelocity
from motion_gym.predictors.networks.last_layer import LastLayer, Linearised
from motion_gym.predictors.settings import positive, setting, share
from motion_gym.stepping.harness import ask


@dataclass(eq=False, repr=False, kw_only=True)
class Hedge(Kalman):
    """A weighted mean of three forecasts: the trained predictor's, the Kalman filter's, and constant velocity's.

    The trained predictor stays as it came, without a style; the filter's predictor reads the style of the last scenes.
    The weight of each expert, its trust, follows its errors (Herbster and Warmuth, "Tracking the best expert", Machine
    Learning 32, 1998): with each truth that matures the trust in an expert is multiplied by exp(-rate * its ADE / the
    mean ADE of all experts), and a share of all trust is spread evenly, so that an expert that was wrong for long can
    quickly regain trust. The filter learns at any trust.

    Around a predictor without a linear last layer there is no filter, and two experts remain: the predictor and
    constant velocity.

    Args:
        of: See ``Around``; any predictor.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        ridge: See ``Kalman``.
        forgetting: See ``Kalman``.
        rate: How fast trust is lost, above 0; errors are counted relative to their mean.
        share: Share of the trust that is spread evenly at each truth, from 0 to 1.

    Raises:
        SpecError: an argument is not allowed.
        PredictorError: the predictor is not fitted.
    """

    rate: float = setting(3.0, positive)
    share: float = setting(0.03, share)
    kind: ClassVar[str] = "hedge"

    def check_last_layer(self) -> None:
        """Nothing to check: without a last layer there is no filter."""

    @property
    def filters(self) -> bool:
        """Whether the Kalman filter is one of the experts."""
        return isinstance(self.inner, Linearised)

    def _start(self) -> None:
        super()._start()
        experts = 3 if self.filters else 2
        self.trust = np.full(experts, 1 / experts)
        """[E] trust in the trained predictor, the filter if there is one, and constant velocity; the sum is 1."""

    def judge(self, advice: np.ndarray, truth: Truth, agents: np.ndarray) -> None:
        """Update the trust by the errors of the experts on these agents; see ``Kalman.judge``."""
        if not agents.any():
            return
        off = distance(advice[:, agents] - truth.future[agents]).mean(axis=(1, 2))
        trust = self.trust * np.exp(-self.rate * off / max(off.mean(), 1e-9))
        self.trust = (1 - self.share) * trust / trust.sum() + self.share / len(trust)

    def _weighed(self, advice: np.ndarray) -> np.ndarray:
        return np.einsum("e,eaxy->axy", self.trust, advice)

    def _new_layer(self, observation: Observation) -> LastLayer:
        if self.filters:
            return super()._new_layer(observation)
        # A last layer without inputs: there is nothing to learn, and only the rows of known agents count.
        agents = len(observation)
        last = observation.xy[:, -1:].astype(np.float64)
        return LastLayer(np.zeros((agents, 0)), np.zeros((0, 2 * FUTURE)), last)

    def _advice(self, layer: LastLayer, observation: Observation) -> np.ndarray:
        """Forecasts [E, A, 12, 2] of the experts."""
        straight = ConstantVelocity().predict(observation).positions[:, 0]
        if not self.filters:
            return np.stack([ask(self.inner, observation).most_likely(), straight])
        if getattr(self.inner, "scenes", 0):  # the layer knows the style of what was observed
            trained = ask(self._begun, observation).most_likely()
        else:
            trained = layer.positions(np.einsum("rc,co->ro", layer.inputs, layer.weight))
        return np.stack([trained, *super()._advice(layer, observation), straight])
