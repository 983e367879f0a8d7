"""Prediction with expert advice: trained, adapted, or straight on, as each has lately done."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.contract import Observation, SpecError, Truth
from motion_gym.metrics.errors import distance
from motion_gym.predictors.adapters.adapter import MEMORY
from motion_gym.predictors.adapters.kalman import Kalman
from motion_gym.predictors.constant_velocity import ConstantVelocity
from motion_gym.predictors.networks.last_layer import LastLayer
from motion_gym.predictors.settings import number, positive

EXPERTS = ("trained", "adapted", "constant velocity")


class Hedge(Kalman):
    """A mean of three forecasts: the trained predictor's, the Kalman filter's, and constant velocity's.

    The trained predictor is as it came, without a style; the filter's reads that of the last scenes. How much each is
    trusted follows its errors (Herbster and Warmuth, "Tracking the best expert", Machine Learning 32, 1998): with each
    truth that matures the trust in an expert is multiplied by exp(-rate * its ADE / the mean ADE of the three), and a
    share of all trust is spread evenly, so that who was wrong for long is soon believed again. Where an old domain
    returns the trained predictor is soon trusted, and where nothing that was learned is of use, constant velocity. The
    filter learns, whoever is trusted.

    Args:
        of: As of ``kalman``.
        ridge: As of ``kalman``.
        forgetting: As of ``kalman``.
        rate: How fast trust is lost, above 0; errors are counted relative to their mean.
        share: Share of the trust that is spread evenly at each truth, from 0 to 1.
        memory: As of ``kalman``.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.

    Raises:
        SpecError: an argument is not allowed.
        PredictorError: the predictor has no linear last layer.
    """

    kind = "hedge"
    settings = ("ridge", "forgetting", "rate", "share", "memory")

    def __init__(
        self,
        of: Any = "modular_invariant",
        ridge: float = 10.0,
        forgetting: float = 0.99,
        rate: float = 3.0,
        share: float = 0.03,
        memory: int = MEMORY,
        weights: str | Path | None = None,
        seed: int | None = None,
    ):
        self.rate, self.share = positive("rate", rate), number("share", share)
        if not 0 <= self.share <= 1:
            raise SpecError(f"`share={share}` must be from 0 to 1.")
        super().__init__(of, ridge, forgetting, memory, weights, seed)

    def _start(self) -> None:
        super()._start()
        self.trust = np.full(len(EXPERTS), 1 / len(EXPERTS))
        """[3] of the experts, in their order; the sum is 1."""

    def judge(self, advice: np.ndarray, truth: Truth, agents: np.ndarray) -> None:
        """Trust each expert as it has done on these agents; see ``Kalman.judge``."""
        if not agents.any():
            return
        off = distance(advice[:, agents] - truth.future[agents]).mean(axis=(1, 2))
        trust = self.trust * np.exp(-self.rate * off / max(off.mean(), 1e-9))
        self.trust = (1 - self.share) * trust / trust.sum() + self.share / len(EXPERTS)

    def _weighed(self, advice: np.ndarray) -> np.ndarray:
        return np.einsum("e,eaxy->axy", self.trust, advice)

    def _advice(self, layer: LastLayer, observation: Observation) -> np.ndarray:
        """Forecasts [3, A, 12, 2] of the experts."""
        if getattr(self.inner, "scenes", 0):  # what the layer is given knows the style of what was observed
            trained = self._begun.predict(observation).positions[:, 0]
        else:
            trained = layer.positions(np.einsum("rc,co->ro", layer.inputs, layer.weight))
        straight = ConstantVelocity().predict(observation).positions[:, 0]
        return np.stack([trained, *super()._advice(layer, observation), straight])
