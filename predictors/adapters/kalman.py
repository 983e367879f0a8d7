"""Recursive Bayesian last layer: closed-form updates, forgetting, and a predictive covariance."""

from __future__ import annotations

import copy
from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from motion_gym.contract import FUTURE, Forecast, Observation, PredictorError, Truth
from motion_gym.predictors.adapters.adapter import KEPT, Adapter, Told
from motion_gym.predictors.networks.last_layer import LastLayer, Linearised
from motion_gym.predictors.networks.scene_noise import agent_keys, normals
from motion_gym.predictors.settings import number, positive, setting
from motion_gym.stepping.harness import name_of


@dataclass(eq=False, repr=False, kw_only=True)
class Kalman(Adapter):
    """Replaces the last layer by the mean of its posterior, given the trained one as prior and all truth so far.

    With inputs phi of the last layer, true outputs y and prior weights W0, and w = forgetting to the power of the
    scenes that have come since, the weights are those that minimise

        sum w |y - phi W|^2 + ridge |W - W0|^2,

    the mean of a recursive least-squares (Kalman) filter for a constant W that forgets, but never its prior: where
    nothing comes, it goes back to the trained weights and does not wind up. Rows of which something is unknown are left
    out, and what is told again counts once.

    The predictive covariance of a position is that of the residuals before each update, by future step, forgotten at
    the same pace, times 1 + phi' P phi with P the covariance of W in units of the noise. More samples than one are
    drawn from it, the first is its mean; an agent is off in one direction over all steps.

    Args:
        of: See ``Around``; a predictor of the STGAT or modular family, or ``linear``.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        ridge: Precision of the prior, in units of the noise's; above 0.
        forgetting: Factor by which the weight of what was seen falls with each scene, above 0, at most 1.

    Raises:
        SpecError: an argument is not allowed.
        PredictorError: the predictor has no linear last layer, or is not fitted.
    """

    ridge: float = setting(10.0, positive)
    forgetting: float = setting(0.99, partial(number, above=True, most=1))
    kind: ClassVar[str] = "kalman"

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        super().__post_init__(of, weights, seed)
        if getattr(self.inner, "fitted", True) is False:
            raise PredictorError(
                f"{name_of(self.inner)} is not fitted: give it fitted, as `fit(train, validation)` "
                "leaves it, or adapt it by name on a stream, `motion-gym adapt`."
            )
        self.check_last_layer()

    def check_last_layer(self) -> None:
        """Raise PredictorError unless the predictor has a last layer that can be replaced."""
        if not isinstance(self.inner, Linearised):
            raise PredictorError(
                f"{name_of(self.inner)} has no linear last layer that can be replaced (`last_layer`): use linear, or "
                "one of the STGAT or modular family, as erm or modular_invariant."
            )

    def _start(self) -> None:
        super()._start()
        self.precision = self.pull = self.mean = np.zeros((0, 0))
        """[C, C] sum of phi phi' and [C, O] sum of phi y', both forgotten, without the prior; [C, O] weights W."""
        self.squares, self.count = np.zeros(FUTURE), np.zeros(FUTURE)
        """[12] sums of squared residuals per coordinate by future step, and of their weights, both forgotten."""
        self.told = Told()
        self.layers: OrderedDict[bytes, LastLayer] = OrderedDict()
        """Last layers of observations that were forecast, which are needed again when their truth is told."""

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "layers": OrderedDict()}  # layers only save time

    def __deepcopy__(self, memo: dict[int, Any]) -> Kalman:
        duplicate = object.__new__(type(self))
        vars(duplicate).update({k: copy.deepcopy(v, memo) for k, v in vars(self).items() if k != "layers"})
        duplicate.layers = self.layers.copy()  # a layer never changes
        return duplicate

    def _layer(self, observation: Observation) -> LastLayer:
        style = getattr(self.inner, "observed", np.zeros(0)), getattr(self.inner, "scenes", 0)
        key = observation.history.tobytes() + observation.scene.tobytes() + np.append(*style).tobytes()
        if key not in self.layers:
            layer = self._new_layer(observation)
            if len(self.layers) >= KEPT:
                return layer  # asking changes nothing that is held
            self.layers[key] = layer
        return self.layers[key]

    def _new_layer(self, observation: Observation) -> LastLayer:
        return self.inner.last_layer(observation)  # type: ignore[no-any-return]

    def learn(self, truth: Truth) -> None:
        """Take in the rows of the last layer that have become known."""
        for _ in range(len(self.layers) - KEPT // 2):
            self.layers.popitem(last=False)
        observation = truth.observation
        layer = self._layer(observation)
        before = self.told.before(truth)
        old_rows = layer.known_rows(before)
        new_rows = layer.known_rows(truth.known) & ~old_rows
        if not new_rows.any():
            return
        advice = self._advice(layer, observation)
        self.judge(advice, truth, np.asarray(truth.known.all(axis=1) & ~before.all(axis=1)))

        # Everything so far is forgotten a little for each scene that is told for the first time.
        new_steps, old_steps = (layer.by_step(rows.astype(float)) > 0 for rows in (new_rows, old_rows))
        first_time = _scenes_with(new_steps, observation) & ~_scenes_with(old_steps, observation)
        fade = self.forgetting ** int(first_time.sum())

        phi = layer.inputs[new_rows]
        y = layer.outputs(truth.future.astype(np.float64))[new_rows]
        past = (self.precision, self.pull) if self.precision.size else (0.0, 0.0)
        precision, pull = fade * past[0] + phi.T @ phi, fade * past[1] + phi.T @ y
        mean = _solved(self.ridge * np.eye(len(precision)) + precision, self.ridge * layer.weight + pull)

        # The residual of a new point has the variance noise * (1 + phi' P phi).
        residual = self._weighed(advice) - truth.future
        noise = (residual**2).sum(axis=-1) / 2 / (1 + self._doubt(layer))
        self.updates += 1
        if not np.isfinite(mean).all() or not np.isfinite(noise[new_steps]).all():
            self.rolled_back += 1
            return
        self.precision, self.pull, self.mean = precision, pull, mean
        self.squares = fade * self.squares + np.where(new_steps, noise, 0).sum(axis=0)
        self.count = fade * self.count + new_steps.sum(axis=0)

    def judge(self, advice: np.ndarray, truth: Truth, agents: np.ndarray) -> None:
        """Compare forecasts [E, A, 12, 2] with what has become known, before it is learned; here, do nothing.

        Args:
            advice: What ``_advice`` gives.
            truth: What became known.
            agents: [A] bool, the agents of whom everything is known now, and was not before.
        """

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres: the mean first, then samples of the predictive distribution."""
        layer = self._layer(observation)
        positions = np.repeat(self._weighed(self._advice(layer, observation))[:, None], samples, axis=1)
        if samples > 1:
            _, own = agent_keys(observation, samples, seed)
            drawn = normals(own, 2).transpose(1, 0, 2)[:, 1:, None]
            positions[:, 1:] += drawn * np.sqrt(self._variance(layer))[:, None, :, None]
        return Forecast(positions.astype(np.float32))

    def variance(self, observation: Observation) -> np.ndarray:
        """Predictive variance [A, 12] of each coordinate, square metres; 0 before anything was observed."""
        return self._variance(self._layer(observation))

    def _variance(self, layer: LastLayer) -> np.ndarray:
        return np.asarray(self.squares / np.maximum(self.count, 1e-9) * (1 + self._doubt(layer)))

    def _advice(self, layer: LastLayer, observation: Observation) -> np.ndarray:
        """Forecasts [E, A, 12, 2], metres, of the E experts that a forecast is made of; here, one."""
        return layer.positions(self._outputs(layer))[None]

    def _weighed(self, advice: np.ndarray) -> np.ndarray:
        """Forecast [A, 12, 2], metres."""
        return advice[0]  # type: ignore[no-any-return]

    def _outputs(self, layer: LastLayer) -> np.ndarray:
        # A product of matrices would give a row other last bits in another batch.
        return np.einsum("rc,co->ro", layer.inputs, self.mean if self.mean.size else layer.weight)

    def _doubt(self, layer: LastLayer) -> np.ndarray:
        """Phi' P phi of each agent and step: [A, 12]."""
        precision = self.precision if self.precision.size else 0.0
        spread = np.linalg.inv(self.ridge * np.eye(layer.inputs.shape[1]) + precision)
        return layer.by_step(np.einsum("rc,cd,rd->r", layer.inputs, spread, layer.inputs, optimize=True))


def _scenes_with(steps: np.ndarray, observation: Observation) -> np.ndarray:
    """[S] bool, the scenes in which some of the steps [A, 12] are set."""
    return np.asarray(np.bincount(observation.scene_index, steps.any(axis=1), observation.scenes) > 0)


def _solved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The solution of a x = b; NaN where there is none."""
    try:
        return np.linalg.solve(a, b)
    except np.linalg.LinAlgError:
        return np.full_like(b, np.nan)
