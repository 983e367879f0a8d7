"""What the definition of a benchmark must be, so that a mistake of a user is told where the benchmark is defined."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from motion_gym.contract import SpecError
from motion_gym.scoring.evaluation import PROTOCOLS
from motion_gym.specs import one_of, suggest

NAME = re.compile(r"[a-z0-9][a-z0-9_-]*", re.IGNORECASE)
"""Name of a benchmark, which is also the name of a folder."""


def check_part(part: Any) -> None:
    """Raise SpecError if a ``Part`` has fields of another type, or names a column that it does not have."""
    where = f"of the part `{part.title}`"
    if not isinstance(part.domains, Mapping) or not part.domains:
        raise SpecError(
            f"`domains` {where} must map the name of each column to a spec, as {{'d = 0.3': 'orca:d=0.3'}}, and is "
            f"{part.domains!r}."
        )
    for name in ("plain", "trained", "external"):
        _check_sequence(f"`{name}` {where}", getattr(part, name), "rows")
    one_of("protocol", part.protocol, PROTOCOLS, f"the part `{part.title}`")
    pooled = [column for columns in part.pooled.values() for column in columns]
    for column in (*pooled, *part.shots):
        if column not in part.domains:
            raise SpecError(f"There is no column `{column}` {where}.{suggest(column, part.domains)}")


def check_benchmark(benchmark: Any, kinds: Mapping[str, type]) -> None:
    """Raise SpecError if a ``Benchmark`` is empty, its name is no name of a folder, or two of its parts share a title.

    Args:
        benchmark: The benchmark.
        kinds: Class of the members of its sequences, by field.
    """
    if not isinstance(benchmark.name, str) or not NAME.fullmatch(benchmark.name):
        raise SpecError(
            f"The name `{benchmark.name}` of a benchmark is also that of a folder: use letters, digits, _ and -."
        )
    where = f"of the benchmark `{benchmark.name}`"
    for field, kind in kinds.items():
        members = getattr(benchmark, field)
        _check_sequence(f"`{field}` {where}", members, f"{kind.__name__} objects")
        if other := next((member for member in members if not isinstance(member, kind)), None):
            raise SpecError(f"`{field}` {where} has a {type(other).__name__}: make it a {kind.__name__}.")
    if not any((benchmark.parts, benchmark.shifts, benchmark.studies, benchmark.drives)):
        raise SpecError(f"The benchmark `{benchmark.name}` is empty: give it parts.")
    titles = [part.title for part in benchmark.parts]
    if len(set(titles)) < len(titles):
        raise SpecError(f"Two parts {where} have the same title: give each its own.")


def _check_sequence(name: str, value: Any, of: str) -> None:
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise SpecError(f"{name} must be a sequence of {of}, as ({value!r},), with the comma.")
