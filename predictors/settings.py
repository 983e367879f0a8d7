"""Checks of settings that are numbers."""

from __future__ import annotations

from numbers import Real

from motion_gym.contract import SpecError


def number(name: str, value: float) -> float:
    """The value as a float, if it is a number, 0 or more; SpecError otherwise."""
    if isinstance(value, bool) or not isinstance(value, Real) or not 0 <= value < float("inf"):
        raise SpecError(f"`{name}={value}` must be a number, 0 or more.")
    return float(value)


def positive(name: str, value: float) -> float:
    """The value as a float, if it is a number above 0; SpecError otherwise."""
    if isinstance(value, bool) or not isinstance(value, Real) or not 0 < value < float("inf"):
        raise SpecError(f"`{name}={value}` must be a number above 0.")
    return float(value)
