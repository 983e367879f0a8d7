"""What the definition of a benchmark must be, so that a mistake of a user is told where the benchmark is defined."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from motion_gym.contract import SpecError
from motion_gym.scoring.evaluation import PROTOCOLS
from motion_gym.specs import one_of, suggest, whole_number

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
    _check_no_repeats(f"rows {where}", (*part.plain, *part.trained))
    for name in ("pooled", "shots"):
        _check_mapping(f"`{name}` {where}", getattr(part, name), "columns")
    for name, spec in part.domains.items():
        if isinstance(spec, (int, float)) or not isinstance(name, str):
            raise SpecError(f"The column {name!r} {where} is {spec!r}: write it as 'd = 0.3': 'orca:d=0.3'.")
    one_of("protocol", part.protocol, PROTOCOLS, f"the part `{part.title}`")
    whole_number("samples", part.samples, 1, 10_000)
    for name, columns in part.pooled.items():
        _check_sequence(f"The columns of `{name}` in `pooled` {where}", columns, "columns")
    for count in part.shots.values():
        whole_number("shots", count, 0, 10**9)
    for column in (*itertools.chain(*part.pooled.values()), *part.shots):
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
    _check_sequence(f"`drives` {where}", benchmark.drives, "Drives objects")
    _check_mapping(f"`shifts` {where}", benchmark.shifts, "Shifts objects")
    if not any((benchmark.parts, benchmark.shifts, benchmark.studies, benchmark.drives)):
        raise SpecError(f"The benchmark `{benchmark.name}` is empty: give it parts.")
    _check_no_repeats(f"titles of parts {where}", [part.title for part in benchmark.parts])


def _check_sequence(name: str, value: Any, of: str) -> None:
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        shown = "(...)" if isinstance(value, Iterable) and not isinstance(value, str | bytes) else f"({value!r},)"
        raise SpecError(f"{name} must be a sequence of {of}, as {shown}, with the comma, and is {value!r}.")


def _check_mapping(name: str, value: Any, of: str) -> None:
    if not isinstance(value, Mapping):
        raise SpecError(f"{name} must map names to {of}, as {{'name': ...}}, and is {value!r}.")


def _check_no_repeats(name: str, values: Sequence[Any]) -> None:
    repeated = next((value for number, value in enumerate(values) if value in values[:number]), None)
    if repeated is not None:
        raise SpecError(f"`{repeated}` is twice among the {name}: give it once.")
