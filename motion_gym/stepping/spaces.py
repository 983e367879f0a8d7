"""Spaces of observations and actions, and what an action that is given stands for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from motion_gym.contract import FUTURE, ActionError, SpecError
from motion_gym.specs import number, one_of

ACTIONS = ("position", "displacement")
BOUND = 1e7
"""Bounds of the space of positions, in the unit of the domain: finite, since many learning libraries refuse unbounded
spaces, and far wider than any recording. An action beyond them is accepted."""
DISPLACEMENT_LIMIT = 1.0
"""Metres per step: 2.5 m/s in steps of 0.4 s."""


@dataclass(frozen=True)
class Actions:
    """What the actions of an environment stand for.

    ``position``: the 12 future positions, in the frame of the observation; bounded by ``BOUND``, not enforced.
    ``displacement``: 12 consecutive displacements of each agent, scaled to [-1, 1]: the position at step n is the last
    observed position plus ``limit`` times the sum of the first n displacements. Values beyond [-1, 1] are clipped.

    Args:
        kind: One of ``ACTIONS``.
        limit: Largest displacement along x and along y in one step, in the unit of the domain; 1 m by default.
        unit: Unit of the domain.

    Raises:
        SpecError: the kind is not known, or the limit is no positive number, has no use, or is needed.
    """

    kind: str = "position"
    limit: float | None = None
    unit: str = "m"

    def __post_init__(self) -> None:
        one_of("action", self.kind, ACTIONS)
        if self.limit is not None:
            number("displacement_limit", self.limit, 0, BOUND, above=True)
        if self.kind == "position" and self.limit is not None:
            raise SpecError(
                f"`displacement_limit={self.limit}` has no effect on positions: add action='displacement', or leave "
                "it out."
            )
        if self.kind == "displacement" and self.limit is None:
            if self.unit != "m":
                raise SpecError(
                    f"action='displacement' needs `displacement_limit`, the largest displacement in one step, in "
                    f"{self.unit}: the default of {DISPLACEMENT_LIMIT:g} is in metres."
                )
            object.__setattr__(self, "limit", DISPLACEMENT_LIMIT)

    def space(self, *shape: int) -> gymnasium.spaces.Box:
        """``Box(*shape, 12, 2)``, float32, bounded."""
        bound = BOUND if self.limit is None else 1.0
        return gymnasium.spaces.Box(-bound, bound, (*shape, FUTURE, 2), np.float32)

    def positions(self, action: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Forecast positions [..., K, 12, 2] float32 from actions of that shape; NaN where an action is not finite.

        Args:
            action: What ``checked_action`` gave.
            last: [..., 2] last observed positions of the agents.
        """
        if self.limit is None:
            return action
        with np.errstate(invalid="ignore"):
            scaled = np.where(np.isfinite(action), np.clip(action, -1, 1), np.nan) * np.float64(self.limit)
            return (last[..., None, None, :] + scaled.cumsum(axis=-2)).astype(np.float32)


def checked_action(action: Any, shape: tuple[int, ...], name: str, one_sample: bool = False) -> np.ndarray:
    """An action as a float32 array of a shape; float64 is cast.

    Args:
        action: What an environment was given.
        shape: The shape it must have: samples, 12 steps, 2, perhaps behind further axes.
        name: The action in messages.
        one_sample: With K = 1, let the axis of samples be left out.

    Raises:
        ActionError: it is something else.
    """
    masked = isinstance(action, np.ma.MaskedArray)
    if not isinstance(action, np.ndarray) or masked or action.dtype.char not in "fd":
        plain = isinstance(action, np.ndarray) and not masked
        kind = f"dtype {action.dtype}" if plain else f"type {type(action).__name__}"
        raise ActionError(f"{name} has {kind}, not a float32 array: use numpy.asarray(action, dtype=numpy.float32).")
    if action.shape != shape and not (one_sample and shape[0] == 1 and action.shape == shape[1:]):
        raise ActionError(
            f"{name} has shape {action.shape}, expected {shape}; the last three axes are K samples, {FUTURE} future "
            "steps, and x and y."
        )
    if action.dtype.char == "d":
        with np.errstate(over="ignore"):  # values beyond float32 become infinite, and the environment refuses these
            action = action.astype(np.float32)
    return action if action.shape == shape else action.reshape(shape)


def history_space(shape: tuple[int, ...], bound: float | None, reach: float, place: str) -> gymnasium.spaces.Box:
    """``Box(*shape)``, float32, unbounded, or from ``-bound`` to ``bound``.

    Args:
        shape: Shape of an observation.
        bound: Bound of every value of a history; None for an unbounded space.
        reach: Largest absolute value of the histories that will be observed.
        place: Name of the domain, for messages.

    Raises:
        SpecError: the bound is no positive number, or a history goes beyond it.
    """
    if bound is None:
        return gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
    bound = number("observation_bound", bound, above=True)
    if reach > bound:
        raise SpecError(
            f"`observation_bound={bound:g}` is too small: observations of `{place}` reach {reach:.6g}. Give a larger "
            "bound."
        )
    return gymnasium.spaces.Box(-bound, bound, shape, np.float32)
