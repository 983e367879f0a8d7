"""Recursive Bayesian last layer: closed-form updates, forgetting, and a predictive covariance."""

from __future__ import annotations

import copy
from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from motion_gym.contract import FUTURE, Forecast, Observation, PredictorError, Truth
from motion_gym.predictors.adapters.adapter import KEPT, Adapter, KnownSteps
from motion_gym.predictors.networks.last_layer import LastLayer, Linearised
from motion_gym.predictors.networks.scene_noise import agent_keys, normals
from motion_gym.predictors.settings import Check, positive, setting
from motion_gym.specs import number
from motion_gym.stepping.harness import name_of

FORGETTING: Check = partial(number, above=True, most=1)
"""Checks a factor on the weight of older observations."""
NO_WEIGHTS = np.zeros((0, 0))
"""Stands for the trained weights of a last layer."""


@dataclass(eq=False, repr=False, kw_only=True)
class Kalman(Adapter):
    """Replaces the last layer by the mean of its posterior, with the trained layer as the prior.

    Let phi be the inputs of the last layer, y the true outputs, W0 the trained weights, and w = forgetting to the power
    of the number of scenes since. The weights W minimise

        sum w |y - phi W|^2 + ridge |W - W0|^2.

    This is the mean of a recursive least-squares (Kalman) filter for a constant W. The filter forgets observations but
    not the prior, so W returns to W0 when no scenes arrive. Rows with unknown values are left out. Repeated ground
    truth counts once.

    The predictive variance of a position is the variance of the residuals before each update, per future step and with
    the same forgetting, times 1 + phi' P phi, where P is the covariance of W in units of the noise. The first sample is
    the mean; further samples are drawn from this distribution, with one deviation per agent for all steps.

    Args:
        of: See ``Around``; a predictor of the STGAT or modular family, or ``linear``.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        ridge: Precision of the prior in units of the noise precision; above 0.
        forgetting: Factor on the weight of older observations per scene, above 0, at most 1.

    Raises:
        SpecError: a setting is not allowed.
        PredictorError: the predictor has no linear last layer.
    """

    ridge: float = setting(10.0, positive)
    forgetting: float = setting(0.99, FORGETTING)
    kind: ClassVar[str] = "kalman"

    def _prepare(self) -> None:
        super()._prepare()
        if not isinstance(self.inner, Linearised):
            raise PredictorError(
                f"{name_of(self.inner)} has no linear last layer that can be replaced (`last_layer`): use linear, or "
                "one of the STGAT or modular family, such as erm or modular_invariant."
            )

    def _start(self) -> None:
        super()._start()
        self.precision = self.pull = self.mean = NO_WEIGHTS
        """[C, C] sum of phi phi' and [C, O] sum of phi y', with forgetting and without the prior; [C, O] weights W."""
        self.factor = NO_WEIGHTS
        """[C, C] lower Cholesky factor of ``precision`` with the prior; empty before the first update."""
        self.squares, self.count = np.zeros(FUTURE), np.zeros(FUTURE)
        """[12] sums, with forgetting, of squared residuals per coordinate and of their weights, by future step."""
        self.moved = 0.0
        """Norm of W - W0 over that of W0."""
        self.known = KnownSteps()
        self.layers: OrderedDict[bytes, LastLayer] = OrderedDict()
        """Last layers of recent observations, which are needed again when their ground truth is revealed."""

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "layers": OrderedDict()}  # layers only save time

    def __deepcopy__(self, memo: dict[int, Any]) -> Kalman:
        duplicate = object.__new__(type(self))
        vars(duplicate).update({k: copy.deepcopy(v, memo) for k, v in vars(self).items() if k != "layers"})
        duplicate.layers = self.layers.copy()  # layers are immutable
        return duplicate

    def _layer(self, observation: Observation) -> LastLayer:
        style = getattr(self.inner, "observed", np.zeros(0)), getattr(self.inner, "scenes", 0)
        key = observation.history.tobytes() + observation.scene.tobytes() + np.append(*style).tobytes()
        layer: LastLayer = self.layers.get(key) or self.inner.last_layer(observation)
        if key in self.layers or len(self.layers) < KEPT:  # predict never deletes an entry
            self.layers[key] = layer
        return layer

    def learn(self, truth: Truth) -> None:
        """Add the rows of the last layer that became known."""
        for _ in range(len(self.layers) - KEPT // 2):
            self.layers.popitem(last=False)
        observation = truth.observation
        layer = self._layer(observation)
        before = self.known.update(truth)
        old_rows = layer.known_rows(before)
        new_rows = layer.known_rows(truth.known) & ~old_rows
        if not new_rows.any():
            return

        # Older observations are forgotten by one factor per scene that is revealed for the first time.
        new_steps, old_steps = (layer.by_step(rows.astype(float)) > 0 for rows in (new_rows, old_rows))
        with_new, with_old = (
            np.bincount(observation.scene_index, steps.any(axis=1), observation.scenes) > 0
            for steps in (new_steps, old_steps)
        )
        fade = self.forgetting ** int((with_new & ~with_old).sum())

        phi = layer.inputs[new_rows]
        y = layer.outputs(truth.future.astype(np.float64))[new_rows]
        past = (self.precision, self.pull) if self.precision.size else (0.0, 0.0)
        precision, pull = fade * past[0] + phi.T @ phi, fade * past[1] + phi.T @ y
        try:
            factor = np.linalg.cholesky(self.ridge * np.eye(len(precision)) + precision)
            mean = cho_solve((factor, True), self.ridge * layer.weight + pull, check_finite=False)
        except np.linalg.LinAlgError:
            factor, mean = self.factor, np.full_like(pull, np.nan)

        # The residual of a new point has the variance noise * (1 + phi' P phi).
        residual = self.forecast(observation, self.mean) - truth.future
        noise = (residual**2).sum(axis=-1) / 2 / (1 + self._uncertainty(layer))
        self.updates += 1
        if not np.isfinite(mean).all() or not np.isfinite(noise[new_steps]).all():
            self.rolled_back += 1
            return
        self.precision, self.pull, self.factor, self.mean = precision, pull, factor, mean
        self.moved = float(np.linalg.norm(mean - layer.weight) / max(np.linalg.norm(layer.weight), 1e-9))
        self.squares = fade * self.squares + np.where(new_steps, noise, 0).sum(axis=0)
        self.count = fade * self.count + new_steps.sum(axis=0)

    def gauges(self) -> dict[str, float]:
        """What has been learned, as the results page shows it over time: numbers by name."""
        return {"relative change of the last layer": self.moved}

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres: the mean first, then samples of the predictive distribution."""
        mean = self.forecast(observation, self.mean)
        return drawn_around(mean, self.variance(observation) if samples > 1 else None, observation, samples, seed)

    def variance(self, observation: Observation) -> np.ndarray:
        """Predictive variance [A, 12] of each coordinate, square metres; 0 before the first update."""
        scale = self.squares / np.maximum(self.count, 1e-9)
        return np.asarray(scale * (1 + self._uncertainty(self._layer(observation))))

    def forecast(self, observation: Observation, weight: np.ndarray) -> np.ndarray:
        """Forecast [A, 12, 2], metres, with weights [C, O] of the last layer; the trained ones if empty."""
        layer = self._layer(observation)
        # A matrix product would round a row differently in another batch.
        return layer.positions(np.einsum("rc,co->ro", layer.inputs, weight if weight.size else layer.weight))

    def _uncertainty(self, layer: LastLayer) -> np.ndarray:
        """Phi' P phi for each agent and step, [A, 12]."""
        if not self.factor.size:
            return layer.by_step((layer.inputs**2).sum(axis=1) / self.ridge)
        whitened = solve_triangular(self.factor, layer.inputs.T, lower=True, check_finite=False)
        return layer.by_step((whitened**2).sum(axis=0))


def drawn_around(
    mean: np.ndarray, variance: np.ndarray | None, observation: Observation, samples: int, seed: int
) -> Forecast:
    """A forecast [A, K, 12, 2]: the mean first, then samples with one deviation per agent for all steps.

    Args:
        mean: [A, 12, 2], metres.
        variance: [A, 12] or [12] variance of each coordinate, square metres; unused for one sample.
        observation: The observation.
        samples: K.
        seed: Seed of the samples.
    """
    positions = np.repeat(mean[:, None], samples, axis=1)
    if samples > 1 and variance is not None:
        _, own = agent_keys(observation, samples, seed)
        drawn = normals(own, 2).transpose(1, 0, 2)[:, 1:, None]
        spread = np.broadcast_to(np.sqrt(variance), mean.shape[:2])
        positions[:, 1:] += drawn * spread[:, None, :, None]
    return Forecast(positions.astype(np.float32))
