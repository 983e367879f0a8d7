"""Which scene an episode begins with, and the order of the windows."""

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


def order_of(windows: int, order: str, generator: np.random.Generator) -> np.ndarray:
    """[windows] the numbers of the windows in the order in which an episode plays them."""
    return generator.permutation(windows) if order == "shuffled" else np.arange(windows)


def check_order(order: str) -> str:
    """The order, if it is one of ``ORDERS``; SpecError otherwise."""
    return one_of("order", order, ORDERS)


def first_scene(options: Mapping[str, Any] | None, scenes: int, copies: int | None = None) -> np.ndarray | None:
    """Numbers of the scenes that ``reset(options={"scene": ...})`` chooses; None where it chooses none.

    Args:
        options: Of ``reset``. A warning names those that are not known, as all other environments ignore theirs.
        scenes: Number of scenes to choose from.
        copies: Number of environments of a vector environment, which take one number each, or one for all.

    Returns:
        [copies], or [1] for a single environment.

    Raises:
        SpecError: the number is not one of a scene.
    """
    options = options or {}
    if not isinstance(options, Mapping):
        raise SpecError(f"`options` of reset is a dict, as {{'scene': 3}}, not {type(options).__name__}.")
    for key in options:
        if key not in OPTIONS:
            warnings.warn(f"reset() has no option `{key}`.{suggest(str(key), OPTIONS)}", stacklevel=3)
    chosen = options.get("scene")
    if chosen is None:
        return None
    listed = list(chosen) if copies is not None and isinstance(chosen, (list, tuple, np.ndarray)) else [chosen]
    if copies is not None and len(listed) not in (1, copies):
        raise SpecError(f"`scene` has {len(listed)} numbers: give one, or one for each of the {copies} environments.")
    numbers = [whole_number("scene", number, 0, scenes - 1) for number in listed]
    return np.array(numbers * (copies or 1) if len(numbers) == 1 else numbers)
