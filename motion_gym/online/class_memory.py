"""Detect predictors that remember one run in the next: attributes of their classes must not change during a run."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator, Mapping
from typing import Any

from motion_gym.contract import PredictorError
from motion_gym.stepping.snapshot import snapshot

FOREIGN = frozenset({"builtins", "abc", "typing", "collections", "numpy", "torch", "scipy", "enum", "random"})
"""Packages whose classes are not checked."""


@contextlib.contextmanager
def no_class_memory(predictor: Any, name: str) -> Iterator[None]:
    """Refuse a run that changes class attributes of a predictor, or of the objects that it holds.

    ``reset`` does not restore class attributes, so a second run over the same frames would know the first one. The
    attributes are restored after the run, also after an error.

    Args:
        predictor: The predictor before the run.
        name: Name of the predictor, for the message.

    Raises:
        PredictorError: A class attribute was changed, added or removed.
    """
    before = {kind: {key: (snapshot(v), _copied(v)) for key, v in _data(kind).items()} for kind in _classes(predictor)}
    touched: list[str] = []
    try:
        yield
    finally:
        for kind, attributes in before.items():
            now = {key: snapshot(value) for key, value in _data(kind).items()}
            for key in now | attributes:
                content, value = attributes.get(key, (None, None))
                if now.get(key) == content:
                    continue
                touched.append(f"{kind.__name__}.{key}")
                if content is None:
                    delattr(kind, key)
                else:
                    setattr(kind, key, value)
    if touched:
        raise PredictorError(
            f"{name} remembers in its class: {', '.join(sorted(touched)[:3])} changed during the run, and another run "
            "over the same frames would know it. Keep what is learned in the object (self), where reset() forgets it."
        )


def _classes(predictor: Any) -> list[type]:
    """The classes of an object and of the objects that it holds, with their bases."""
    classes: dict[type, None] = {}
    seen: dict[int, Any] = {}
    stack = [predictor]
    while stack:
        value = stack.pop()
        if id(value) in seen or isinstance(value, type):
            continue
        seen[id(value)] = value
        if hasattr(value, "__dict__"):
            classes |= {kind: None for kind in type(value).__mro__ if kind.__module__.partition(".")[0] not in FOREIGN}
            value = vars(value)
        if isinstance(value, Mapping):
            stack += value.values()
        elif isinstance(value, (list, tuple, set, frozenset)):
            stack += value
    return list(classes)


def _data(kind: type) -> dict[str, Any]:
    """The attributes of a class that are data: no methods, properties or slots."""
    return {
        key: value
        for key, value in vars(kind).items()
        if not key.startswith(("__", "_abc_")) and not callable(value) and not hasattr(type(value), "__get__")
    }


def _copied(value: Any) -> Any:
    """A copy, or the value itself if it cannot be copied."""
    try:
        return copy.deepcopy(value)
    except Exception:
        return value
