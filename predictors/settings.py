"""Settings of predictors: checked dataclass fields that are part of the predictor's name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

from motion_gym import specs
from motion_gym.catalog import alias_of, format_spec
from motion_gym.contract import SpecError

Check = Callable[[str, Any], Any]
"""Takes the name and the value of a setting; returns the value to store, or raises SpecError."""


def setting(default: Any, check: Check) -> Any:
    """A dataclass field that is part of a predictor's name."""
    return dataclasses.field(default=default, metadata={"check": check})


def check_settings(predictor: Any) -> None:
    """Replace each setting by its checked value; SpecError if a value is not allowed."""
    for field in dataclasses.fields(predictor):
        if "check" in field.metadata:
            setattr(predictor, field.name, field.metadata["check"](field.name, getattr(predictor, field.name)))


def name_of_settings(predictor: Any, **first: Any) -> str:
    """Spec of a predictor: its ``kind`` or an alias, with the settings that differ from the defaults.

    Args:
        predictor: A dataclass with ``kind``.
        **first: Parameters to list before the settings.
    """
    changed = dict(first)
    for field in dataclasses.fields(predictor):
        value = getattr(predictor, field.name, field.default)
        if "check" in field.metadata and value != field.default:
            changed[field.name] = value
    name, parameters = alias_of(predictor.kind, changed)
    integers = {key: int(value) for key, value in parameters.items() if isinstance(value, float) and value.is_integer()}
    return format_spec(name, {**parameters, **integers})


positive: Check = partial(specs.number, above=True)
"""Checks numbers above 0."""
share: Check = partial(specs.number, most=1)
"""Checks numbers from 0 to 1."""


def any_text(name: str, value: Any) -> str:
    """The value as text."""
    return str(value)


def boolean(name: str, value: Any) -> bool:
    """The value if it is true or false; SpecError otherwise."""
    if not isinstance(value, bool):
        raise SpecError(f"`{name}={value}` must be true or false.")
    return value


def whole(least: int, most: int) -> Check:
    """Checks whole numbers from ``least`` to ``most``."""
    return partial(specs.whole_number, least=least, most=most)


def one_of(words: Collection[str]) -> Check:
    """Checks that a text is one of ``words``."""
    return partial(specs.one_of, words=words)


def optional(check: Check) -> Check:
    """The same check, but None is allowed."""
    return lambda name, value: None if value is None else check(name, value)
