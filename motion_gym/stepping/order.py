"""The order in which an episode plays the windows, and the scene that it begins with."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from motion_gym.contract import SpecError
from motion_gym.specs import one_of, suggest, whole_number

ORDERS: Mapping[str, str] = {
    "published": "the order of time, whatever the seed: a full episode is the published test set",
    "shuffled": "an order that each reset draws anew; the seed of a reset determines it and all later ones",
}
OPTIONS = ("scene",)
"""Options of ``reset``."""


def check_order(order: str) -> str:
    """The order, if it is one of ``ORDERS``; SpecError otherwise."""
    return one_of("order", order, ORDERS)


def order_of(windows: int, order: str, generator: np.random.Generator, first: int | None = None) -> np.ndarray:
    """Numbers of the windows in the order in which an episode plays them.

    Args:
        windows: Number of windows.
        order: One of ``ORDERS``.
        generator: Source of a shuffled order.
        first: Window that the episode begins with: those that come before it in the order are left out.
    """
    numbers = generator.permutation(windows) if order == "shuffled" else np.arange(windows)
    return numbers if first is None else numbers[int(np.flatnonzero(numbers == first)[0]) :]


def first_scene(options: Mapping[str, Any] | None, scenes: int) -> int | None:
    """Number of the scene that ``reset(options={"scene": n})`` begins with; None where it names none.

    Other options are ignored with a warning.

    Raises:
        SpecError: there is no such scene.
    """
    chosen = _chosen(options)
    return None if chosen is None else whole_number("scene", chosen, 0, scenes - 1)


def first_scenes(options: Mapping[str, Any] | None, scenes: int, copies: int) -> np.ndarray | None:
    """[copies] numbers of the scenes of a vector environment; ``options`` names one for all, or one for each.

    Raises:
        SpecError: there is no such scene, there are not as many numbers as copies, or a mask chooses the copies.
    """
    if isinstance(options, Mapping) and "reset_mask" in options:
        raise SpecError(
            "`reset_mask` is not known here: each environment that has ended is reset by the next step, and reset() "
            "resets all of them. Leave it out."
        )
    chosen = _chosen(options)
    if chosen is None:
        return None
    listed = list(chosen) if isinstance(chosen, (list, tuple, np.ndarray)) else [chosen] * copies
    if len(listed) != copies:
        raise SpecError(f"`scene` has {len(listed)} numbers: give one, or one for each of the {copies} environments.")
    return np.array([whole_number("scene", number, 0, scenes - 1) for number in listed])


def _chosen(options: Mapping[str, Any] | None) -> Any:
    options = {} if options is None else options
    if not isinstance(options, Mapping):
        raise SpecError(f"`options` of reset is a dict, as {{'scene': 3}}, not {type(options).__name__}.")
    for key in options:
        if key not in OPTIONS:
            warnings.warn(f"reset() has no option `{key}`.{suggest(str(key), OPTIONS)}", stacklevel=4)
    return options.get("scene")
