"""The check of forecasts from predictors, in ledgers and in metrics."""

from __future__ import annotations

from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, Forecast, MotionGymError, Observation, PredictorError


def check_forecast(forecast: Any, observation: Observation, samples: int | None, name: str) -> Forecast:
    """A valid forecast with float32 copies of its arrays.

    Args:
        forecast: A Forecast, or its positions alone.
        observation: The observation that it answers; A agents.
        samples: K, the requested number of samples; a deterministic predictor may return 1. None to allow any number.
        name: Source of the forecast for messages, as ``MyPredictor.predict``.

    Returns:
        Forecast with positions [A, K, 12, 2] float32, metres, and weights [A, K] float32 or None.

    Raises:
        PredictorError: The type, shape or dtype is wrong, a value is not finite, or the weights do not fit.
    """
    try:
        return _checked(forecast, observation, samples, name)
    except MotionGymError:
        raise
    except Exception as error:  # array types of third parties may raise anything
        raise PredictorError(
            f"{name} returned something that cannot be read ({type(error).__name__}): return a Forecast of plain numpy "
            "arrays."
        ) from error


def _checked(forecast: Any, observation: Observation, samples: int | None, name: str) -> Forecast:
    positions, weights = (forecast.positions, forecast.weights) if isinstance(forecast, Forecast) else (forecast, None)
    if not isinstance(positions, np.ndarray) or isinstance(positions, np.ma.MaskedArray):
        raise PredictorError(
            f"{name} returned {type(positions).__name__}; return a Forecast or a numpy array [A, K, {FUTURE}, 2] "
            "float32."
        )
    agents, expected = len(observation), "K" if samples is None else str(samples)
    if positions.ndim != 4 or positions.shape[0] != agents or positions.shape[2:] != (FUTURE, 2):
        hint = " For one sample use positions[:, None]." if positions.shape == (agents, FUTURE, 2) else ""
        raise PredictorError(
            f"{name} returned shape {positions.shape} for {agents} agents, expected ({agents}, {expected}, {FUTURE}, "
            f"2): agents, samples, future steps, x and y.{hint}"
        )
    number = positions.shape[1]
    if number == 0 or (samples is not None and number not in (1, samples)):
        allowed = f"{expected}, or 1 if the predictor is deterministic" if samples != 1 else "1"
        raise PredictorError(f"{name} returned {number} samples and {expected} were asked for: return {allowed}.")
    if positions.dtype.kind != "f":
        raise PredictorError(
            f"{name} returned dtype {positions.dtype}: positions are float32 metres, so return "
            "positions.astype(np.float32)."
        )
    # A copy, since a predictor that keeps its array could change a stored forecast later; cast first, since a value
    # that is finite in float64 may not be in float32.
    with np.errstate(over="ignore"):
        positions = np.array(positions, np.float32)
    if not np.isfinite(positions).all():
        finite = np.isfinite(positions).all(axis=(1, 2, 3))
        row = int(np.flatnonzero(~finite)[0])
        raise PredictorError(
            f"{name} returned NaN or infinite positions for {int((~finite).sum())} of {agents} agents, the first in "
            f"row {row} (agent {observation.agent[row]}): every position must be finite."
        )
    if weights is not None:
        try:
            weights = np.array(weights, np.float32)
        except (TypeError, ValueError):
            raise PredictorError(
                f"{name} returned weights that are no numbers: return float32 {positions.shape[:2]} or None."
            ) from None
        if weights.shape != positions.shape[:2] or not np.isfinite(weights).all() or (weights < 0).any():
            raise PredictorError(
                f"{name} returned weights of shape {weights.shape}: expected {positions.shape[:2]}, finite and not "
                "negative, or None."
            )
    return Forecast(positions, weights)
