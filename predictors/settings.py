"""Settings of predictors: fields of their dataclasses, checked, and written as a name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

from motion_gym import specs
from motion_gym.catalog import alias_of, format_spec
from motion_gym.contract import SpecError

Check = Callable[[str, Any], Any]
"""Takes the name and the value of a setting; returns the value as it is kept, or raises SpecError."""


def setting(default: Any, check: Check) -> Any:
    """A field of a dataclass that is part of a predictor's name."""
    return dataclasses.field(default=default, metadata={"check": check})


def check_settings(predictor: Any) -> None:
    """Replace each setting by its checked value; SpecError where one is not allowed."""
    for field in dataclasses.fields(predictor):
        if "check" in field.metadata:
            setattr(predictor, field.name, field.metadata["check"](field.name, getattr(predictor, field.name)))


def name_of_settings(predictor: Any, **first: Any) -> str:
    """Spec of a predictor: its ``kind``, or an alias of it, with the settings that are not at their defaults.

    Args:
        predictor: A dataclass with ``kind``.
        **first: Parameters that come before the settings.
    """
    fields = [field for field in dataclasses.fields(predictor) if "check" in field.metadata]
    values = {field.name: getattr(predictor, field.name) for field in fields}
    changed = {**first, **{field.name: values[field.name] for field in fields if values[field.name] != field.default}}
    name, rest = alias_of(predictor.kind, changed)
    whole = {key: int(value) for key, value in rest.items() if isinstance(value, float) and value.is_integer()}
    return format_spec(name, {**rest, **whole})


number = specs.number
"""Check of numbers, 0 or more."""
positive: Check = partial(specs.number, above=True)
"""Check of numbers above 0."""
share: Check = partial(specs.number, most=1)
"""Check of numbers from 0 to 1."""


def any_text(name: str, value: Any) -> str:
    """The value as text."""
    return str(value)


def boolean(name: str, value: Any) -> bool:
    """The value, if it is true or false; SpecError otherwise."""
    if not isinstance(value, bool):
        raise SpecError(f"`{name}={value}` must be true or false.")
    return value


def whole(least: int, most: int) -> Check:
    """Check of whole numbers from ``least`` to ``most``."""
    return partial(specs.whole_number, least=least, most=most)


def one_of(words: Collection[str]) -> Check:
    """Check of texts that must be one of ``words``."""
    return partial(specs.one_of, words=words)


def optional(check: Check) -> Check:
    """A check that lets None pass."""
    return lambda name, value: None if value is None else check(name, value)
