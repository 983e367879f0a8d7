"""Dates and times of the day to microseconds."""

from __future__ import annotations

import re
import warnings

import numpy as np

from motion_gym.contract import DataError
from motion_gym.data.tracks.tables import Table

_OFFSET = re.compile(r"(?:\s*(?:Z|UTC)|\s*([+-])(\d{2})(?::?(\d{2}))?)$", re.IGNORECASE)
DAY = 86_400_000_000
"""Microseconds of a day."""
MIDNIGHT = 600_000_000
"""Microseconds between the last time of a day and the first time of the next day, at most."""


def microseconds(table: Table, column: int) -> np.ndarray:
    """[R] int64, microseconds, from ISO dates and times; times of the day count from midnight.

    Raises:
        DataError: a date is missing or cannot be read.
    """
    fields = table.columns[column]
    if isinstance(fields, np.ndarray) and fields.dtype.kind == "M":
        missing = np.isnat(fields)
        if missing.any():
            fault = f"{table.title(column)}, the time, is missing"
            table.refuse(int(missing.argmax()), fault, "Correct or delete the row.")
        return fields.astype("datetime64[us]").astype(np.int64)
    texts, offsets = [], []
    for text in table.texts(column):
        shift = 0
        if "-" not in text and "/" not in text:
            text = f"1970-01-01T{text}"
        elif (match := _OFFSET.search(text)) and ":" in text:
            text = text[: match.start()]
            shift = (1 if match[1] == "-" else -1) * 60 * (60 * int(match[2]) + int(match[3] or 0)) if match[1] else 0
        texts.append(text.replace("/", "-").replace(",", ".").replace(" ", "T"))
        offsets.append(shift)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy only warns of time zones that it does not read
        try:
            return np.array(texts, "datetime64[us]").astype(np.int64) + np.array(offsets, np.int64) * 10**6
        except (ValueError, Warning):
            pass
        for row, text in enumerate(texts):
            try:
                np.datetime64(text)
            except (ValueError, Warning) as error:
                fault = f"{table.title(column)} is no date and time ({error})"
                table.refuse(row, fault, "Write it as 2024-05-31T12:00:00.400, with +02:00 for a time zone.")
    raise DataError(f"{table.path}: {table.title(column)} holds dates of several forms: write all alike.")


def past_midnight(times: np.ndarray) -> np.ndarray:
    """Times of the day of a recording that passes midnight, with a day added to those after midnight.

    A recording passes midnight if it has times shortly before and shortly after midnight, and no time during more than
    half a day between them.

    Args:
        times: [R] int64 microseconds since midnight.
    """
    listed = np.unique(times)
    free = np.diff(listed)
    if not len(free) or listed[0] + DAY - listed[-1] > MIDNIGHT or free.max() <= DAY // 2:
        return times
    return np.where(times <= listed[free.argmax()], times + DAY, times)
