"""Keep predictors from remembering one run in the next: the attributes of their classes must not change in a run."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator, Mapping
from typing import Any

from motion_gym.contract import PredictorError
from motion_gym.stepping.snapshot import snapshot

FOREIGN = frozenset({"builtins", "abc", "typing", "collections", "numpy", "torch", "scipy", "enum", "random"})
"""Packages whose classes are not looked at."""


@contextlib.contextmanager
def no_class_memory(predictor: Any, name: str) -> Iterator[None]:
    """Refuse a run in which class attributes of a predictor, or of the objects that it holds, changed.

    ``reset`` cannot forget them, so a second run over the same frames would know the first one. They are put back, also
    after an error, so that a run always begins with the attributes that the classes had before.

    Args:
        predictor: The predictor, as it is before the run.
        name: Its name in the message.

    Raises:
        PredictorError: a class attribute was changed, added or removed.
    """
    before = {kind: {k: snapshot(v) for k, v in _attributes(kind).items()} for kind in _classes(predictor, {})}
    copies = {kind: _copies(_attributes(kind)) for kind in before}
    touched: list[str] = []
    try:
        yield
    finally:
        for kind, held in before.items():
            now = {key: snapshot(value) for key, value in _attributes(kind).items()}
            for key in (key for key in now | held if now.get(key) != held.get(key)):
                touched.append(f"{kind.__name__}.{key}")
                if key not in held:
                    delattr(kind, key)
                elif key in copies[kind]:
                    setattr(kind, key, copies[kind][key])
    if touched:
        raise PredictorError(
            f"{name} remembers in its class: {', '.join(sorted(touched)[:3])} changed during the run, and another run "
            "over the same frames would know it. Keep what is learned in the object (self), where reset() forgets it."
        )


def _classes(value: Any, seen: dict[int, Any]) -> dict[type, None]:
    """The classes of an object and of the objects that it holds, with their bases, in order."""
    if id(value) in seen or isinstance(value, type):
        return {}
    seen[id(value)] = value
    found: dict[type, None] = {}
    if hasattr(value, "__dict__"):
        found |= {kind: None for kind in type(value).__mro__ if kind.__module__.partition(".")[0] not in FOREIGN}
        held = list(vars(value).values())
    elif isinstance(value, Mapping):
        held = list(value.values())
    elif isinstance(value, (list, tuple, set, frozenset)):
        held = list(value)
    else:
        return {}
    for item in held:
        found |= _classes(item, seen)
    return found


def _attributes(kind: type) -> dict[str, Any]:
    """The data among the attributes of a class: no methods, properties or slots."""
    return {
        key: value
        for key, value in vars(kind).items()
        if not key.startswith(("__", "_abc_")) and not callable(value) and not hasattr(type(value), "__get__")
    }


def _copies(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Copies of those attributes that can be copied."""
    copies = {}
    for key, value in attributes.items():
        with contextlib.suppress(Exception):
            copies[key] = copy.deepcopy(value)
    return copies
