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

    The trained predictor keeps its weights and has no style; the filter's predictor reads the style of recent scenes.
    The weight of each expert, its trust, follows its errors (Herbster and Warmuth, "Tracking the best expert", Machine
    Learning 32, 1998). Whenever ground truth matures, the trust in an expert is multiplied by exp(-rate * its ADE / the
    mean ADE of all experts). Then a share of the total trust is spread evenly, so that an expert with a long series of
    errors can regain trust quickly. The filter learns regardless of its trust.

    If the predictor has no linear last layer, there is no filter: the experts are the predictor and constant velocity.

    Args:
        of: See ``Around``; any predictor.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        ridge: See ``Kalman``.
        forgetting: See ``Kalman``.
        rate: Learning rate of the trust, above 0.
        share: Share of the trust that is spread evenly at each update, from 0 to 1.

    Raises:
        SpecError: a setting is not allowed.
        PredictorError: the predictor is not fitted.
    """

    rate: float = setting(3.0, positive)
    share: float = setting(0.03, share)
    kind: ClassVar[str] = "hedge"
    needs_last_layer: ClassVar[bool] = False

    @property
    def filters(self) -> bool:
        """Whether the Kalman filter is one of the experts."""
        return isinstance(self.inner, Linearised)

    def _start(self) -> None:
        super()._start()
        experts = 3 if self.filters else 2
        self.trust = np.full(experts, 1 / experts)
        """[E] trust in the trained predictor, the filter if there is one, and constant velocity; the sum is 1."""

    def gauges(self) -> dict[str, float]:
        """Trust in each expert."""
        names = ("the trained predictor", "the filter", "constant velocity")
        experts = names if self.filters else (names[0], names[2])
        return {f"trust in {name}": float(share) for name, share in zip(experts, self.trust, strict=True)}

    def judge(self, experts: np.ndarray, truth: Truth, agents: np.ndarray) -> None:
        """Update the trust by the errors of the experts on these agents; see ``Kalman.judge``."""
        if not agents.any():
            return
        errors = distance(experts[:, agents] - truth.future[agents]).mean(axis=(1, 2))
        trust = self.trust * np.exp(-self.rate * errors / max(errors.mean(), 1e-9))
        self.trust = (1 - self.share) * trust / trust.sum() + self.share / len(trust)

    def _combined(self, experts: np.ndarray) -> np.ndarray:
        return np.einsum("e,eaxy->axy", self.trust, experts)

    def _new_layer(self, observation: Observation) -> LastLayer:
        if self.filters:
            return super()._new_layer(observation)
        # A last layer without inputs has nothing to learn; its rows only show which agents are known.
        last = observation.xy[:, -1:].astype(np.float64)
        return LastLayer(np.zeros((len(observation), 0)), np.zeros((0, 2 * FUTURE)), last)

    def _experts(self, layer: LastLayer, observation: Observation) -> np.ndarray:
        straight = ConstantVelocity().predict(observation).positions[:, 0]
        if not self.filters:
            return np.stack([ask(self.inner, observation).most_likely(), straight])
        if getattr(self.inner, "scenes", 0):  # the layer includes the style of the observed scenes
            trained = ask(self.source, observation).most_likely()
        else:
            trained = layer.positions(np.einsum("rc,co->ro", layer.inputs, layer.weight))
        return np.stack([trained, *super()._experts(layer, observation), straight])
