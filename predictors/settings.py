"""Settings of predictors: fields of their dataclasses, checked, and written as a name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection
from numbers import Real
from typing import Any

from motion_gym.catalog import alias_of, format_spec, suggest, whole_number
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


def number(name: str, value: Any) -> float:
    """The value as a float, if it is a number, 0 or more; SpecError otherwise."""
    if isinstance(value, bool) or not isinstance(value, Real) or not 0 <= float(value) < float("inf"):
        raise SpecError(f"`{name}={value}` must be a number, 0 or more.")
    return float(value)


def positive(name: str, value: Any) -> float:
    """The value as a float, if it is a number above 0; SpecError otherwise."""
    if isinstance(value, bool) or not isinstance(value, Real) or not 0 < float(value) < float("inf"):
        raise SpecError(f"`{name}={value}` must be a number above 0.")
    return float(value)


def any_text(name: str, value: Any) -> str:
    """The value as text."""
    return str(value)


def share(name: str, value: Any) -> float:
    """The value as a float, if it is from 0 to 1; SpecError otherwise."""
    if number(name, value) > 1:
        raise SpecError(f"`{name}={value}` is a share: give a number from 0 to 1.")
    return float(value)


def boolean(name: str, value: Any) -> bool:
    """The value, if it is true or false; SpecError otherwise."""
    if not isinstance(value, bool):
        raise SpecError(f"`{name}={value}` must be true or false.")
    return value


def whole(least: int, most: int) -> Check:
    """Check of whole numbers from ``least`` to ``most``."""
    return lambda name, value: whole_number(name, value, least, most)


def one_of(words: Collection[str]) -> Check:
    """Check of texts that must be one of ``words``."""

    def check(name: str, value: Any) -> str:
        if value not in words:
            raise SpecError(f"There is no `{name}={value}`.{suggest(str(value), words)}")
        return str(value)

    return check


def optional(check: Check) -> Check:
    """A check that lets None pass."""
    return lambda name, value: None if value is None else check(name, value)
