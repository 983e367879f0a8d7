"""Actions of the environments: their space and their check."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from motion_gym.contract import FUTURE, ActionError

BOUND = 1e7
"""Bounds of the action spaces, in metres: finite, since many learning libraries refuse unbounded spaces, and far wider
than any recording. Actions beyond the bounds are accepted."""


def action_space(*shape: int) -> gymnasium.spaces.Box:
    """``Box(*shape, 12, 2)``, float32, bounded by ``BOUND``."""
    return gymnasium.spaces.Box(-BOUND, BOUND, (*shape, FUTURE, 2), np.float32)


def checked_action(action: Any, shape: tuple[int, ...], name: str, one_sample: bool = False) -> np.ndarray:
    """An action as a float32 array of a shape; float64 is cast.

    Args:
        action: The action.
        shape: Expected shape: samples, 12 steps, 2, perhaps after further axes.
        name: Name of the action in messages.
        one_sample: Whether the axis of samples may be missing if K = 1.

    Raises:
        ActionError: The action has another type or shape.
    """
    if not isinstance(action, np.ndarray) or action.dtype.char not in "fd":
        kind = f"dtype {action.dtype}" if isinstance(action, np.ndarray) else f"type {type(action).__name__}"
        raise ActionError(f"{name} has {kind}, not a float32 array: use numpy.asarray(action, dtype=numpy.float32).")
    if action.shape != shape and not (one_sample and shape[0] == 1 and action.shape == shape[1:]):
        raise ActionError(
            f"{name} has shape {action.shape}, expected {shape}; the last three axes are K samples, {FUTURE} future "
            "steps, and x and y in metres."
        )
    if action.dtype.char == "d":
        with np.errstate(over="ignore"):  # values beyond float32 become infinite, which the environment refuses
            action = action.astype(np.float32)
    return action if action.shape == shape else action.reshape(shape)
