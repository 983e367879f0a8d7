"""Ridge regression from the history to the future, in the frame of each agent's heading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, PredictorError, Truth
from motion_gym.predictors.networks.sigma import check_sigma, relative_to_scene
from motion_gym.specs import number

if TYPE_CHECKING:
    from motion_gym.predictors.networks.last_layer import LastLayer


class Linear:
    """Linear map from 7 observed displacements to 12 future offsets, in a frame whose x axis is the last step.

    Deterministic; treats each agent independently. Fitted in closed form to all environments together:
    ``W = (X'X + ridge I)^-1 X'Y``, where X holds the 14 rotated displacement values, the 8 values of sigma if it is
    used, and a bias, and Y the 24 rotated offsets from the last observed position. Agents with a partly unknown future
    are left out.

    Args:
        sigma: True to use the third feature of the history; ``"relative"`` to divide it by its mean over the scene,
            which removes its scale; False to ignore it.
        ridge: L2 weight, >= 0, in the units of the data (metres, and the unit of sigma).
    """

    selection = "fitted in closed form to the train windows of the sources; nothing was selected"

    def __init__(self, sigma: bool | str = False, ridge: float = 1.0):
        self.sigma = check_sigma("sigma", sigma)
        self.ridge = number("ridge", ridge, owner="linear")
        self.weight: np.ndarray | None = None
        self.dt = 0.0
        """Seconds per step of the training data."""

    @property
    def fitted(self) -> bool:
        """Whether ``fit`` has been called."""
        return self.weight is not None

    def fit(self, train: Sequence[Truth], validation: Sequence[Truth] = (), seed: int = 0) -> Linear:
        """Fit to the windows of all environments; ``validation`` and ``seed`` are not used.

        Raises:
            PredictorError: no agent is fully known, or the time steps differ.
        """
        steps = {round(truth.observation.dt, 6) for truth in train}
        if len(steps) > 1:
            raise PredictorError(f"linear cannot be fitted to time steps of {sorted(steps)} s at once: resample them.")
        rows, targets = [], []
        for truth in train:
            inputs, turn = self._inputs(truth.observation)
            complete = truth.known.all(axis=1)
            offset = truth.future - truth.observation.xy[:, -1:]
            rows.append(inputs[complete])
            targets.append((offset.astype(np.float64) @ turn)[complete].reshape(-1, 2 * FUTURE))
        x = np.concatenate(rows) if rows else np.zeros((0, 1))
        if not len(x):
            raise PredictorError("linear cannot be fitted: the training set has no agent with 12 known future steps.")
        y = np.concatenate(targets)
        self.dt = train[0].observation.dt
        self.weight = np.linalg.solve(x.T @ x + self.ridge * np.eye(x.shape[1]), x.T @ y)
        return self

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres.

        Raises:
            PredictorError: the predictor is not fitted, was fitted to another time step, or lacks sigma.
        """
        weight = self._fitted_weight(observation)
        inputs, turn = self._inputs(observation)
        # BLAS would round a row differently in another batch; einsum does not.
        offset = np.einsum("ai,ij->aj", inputs, weight).reshape(-1, FUTURE, 2)
        positions = observation.xy[:, -1:] + offset @ turn.transpose(0, 2, 1)
        return Forecast(positions[:, None].astype(np.float32))

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The predictor as a last layer, from the inputs of each agent to the offsets in its heading frame.

        Raises:
            PredictorError: the predictor is not fitted, was fitted to another time step, or lacks sigma.
        """
        # Imported here because it needs PyTorch, unlike the predictor itself.
        from motion_gym.predictors.networks.last_layer import LastLayer

        weight = self._fitted_weight(observation)
        inputs, turn = self._inputs(observation)
        return LastLayer(inputs, weight, observation.xy[:, -1:].astype(np.float64), turn, moves=False)

    def _fitted_weight(self, observation: Observation) -> np.ndarray:
        if self.weight is None:
            raise PredictorError("linear is not fitted: call fit(train, validation, seed), or evaluate it by name.")
        if not math.isclose(observation.dt, self.dt, rel_tol=1e-3):
            raise PredictorError(
                f"linear was fitted to time steps of {self.dt:.3g} s, and the observation has steps of "
                f"{observation.dt:.3g} s: resample the data to {self.dt:.3g} s (domain `tracks`: "
                f"step={self.dt:.3g}), or fit it to such steps."
            )
        return self.weight

    def _inputs(self, observation: Observation) -> tuple[np.ndarray, np.ndarray]:
        """Rows [A, 15 or 23] and the matrices [A, 2, 2] that turn world row vectors into the heading frame."""
        step = np.diff(observation.xy.astype(np.float64), axis=1)
        length = np.hypot(step[:, -1, 0], step[:, -1, 1])
        moving = length > 0
        cos = np.where(moving, step[:, -1, 0] / np.where(moving, length, 1), 1.0)
        sin = np.where(moving, step[:, -1, 1] / np.where(moving, length, 1), 0.0)
        turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], 1)
        columns = [(step @ turn).reshape(len(step), 2 * (HISTORY - 1))]
        if self.sigma:
            if observation.history.shape[2] < 3:
                raise PredictorError(
                    "linear with sigma needs a third feature, but this domain gives only x and y: "
                    "use a domain with sigma, such as eth:alpha=8, or linear without sigma."
                )
            relative = self.sigma == "relative"
            columns.append(
                relative_to_scene(observation) if relative else observation.history[:, :, 2].astype(np.float64)
            )
        columns.append(np.ones((len(step), 1)))
        return np.concatenate(columns, axis=1), turn
