"""The observation space of one agent or of a window, finite on request."""

from __future__ import annotations

import gymnasium
import numpy as np

from motion_gym.contract import SpecError
from motion_gym.specs import number


def history_space(shape: tuple[int, ...], bound: float | None, largest: float, place: str) -> gymnasium.spaces.Box:
    """``Box(*shape)``, float32, unbounded, or from ``-bound`` to ``bound``.

    Args:
        shape: Shape of an observation.
        bound: Bound of every value of a history; None for an unbounded space.
        largest: Largest absolute value of the histories that will be observed.
        place: Name of the domain, for messages.

    Raises:
        SpecError: the bound is no positive number, or a history goes beyond it.
    """
    if bound is None:
        return gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
    bound = number("observation_bound", bound, above=True)
    if largest > bound:
        raise SpecError(
            f"`observation_bound={bound:g}` is too small: observations of `{place}` reach {largest:.6g}. Give a larger "
            "bound."
        )
    return gymnasium.spaces.Box(-bound, bound, shape, np.float32)
