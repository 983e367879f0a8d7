"""Specs: how names and parameters are written as text, and read back.

A spec is ``name``, ``name:key=value,key=value``, ``module:Class`` or ``module:Class:key=value``. Text that holds a
comma, or that looks like a number, is quoted: ``module:Class:path='a,b.txt'``.
"""

from __future__ import annotations

import ast
import copy
import difflib
import functools
import keyword
import math
import os
import re
import warnings
from collections.abc import Collection, Iterable
from numbers import Integral, Real
from typing import Any

from motion_gym.contract import SpecError
from motion_gym.names import ADAPTERS, DOMAINS, PREDICTORS
from motion_gym.own_classes import call_hint

_PARAMETER = re.compile(
    r"""\s*([^=,]*)=\s*('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|\([^)]*\)|\[[^\]]*\]|[^,]*)\s*(?:,|$)""", re.DOTALL
)
"""``key=value`` and the comma behind it; a value in quotes, parentheses or brackets may hold commas."""


def suggest(name: str, allowed: Iterable[str]) -> str:
    """Sentence for an unknown name: the most similar name, and all allowed names."""
    allowed = sorted(allowed)
    close = closest(name, allowed)
    meant = f" Did you mean `{close}`?" if close else ""
    return f"{meant} Known: {', '.join(allowed) if allowed else 'none'}."


def file_hint(name: str) -> str:
    """Sentence for an unknown name that is a file: the spec that reads it as tracks; empty for other names."""
    if not os.path.isfile(os.path.expanduser(name)):
        return ""
    return f" It is a file: write `{format_spec('tracks', {'path': name})}`, with fps=25 or dt=0.4 for frame numbers."


def closest(name: str, allowed: Iterable[str]) -> str | None:
    """The allowed name that is most similar to an unknown one; None if none is similar."""
    lower = {word.lower(): word for word in allowed}
    close = difflib.get_close_matches(name.lower(), lower, n=1)
    return lower[close[0]] if close else None


def parse_spec(spec: str) -> tuple[str, dict[str, Any]]:
    """Split ``name:key=value,...`` into the name (or ``module:Class``) and its parameters.

    Values are read as Python literals where they are one (``64``, ``0.5``, ``true``, ``'a,b.txt'``), else as text.

    >>> parse_spec("eth:alpha=64,sigma=past")
    ('eth', {'alpha': 64, 'sigma': 'past'})
    >>> parse_spec("my_module:Tracks:path='a,b.txt',columns=(0, 1, 2, 4)")
    ('my_module:Tracks', {'path': 'a,b.txt', 'columns': (0, 1, 2, 4)})

    A key that is a keyword of Python stands for the argument with an underscore behind it.

    >>> parse_spec("sdd:class=biker")
    ('sdd', {'class_': 'biker'})

    Raises:
        SpecError: a part that should be ``key=value`` is not, or a key is there twice.
    """
    name, parameters = _parsed(spec)
    # Most values are numbers and text, which nobody can change.
    return name, {k: copy.deepcopy(v) if isinstance(v, (list, dict, set, tuple)) else v for k, v in parameters.items()}


@functools.lru_cache(maxsize=10_000)
def _parsed(spec: str) -> tuple[str, dict[str, Any]]:
    head, *rest = spec.split(":")
    if rest and "=" not in rest[0]:
        head = f"{head}:{rest.pop(0)}"
    text, at = ":".join(rest), 0
    parameters: dict[str, Any] = {}
    while at < len(text):
        match = _PARAMETER.match(text, at)
        key = match[1].strip() if match else ""
        key += "_" * keyword.iskeyword(key)
        if match is None or not key.isidentifier():
            part = text[at:].split(",")[0].strip()
            file = "=" not in part and any(sign in part for sign in "./\\")
            if head.strip() == "tracks" and file and "path" not in parameters:
                with_path = f"{head}:{text[:at]}path={text[at:]}"
                raise SpecError(f"`{part}` in `{spec}` is not a parameter. Write `{with_path}`.")
            if head.strip() not in (*DOMAINS, *PREDICTORS, *ADAPTERS) and (meant := call_hint(spec)):
                raise SpecError(f"`{part}` in `{spec}` is not a parameter. Write `{meant}`.")
            raise SpecError(
                f"`{text[at:].split(',')[0]}` in `{spec}` is not a parameter. Write `name:key=value,key=value`, as in "
                "`eth:alpha=64`; quote text that holds a comma, as in path='a,b.txt', and separate the numbers of one "
                "parameter by spaces, as in split=0.5 0 0.5."
            )
        if key in parameters:
            raise SpecError(f"`{key}` is twice in `{spec}`: give it once.")
        parameters[key] = parse_value(match[2].strip())
        at = match.end()
    return head.strip(), parameters


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """The value as an int, if it is a whole number from ``least`` to ``most``; SpecError otherwise."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        span = f"from {least} to {most}" if most < 1000 else f"{least} or more, and at most {most:,}"
        raise SpecError(f"`{name}={value}` must be a whole number, {span}.")
    return int(value)


def number(
    name: str,
    value: Any,
    least: float = 0.0,
    most: float = math.inf,
    *,
    above: bool = False,
    below: bool = False,
    owner: str = "",
) -> float:
    """The value as a float, if it is a finite number from ``least`` to ``most``; SpecError otherwise.

    Args:
        name: Name of the parameter.
        value: Its value.
        least: Smallest value.
        most: Largest value.
        above: Whether ``least`` itself is refused.
        below: Whether ``most`` itself is refused.
        owner: What has the parameter, for the message, as ``domain `orca```.
    """
    real = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    if not real or not least <= value <= most or (above and value == least) or (below and value == most):
        low = f" above {least:g}" if above else f", {least:g} or more"
        high = "" if most == math.inf else f", and {'below' if below else 'at most'} {most:g}"
        raise SpecError(f"`{name}={value}`{f' of {owner}' if owner else ''} must be a number{low}{high}.")
    return float(value)


def three_shares(split: Any) -> tuple[float, float, float]:
    """Shares of the time for train, val and test, from a text or a sequence; SpecError for others."""
    try:
        shares = [float(share) for share in (split.split() if isinstance(split, str) else split)]
    except (TypeError, ValueError):
        shares = []
    right = len(shares) == 3 and all(0 <= share <= 1 for share in shares) and 0 < sum(shares) <= 1 + 1e-9
    if not right:
        raise SpecError(
            f"split={split!r} must be three shares of the time, for train, val and test, each 0 or more, at most 1 in "
            "all: split='0.6 0.2 0.2', or split='0 0 1' to score all of the file."
        )
    return shares[0], shares[1], shares[2]


def one_of(name: str, value: Any, words: Collection[str], owner: str = "") -> str:
    """The value, if it is one of the words; SpecError otherwise."""
    if not isinstance(value, str) or value not in words:
        raise SpecError(f"`{name}={value}`{f' of {owner}' if owner else ''} is not known.{suggest(str(value), words)}")
    return value


def format_spec(name: str, parameters: dict[str, Any]) -> str:
    """Write a spec that ``parse_spec`` reads back."""
    keys = {key: key[:-1] if keyword.iskeyword(key[:-1]) and key[-1:] == "_" else key for key in parameters}
    return name + (":" if parameters else "") + ",".join(f"{keys[k]}={_text(v)}" for k, v in parameters.items())


def _text(value: Any) -> str:
    """A value as ``parse_spec`` reads it back: text that looks like something else is quoted."""
    if isinstance(value, bool):
        return str(value).lower()
    plain = not isinstance(value, str) or (
        parse_value(value) == value and value == value.strip() and "," not in value and value[:1] not in tuple("'\"([")
    )
    return str(value) if plain else repr(value)


def parse_value(text: str) -> Any:
    """The value of a parameter in a spec: a Python literal, true or false, or else the text itself."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # text with a backslash is no mistake
            return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text
