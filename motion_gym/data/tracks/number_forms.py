"""Forms of numbers that mean something else than their value: thousands separators, and times of the day as HHMMSS."""

from __future__ import annotations

import re

import numpy as np

from motion_gym.data.tracks.tables import DELIMITERS, MISSING, Table

_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
_BELOW = re.compile(r"[+-]?\d{1,3}")


def refuse_thousands(table: Table, column: int, counts: bool = False) -> None:
    """Raise DataError if the numbers of a column have thousands separators, as 1.010 for 1010.

    A column has them if its numbers are whole up to 999, of which one has three digits, and have three digits after a
    point or comma from there on.

    Args:
        table: The table.
        column: The column.
        counts: Whether the column holds whole numbers, so that three digits after the point in all of them suffice.
    """
    if not table.source or table.format != "text" or not (table.is_numeric(column) and _may_be(table, column)):
        return
    texts = _written(table, column)
    marked = [bool(_THOUSANDS.fullmatch(text)) for text in texts]
    below = [text for text, mark in zip(texts, marked, strict=True) if not mark and text.lower() not in MISSING]
    if not any(marked) or not all(map(_BELOW.fullmatch, below)):
        return
    if not any(len(text.lstrip("+-")) == 3 for text in below) and not (counts and not below):
        return
    row = marked.index(True)
    whole = re.sub("[.,]", "", texts[row])
    remedy = f"Write {whole}, without separator, in the whole column."
    table.refuse(row, f"{table.title(column)} is {texts[row]}, which seems to be {whole} with a separator", remedy)


def clock_form(values: np.ndarray) -> str:
    """What numbers are that seem to be times of the day, HHMMSS; empty if they are not.

    Such numbers have minutes and seconds below 60, and jump by 40 from one minute to the next.
    """
    listed = np.unique(values)
    if not len(listed) or listed[0] < 0 or listed[-1] >= 240_000:
        return ""
    apart = np.diff(listed)
    new_minute = np.diff(listed // 100) > 0
    sixty = (listed % 100 < 60).all() and (listed // 100 % 100 < 60).all()
    jumps = new_minute & (apart > 40) & (apart <= 40 + 2 * np.median(apart)) if len(apart) else new_minute
    if not sixty or not jumps.any() or 2 * jumps.sum() < new_minute.sum():
        return ""
    before, after = (f"{listed[jumps.argmax() + next_one]:.10g}" for next_one in (0, 1))
    return (
        f"seems to hold times of the day as HHMMSS: no number has minutes or seconds of 60 or more, and {before} is "
        f"followed by {after}. Write them as 12:00:59.5, or as seconds in a column named time_s."
    )


def _may_be(table: Table, column: int) -> bool:
    """Whether the numbers of a column allow it, which costs less than to look at the text."""
    values = table.numbers(column)
    values = values[~np.isnan(values)]
    broken = values[values != np.rint(values)]
    if not len(broken) or np.abs(values).max() >= 1000 or np.abs(broken).min() < 1:
        return False
    return bool((np.abs(1000 * broken - np.rint(1000 * broken)) < 1e-6).all())


def _written(table: Table, column: int) -> list[str]:
    """The fields of a column as they are in the file."""
    fields = table.columns[column]
    if not isinstance(fields, np.ndarray):
        return list(fields)
    delimiter = next(mark for mark, word in DELIMITERS.items() if word == table.delimiter)
    lines = table.source.split("\n")
    rows = (lines[number - 1].split(delimiter if delimiter != " " else None) for number in table.lines.tolist())
    return [row[column].strip() for row in rows]
