"""From the column of frames or times to seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from motion_gym.contract import DataError
from motion_gym.data.tracks.column_names import TIME_UNITS, role_of, time_unit
from motion_gym.data.tracks.dates import microseconds
from motion_gym.data.tracks.number_forms import clock_form, refuse_thousands
from motion_gym.data.tracks.tables import Table

EPOCH = {1: "seconds", 1000: "milliseconds", 10**6: "microseconds", 10**9: "nanoseconds"}
"""Units of a time since 1970, by how many there are in a second."""
NAMES = {
    1.0: "seconds", 1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds", 1 / 60: "minutes", 1 / 3600: "hours",
    1 / 86400: "days",
}  # fmt: skip
"""Units of time by how many are a second."""
UNITS = ("s", "ms", "us", "ns", "min", "h", "d")
TIMES_OF_DAY = "times of the day"
FRACTIONS = "seconds, as they are not whole numbers"
TIME = "seconds, as times with fractions are"
SINCE_1970 = "seconds since 1970"
EPOCH_YEARS = (1990, 2100)
JITTER = 0.025
"""Timestamps that are this share of a step from a regular clock are taken to be regular."""
OWN_RATE = 0.02
"""Timestamps whose mean distance is a step but for this share are taken to be one step apart, whatever their jitter."""
OWN_JITTER = 0.4
"""Share of the step by which distances of such timestamps may differ from whole steps."""


@dataclass(frozen=True, eq=False)
class RawTimes:
    """The values of the column of frames or times.

    Attributes:
        values: [R] int64 or float64, in units of ``1 / per_second`` if that is known.
        per_second: How many of the values are a second, where the column itself says it: 1 for a column of seconds.
        how: What they were taken for, in words.
        unknown: Why the unit is not known and what to say, where ``per_second`` is None.
        said: What says the unit: the name of the column in the header, or dates; empty if it is a guess.
    """

    values: np.ndarray
    per_second: float | None
    how: str
    unknown: str = ""
    said: str = ""


@dataclass(frozen=True, eq=False)
class Clock:
    """When each row was observed.

    Attributes:
        seconds: [R] float64, since the first row of the recording.
        ticks: [R] int64, frames since the first one, on a regular clock; None if timestamps are irregular.
        tick: Seconds per frame; 0 without ticks.
        interval: Usual seconds between consecutive rows of an agent.
        how: How the time was read, in words.
        measured: Whether the rate was measured from timestamps.
    """

    seconds: np.ndarray
    ticks: np.ndarray | None
    tick: float
    interval: float
    how: str
    measured: bool = False


def read_times(table: Table, column: int) -> RawTimes:
    """The values of the column of frames or times of a table.

    Raises:
        DataError: a value is missing or is neither a number nor a date.
    """
    if table.is_dates(column):
        first = str(table.columns[column][0])
        how = "dates and times" if "-" in first or "/" in first else TIMES_OF_DAY
        return RawTimes(microseconds(table, column), 1e6, how, said=f"{table.title(column)} holds {how}")
    role = role_of(table.names[column]) if table.names else None
    refuse_thousands(table, column, counts=role == "frame")
    whole = table.whole_numbers(column)
    values = table.numbers(column) if whole is None else whole
    if whole is None and not np.isfinite(values).all():
        row = int(np.argmin(np.isfinite(values)))
        table.refuse(row, f"{table.title(column)}, the frame or time, is {values[row]}", "Correct or delete the line.")
    name = table.names[column] if table.names else ""
    word = time_unit(name)
    if word in TIME_UNITS:
        per_second = TIME_UNITS[word]
        how = NAMES[per_second]
        return RawTimes(values, per_second, how, said=f"the header says that {table.title(column)} is in {how}")
    if word is not None:
        remedy = f"Give fps, how many of the unit are a second; or write one of {', '.join(UNITS)} in the brackets."
        return RawTimes(values, None, f"times in `{word}`", f"The unit `{word}` in the header is not known. {remedy}")
    form = clock_form(values)
    if form and (whole is None or role == "time"):
        raise DataError(f"{table.path}: {table.title(column)} {form}")
    if form:
        return RawTimes(values, None, "frame numbers", f"{table.title(column)} {form}")
    unit = _epoch_unit(values)
    if unit:
        look = f"look like {EPOCH[unit]} since 1970"
        if unit == 1 and whole is None:
            return RawTimes(values, 1, SINCE_1970)
        return RawTimes(values, None, look, f"They {look}: fps={unit}.")
    if whole is None:
        return RawTimes(values, 1, TIME if role == "time" else FRACTIONS)
    named = "" if role != "time" else (
        " If they are times: fps=1 for seconds, fps=1000 for milliseconds."
    )  # fmt: skip
    return RawTimes(whole, None, "frame numbers", named)


def clock_of(
    raw: RawTimes, agent: np.ndarray, fps: float | None, dt: float | None, step: float, title: str, comments: str = ""
) -> Clock:
    """Seconds, and frames of a regular clock if there is one.

    Args:
        raw: Values of all rows of a recording.
        agent: [R] ids.
        fps: Values per second.
        dt: Seconds between consecutive listed frames of an agent, that is, their most common distance.
        step: Seconds to which tracks will be resampled.
        title: What the file is, for messages.
        comments: What comments of the file say about its rate.

    Raises:
        DataError: the rate is not known.
    """
    values = raw.values - raw.values.min()
    usual = usual_distance(values, agent)
    _refuse_two_rates(raw, usual, fps, dt, title)
    if fps is None and dt is None and raw.per_second is None:
        first = ", ".join(str(v) for v in np.unique(raw.values)[:3])
        whole = "frames are whole numbers" if values.dtype.kind == "i" else "times are numbers without a known unit"
        raise DataError(
            f"{title}: the {whole} ({first}, ...), which do not say how much time they count. Give "
            "fps (frame numbers per second, as fps=25), or dt (seconds between consecutive listed frames, as dt=0.4)."
            f"{' ' + raw.unknown.strip() if raw.unknown else ''}{comments}"
        )
    if dt is not None:
        per_second, how = usual / dt, f"{dt:g} s between consecutive frames, as stated (numbers {usual:g} apart)"
    elif fps is not None:
        per_second, how = float(fps), f"{raw.how}, {fps:g} a second as stated"
    else:
        per_second, how = float(raw.per_second or 1), raw.how
    seconds = values / per_second
    interval = usual / per_second
    if values.dtype.kind == "i" and (fps is not None or dt is not None):
        return Clock(seconds, values, 1 / per_second, interval, how)
    ticks, tick = _regular(seconds, agent, step)
    if ticks is None:
        return Clock(seconds, None, 0.0, interval, f"{how}, irregular", True)
    how = f"{how}, {1 / tick:.5g} frames a second as measured"
    return Clock(seconds, ticks, tick, usual_distance(ticks, agent) * tick, how, True)


def _refuse_two_rates(raw: RawTimes, usual: float, fps: float | None, dt: float | None, title: str) -> None:
    """Raise DataError if ``fps`` or ``dt`` is stated of a column that says its unit itself, and says another one."""
    per_second = raw.per_second
    if per_second is None or not (raw.said or raw.how in (TIME, SINCE_1970)):
        return
    interval = usual / per_second
    other_rate = fps is not None and (fps != per_second if raw.said else fps not in NAMES)
    if other_rate:
        stated = "fps"
    elif dt is not None and abs(dt - interval) > 0.1 * dt:
        stated = "dt"
    else:
        return
    said = raw.said or "the times have fractions and no unit, so that they are in seconds"
    raise DataError(
        f"{title}: {stated}={fps or dt:g} contradicts the file: {said}, and rows of an agent are {interval:.4g} s "
        f"apart. Drop {stated}, or correct the file."
    )


def usual_distance(values: np.ndarray, agent: np.ndarray) -> float:
    """The most common distance of consecutive values of an agent; of all values if no agent has two.

    Distances that are not whole numbers have no most common one: their median is taken.
    """
    order = np.lexsort((values, agent))
    steps = np.diff(values[order])[np.diff(agent[order]) == 0]
    if not len(steps):
        steps = np.diff(np.unique(values))
    if not len(steps):
        return 1.0
    if values.dtype.kind != "i":
        return float(np.median(steps)) or 1.0
    distances, counts = np.unique(steps, return_counts=True)
    return float(distances[counts.argmax()]) or 1.0


def _regular(seconds: np.ndarray, agent: np.ndarray, step: float) -> tuple[np.ndarray | None, float]:
    """Frames of the regular clock that the times follow, and its seconds per frame; None if they follow none."""
    listed, row = np.unique(seconds, return_inverse=True)
    rough = usual_distance(seconds, agent)
    if len(listed) < 2 or rough <= 0:
        return np.zeros(len(seconds), np.int64), step
    distance = np.diff(listed)
    number = np.rint(distance / rough)
    total = np.concatenate([[0], np.cumsum(number)])
    if total[-1] < 1 or not math.isfinite(total[-1]):
        return None, 0.0
    centred = total - total.mean()
    tick = float(centred @ (listed - listed.mean()) / (centred @ centred))
    if tick <= 0:
        return None, 0.0
    off = np.quantile(np.abs(distance - tick * number), 0.99)
    own = abs(tick - step) <= OWN_RATE * step and off <= OWN_JITTER * tick
    if off > JITTER * step and not own:
        return None, 0.0
    return total.astype(np.int64)[row.reshape(-1)], tick


def _epoch_unit(values: np.ndarray) -> int | None:
    """How many of the values are a second, if they are times since 1970."""
    low, high = ((year - 1970) * 365.25 * 86400.0 for year in EPOCH_YEARS)
    middle = float(np.median(values))
    return next((unit for unit in EPOCH if low * unit <= middle <= high * unit), None)
