"""Specs: how names and parameters are written as text, and read back.

A spec is ``name``, ``name:key=value,key=value``, ``module:Class`` or ``module:Class:key=value``. Text that holds a
comma, or that looks like a number, is quoted: ``module:Class:path='a,b.txt'``.
"""

from __future__ import annotations

import ast
import difflib
import re
import warnings
from collections.abc import Iterable
from numbers import Integral
from typing import Any

from motion_gym.contract import SpecError

_PARAMETER = re.compile(
    r"""\s*([^=,]*)=\s*('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|\([^)]*\)|\[[^\]]*\]|[^,]*)\s*(?:,|$)""", re.DOTALL
)
"""``key=value`` and the comma behind it; a value in quotes, parentheses or brackets may hold commas."""


def suggest(name: str, allowed: Iterable[str]) -> str:
    """Sentence for an unknown name: what was probably meant, and what is allowed."""
    allowed = sorted(allowed)
    lower = {word.lower(): word for word in allowed}
    close = difflib.get_close_matches(name.lower(), lower, n=1)
    meant = f" Did you mean `{lower[close[0]]}`?" if close else ""
    return f"{meant} Known: {', '.join(allowed) if allowed else 'none'}."


def parse_spec(spec: str) -> tuple[str, dict[str, Any]]:
    """Split ``name:key=value,...`` into the name (or ``module:Class``) and its parameters.

    Values are read as Python literals where they are one (``64``, ``0.5``, ``true``, ``'a,b.txt'``), else as text.

    >>> parse_spec("eth:alpha=64,sigma=past")
    ('eth', {'alpha': 64, 'sigma': 'past'})
    >>> parse_spec("my_module:Tracks:path='a,b.txt',columns=(0, 1, 2, 4)")
    ('my_module:Tracks', {'path': 'a,b.txt', 'columns': (0, 1, 2, 4)})

    Raises:
        SpecError: a part that should be ``key=value`` is not, or a key is there twice.
    """
    head, *rest = spec.split(":")
    if rest and "=" not in rest[0]:
        head = f"{head}:{rest.pop(0)}"
    text, at = ":".join(rest), 0
    parameters: dict[str, Any] = {}
    while at < len(text):
        match = _PARAMETER.match(text, at)
        key = match[1].strip() if match else ""
        if match is None or not key.isidentifier():
            raise SpecError(
                f"`{text[at:].split(',')[0]}` in `{spec}` is not a parameter. Write `name:key=value,key=value`, as in "
                "`eth:alpha=64`; quote text that holds a comma, as in path='a,b.txt'."
            )
        if key in parameters:
            raise SpecError(f"`{key}` is twice in `{spec}`: give it once.")
        parameters[key] = _value(match[2].strip())
        at = match.end()
    return head.strip(), parameters


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """The value as an int, if it is a whole number from ``least`` to ``most``; SpecError otherwise."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        span = f"from {least} to {most}" if most < 1000 else f"{least} or more, and at most {most:,}"
        raise SpecError(f"`{name}={value}` must be a whole number, {span}.")
    return int(value)


def format_spec(name: str, parameters: dict[str, Any]) -> str:
    """Write a spec that ``parse_spec`` reads back."""
    return name + (":" if parameters else "") + ",".join(f"{k}={_text(v)}" for k, v in parameters.items())


def _text(value: Any) -> str:
    """A value as ``parse_spec`` reads it back: text that looks like something else is quoted."""
    if isinstance(value, bool):
        return str(value).lower()
    plain = not isinstance(value, str) or (
        _value(value) == value and value == value.strip() and "," not in value and value[:1] not in tuple("'\"([")
    )
    return str(value) if plain else repr(value)


def _value(text: str) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # text with a backslash is no mistake
            return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text
