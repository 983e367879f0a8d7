"""Recursive Bayesian last layer: closed-form updates, forgetting, and a predictive covariance."""

from __future__ import annotations

import copy
import itertools
from collections import OrderedDict
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from motion_gym.contract import FUTURE, Forecast, Observation, PredictorError, SpecError, Truth
from motion_gym.predictors.adapters.adapter import KEPT, MEMORY, Adapter, scene_key
from motion_gym.predictors.networks.last_layer import LastLayer, Linearised
from motion_gym.predictors.networks.scene_noise import agent_numbers, mixed, normals, scene_keys
from motion_gym.predictors.settings import number, positive
from motion_gym.stepping.harness import name_of


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
        of: Name of a predictor of the STGAT or modular family, ``linear``, or such a predictor; a copy of it is used.
        ridge: Precision of the prior, in units of the noise's; above 0.
        forgetting: Factor by which the weight of what was seen falls with each scene, above 0, at most 1.
        memory: Whole scenes, the last ones, that a style is read from; 0 for never.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.

    Raises:
        SpecError: an argument is not allowed.
        PredictorError: the predictor has no linear last layer.
    """

    kind = "kalman"
    settings: ClassVar[tuple[str, ...]] = ("ridge", "forgetting", "memory")

    def __init__(
        self,
        of: Any = "modular_invariant",
        ridge: float = 10.0,
        forgetting: float = 0.99,
        memory: int = MEMORY,
        weights: str | Path | None = None,
        seed: int | None = None,
    ):
        self.ridge, self.forgetting = positive("ridge", ridge), number("forgetting", forgetting)
        if not 0 < self.forgetting <= 1:
            raise SpecError(f"`forgetting={forgetting}` must be above 0, and at most 1.")
        super().__init__(of, memory, weights, seed)
        if not isinstance(self.inner, Linearised):
            raise PredictorError(
                f"{name_of(self.inner)} has no linear last layer that can be replaced (`last_layer`): use linear, or "
                "one of the STGAT or modular family, as erm or modular_invariant."
            )
        if getattr(self.inner, "fitted", True) is False:
            raise PredictorError(
                f"{name_of(self.inner)} is not fitted: give it fitted, as `fit(train, validation)` "
                "leaves it, or adapt it by name on a stream, `motion-gym adapt`."
            )

    def _start(self) -> None:
        super()._start()
        self.precision = self.pull = self.mean = np.zeros((0, 0))
        """[C, C] and [C, O] what was seen, without the prior; [C, O] the weights."""
        self.squares, self.count = np.zeros(FUTURE), np.zeros(FUTURE)
        """Sums of squared residuals per coordinate by future step, and how many they are."""
        self.told: OrderedDict[bytes, np.ndarray] = OrderedDict()
        """What was known of the last scenes, by what was observed: labels may come step by step."""
        self.layers: OrderedDict[bytes, LastLayer] = OrderedDict()
        """Last layers of observations that were forecast, as they are needed again when their truth is told."""

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "layers": OrderedDict()}  # only to save time, and it cannot be pickled

    def __deepcopy__(self, memo: dict[int, Any]) -> Kalman:
        made = object.__new__(type(self))
        vars(made).update({k: copy.deepcopy(v, memo) for k, v in vars(self).items() if k != "layers"})
        made.layers = self.layers.copy()  # nobody changes a layer
        return made

    def _layer(self, observation: Observation) -> LastLayer:
        style = getattr(self.inner, "observed", np.zeros(0)), getattr(self.inner, "scenes", 0)
        told = observation.history.tobytes() + observation.scene.tobytes()
        key = told + np.append(*style).tobytes()
        if key not in self.layers:
            layer = self.inner.last_layer(observation)
            if len(self.layers) >= KEPT:
                return layer  # asking changes nothing that is held
            self.layers[key] = layer
        return self.layers[key]

    def learn(self, truth: Truth) -> None:
        """Take in the rows that are known."""
        for _ in range(len(self.layers) - KEPT // 2):
            self.layers.popitem(last=False)
        layer = self._layer(truth.observation)
        before = self._told_before(truth)
        counted = layer.by_row(before)
        rows = layer.by_row(truth.known) & ~counted
        if not rows.any():
            return
        index, scenes = truth.observation.scene_index, truth.observation.scenes
        new, old = (layer.by_step(which * 1.0) > 0 for which in (rows, counted))
        adds, added = (np.bincount(index, steps.any(axis=1), scenes) > 0 for steps in (new, old))
        faded = self.forgetting ** int((adds & ~added).sum())
        x, y = layer.inputs[rows], layer.outputs(truth.future.astype(np.float64))[rows]
        advice = self._advice(layer, truth.observation)
        self.judge(advice, truth, np.asarray(truth.known.all(axis=1) & ~before.all(axis=1)))
        if not len(self.precision):
            self.precision, self.pull = np.zeros((x.shape[1], x.shape[1])), np.zeros((x.shape[1], y.shape[1]))
        residual = self._weighed(advice) - truth.future
        square = (residual**2).sum(axis=-1) / 2 / (1 + self._doubt(layer))
        precision, pull = faded * self.precision + x.T @ x, faded * self.pull + x.T @ y
        self.updates += 1
        mean = _solved(self.ridge * np.eye(len(precision)) + precision, self.ridge * layer.weight + pull)
        if not np.isfinite(mean).all() or not np.isfinite(square[new]).all():
            self.rolled_back += 1
            return
        self.precision, self.pull, self.mean = precision, pull, mean
        self.squares = faded * self.squares + np.where(new, square, 0).sum(axis=0)
        self.count = faded * self.count + new.sum(axis=0)

    def judge(self, advice: np.ndarray, truth: Truth, agents: np.ndarray) -> None:
        """Hold forecasts [E, A, 12, 2] against what is new, before it is learned; here, nothing.

        Args:
            advice: What ``_advice`` gives.
            truth: What became known.
            agents: [A] bool, of whom all is known now, and was not before.
        """

    def _told_before(self, truth: Truth) -> np.ndarray:
        """What was known [A, 12] of the same scenes when they were told before; this truth is remembered."""
        seen, before = truth.observation, np.zeros_like(truth.known)
        for scene, (first, last) in enumerate(itertools.pairwise(seen.scene)):
            key = scene_key(truth, scene)
            before[first:last] = self.told.pop(key, False)
            self.told[key] = truth.known[first:last] | before[first:last]
        while len(self.told) > KEPT:
            self.told.popitem(last=False)
        return before

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres: the mean first, then samples of the predictive distribution."""
        layer = self._layer(observation)
        positions = np.repeat(self._weighed(self._advice(layer, observation))[:, None], samples, axis=1)
        if samples > 1:
            keys = scene_keys(observation, samples, seed)
            own = mixed(keys[:, observation.scene_index] + agent_numbers(observation) + np.uint64(1))
            drawn = normals(own, 2).transpose(1, 0, 2)[:, 1:, None]
            positions[:, 1:] += drawn * np.sqrt(self._variance(layer))[:, None, :, None]
        return Forecast(positions.astype(np.float32))

    def variance(self, observation: Observation) -> np.ndarray:
        """Predictive variance [A, 12] of each coordinate, square metres; 0 before anything was observed."""
        return self._variance(self._layer(observation))

    def _variance(self, layer: LastLayer) -> np.ndarray:
        return np.asarray(self.squares / np.maximum(self.count, 1e-9) * (1 + self._doubt(layer)))

    def _advice(self, layer: LastLayer, observation: Observation) -> np.ndarray:
        """Forecasts [E, A, 12, 2], metres, that a forecast is made of; here, one."""
        return layer.positions(self._outputs(layer))[None]

    def _weighed(self, advice: np.ndarray) -> np.ndarray:
        """Forecast [A, 12, 2], metres."""
        return advice[0]  # type: ignore[no-any-return]

    def _outputs(self, layer: LastLayer) -> np.ndarray:
        # A product of matrices would give a row other last bits in another batch.
        return np.einsum("rc,co->ro", layer.inputs, self.mean if self.mean.size else layer.weight)

    def _doubt(self, layer: LastLayer) -> np.ndarray:
        """Phi' P phi of each agent and step: [A, 12]."""
        spread = np.linalg.inv(self.ridge * np.eye(layer.inputs.shape[1]) + (self.precision if self.mean.size else 0))
        return layer.by_step(np.einsum("rc,cd,rd->r", layer.inputs, spread, layer.inputs, optimize=True))


def _solved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The solution of a x = b; NaN where there is none."""
    try:
        return np.linalg.solve(a, b)
    except np.linalg.LinAlgError:
        return np.full_like(b, np.nan)
