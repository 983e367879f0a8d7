"""Files of tracks to recordings: which files, columns, time and unit, and what was understood of them."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.contract import EXACT, DataError, Recording, SpecError
from motion_gym.data.tracks.column_names import role_of
from motion_gym.data.tracks.dates import past_midnight
from motion_gym.data.tracks.frame_times import TIMES_OF_DAY, Clock, RawTimes, clock_of, read_times, usual_distance
from motion_gym.data.tracks.number_forms import refuse_thousands
from motion_gym.data.tracks.resampling import Resampled, resample
from motion_gym.data.tracks.swapped_columns import swap_evidence
from motion_gym.data.tracks.table_files import read_table
from motion_gym.data.tracks.tables import Table
from motion_gym.data.tracks.track_columns import Columns, find_columns, length_unit, parse_columns
from motion_gym.specs import number, one_of

METRES: Mapping[str, float] = {
    "m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048, "in": 0.0254, "yd": 0.9144, "px": 1.0
}  # fmt: skip
"""Metres of each unit; pixels stay pixels, unless a scale says how many metres they are."""
RANGES = {"fps": (1e-4, 1e9), "dt": (1e-9, 1e4), "scale": (1e-9, 1e6), "step": (1e-3, 3600), "gap": (0, 1e4)}
"""Smallest and largest values of the numbers that say how a file is read: frames may be counted in nanoseconds."""
_RATE = re.compile(r"(?:frame[ _]?rate|fps|hz)", re.IGNORECASE)


@dataclass(frozen=True)
class Reading:
    """How files of tracks are to be read; the keywords of the domain ``tracks``.

    ``columns`` becomes a tuple of names and numbers, or stays None.

    Raises:
        SpecError: a value is not allowed.
    """

    columns: Any = None
    fps: float | None = None
    dt: float | None = None
    unit: str = "m"
    scale: float | None = None
    step: float = 0.4
    gap: float | None = None

    def __post_init__(self) -> None:
        owner = "domain `tracks`"
        for name, (least, most) in RANGES.items():
            if getattr(self, name) is not None:
                number(name, getattr(self, name), least, most, owner=owner)
        if self.fps is not None and self.dt is not None:
            raise SpecError(
                f"`fps={self.fps}` and `dt={self.dt}` of {owner} say the same thing: give fps (frame numbers per "
                "second) or dt (seconds between consecutive listed frames)."
            )
        one_of("unit", self.unit, METRES, owner)
        if self.columns is not None:
            object.__setattr__(self, "columns", parse_columns(self.columns))

    @property
    def domain_unit(self) -> str:
        """Unit of the positions: metres, or pixels without a scale."""
        return "px" if self.unit == "px" and self.scale is None else "m"

    @property
    def factor(self) -> float:
        """What positions of the file are multiplied by."""
        return (1.0 if self.scale is None else self.scale) * METRES[self.unit]


@dataclass(frozen=True, eq=False)
class TrackFile:
    """One recording as it was read: what was understood, the rows of the file, and the resampled tracks.

    Attributes:
        recording: Tracks at the step, in the unit of the domain; frames are numbers of steps.
        tables: The files it was read from.
        columns: Where the values are in the first of them.
        clock: When each row was.
        agent: [R] int64, id of each row that has a position.
        names: The ids as in the file, by the numbers of ``agent``.
        xy: [R, 2] float64, positions in the unit of the domain.
        resampled: How rows became steps.
        dropped: Rows without a position.
        reading: How it was read.
        lines: [R] int64, line of each row.
        swapped: Why frame and id seem to be swapped; empty if nothing speaks for it.
        frames: [R] the values of the column of frames or times.
        places: Where the values are in each of the files.
    """

    recording: Recording
    tables: Sequence[Table]
    columns: Columns
    clock: Clock
    agent: np.ndarray
    names: np.ndarray
    xy: np.ndarray
    resampled: Resampled
    dropped: int
    reading: Reading
    lines: np.ndarray
    swapped: str
    frames: np.ndarray
    places: Sequence[Columns]


def find_files(path: Any) -> list[Path]:
    """The file of a path, or the files of a pattern (``*``, ``?``, ``[...]``), in order of their names.

    Raises:
        DataError: there is no such file, or no file of the pattern.
        SpecError: ``path`` is no text.
    """
    if not isinstance(path, (str, os.PathLike)) or not os.fspath(path):
        raise SpecError(
            f"path={path!r} is not text: give the name of a file, and quote it in a spec where it looks like a number, "
            "as in \"tracks:path='2024'\"."
        )
    text = os.path.expanduser(os.fspath(path))
    if Path(text).exists() or not glob.has_magic(text):
        return [Path(text)]
    files = sorted(Path(name) for name in glob.glob(text, recursive=True) if Path(name).is_file())
    if not files:
        raise DataError(f"there is no file of the pattern {text}. Check the folder and the pattern.")
    return files


def read_track_files(path: Any, reading: Reading) -> list[TrackFile]:
    """Read the recordings of a file or a pattern.

    Files of one person each that lie in one folder are one recording; files of several people are a recording each.

    Raises:
        DataError: a file cannot be read as tracks.
        SpecError: a keyword does not fit the files.
    """
    parts = [_Part.of(name, reading) for name in find_files(path)]
    groups: dict[Any, list[_Part]] = {}
    alone = len(parts) > 1 and all(part.people == 1 for part in parts)
    for position, part in enumerate(parts):
        groups.setdefault(part.table.path.parent if alone else position, []).append(part)
    return [_recording(group, reading) for group in groups.values()]


@dataclass(frozen=True, eq=False)
class _Part:
    """The rows of one file that have a position."""

    table: Table
    columns: Columns
    times: RawTimes
    agent: np.ndarray
    names: np.ndarray
    xy: np.ndarray
    lines: np.ndarray
    dropped: int

    @property
    def people(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, path: Path, reading: Reading) -> _Part:
        table = read_table(path)
        timed = reading.fps is not None or reading.dt is not None
        columns = find_columns(table, reading.columns, timed)
        units = [length_unit(table, column) for column in (columns.x, columns.y)]
        if None not in units and units[0] != units[1]:
            raise DataError(
                f"{path}: the header says that {table.title(columns.x)} is in {units[0]} and {table.title(columns.y)} "
                f"in {units[1]}: write both in one unit."
            )
        for column in (columns.x, columns.y):
            refuse_thousands(table, column)
        xy = np.column_stack([table.numbers(columns.x), table.numbers(columns.y)])
        if np.isinf(xy).any():
            row = int(np.isinf(xy).any(axis=1).argmax())
            table.refuse(row, "the position is infinite", "Correct or delete the line.")
        there = ~np.isnan(xy).any(axis=1)
        if not there.any():
            raise DataError(
                f"{path} has {len(table)} rows, and none of them has a position in {table.title(columns.x)} and "
                f"{table.title(columns.y)}. Say with `columns` where they are."
            )
        times = read_times(table, columns.time)
        codes, names = _identities(table, columns)
        agent = codes[there]
        used, agent = np.unique(agent, return_inverse=True)
        values = RawTimes(times.values[there], times.per_second, times.how, times.unknown, times.said)
        dropped = int((~there).sum())
        return cls(table, columns, values, agent.reshape(-1), names[used], xy[there], np.flatnonzero(there), dropped)


def _identities(table: Table, columns: Columns) -> tuple[np.ndarray, np.ndarray]:
    """[R] int64, a number for each id, in order; and the ids."""
    if columns.agent is None:
        return np.zeros(len(table), np.int64), np.array([table.path.stem])
    whole = table.whole_numbers(columns.agent)
    if whole is None:
        texts = table.texts(columns.agent)
        empty = next((row for row, text in enumerate(texts) if not text), None)
        if empty is not None:
            table.refuse(empty, f"{table.title(columns.agent)}, the id, is empty", "Give the row an id, or delete it.")
        if not columns.stated and table.is_numeric(columns.agent):
            values = table.numbers(columns.agent)
            fraction = values != np.rint(values)
            if fraction.any():
                row = int(fraction.argmax())
                table.refuse(
                    row,
                    f"{table.title(columns.agent)}, the id, is {texts[row]}, not a whole number",
                    "If it is the time, say so with `columns`, as columns='id time x y' or columns='1 0 2 3'.",
                )
        whole = np.array(texts)
    elif not isinstance(table.columns[columns.agent], np.ndarray):
        _refuse_two_spellings(table, columns.agent, whole)
    names, codes = np.unique(whole, return_inverse=True)
    return codes.reshape(-1), names


def _refuse_two_spellings(table: Table, column: int, whole: np.ndarray) -> None:
    """Raise DataError if two ids differ as text and are the same number, as 1 and 01: they may be two people."""
    texts = table.texts(column)
    spelled = dict(zip(whole.tolist(), texts, strict=True))
    row = next((row for row, (n, text) in enumerate(zip(whole.tolist(), texts, strict=True)) if spelled[n] != text), -1)
    if row >= 0:
        table.refuse(
            row,
            f"{table.title(column)}, the id, is {texts[row]!r} here and {spelled[int(whole[row])]!r} elsewhere, which "
            "are the same number",
            "Write the id of a person in one form in all rows, and those of other people as other numbers or words.",
        )


def _recording(parts: Sequence[_Part], reading: Reading) -> TrackFile:
    first = parts[0]
    title = str(first.table.path) if len(parts) == 1 else f"{first.table.path} and {len(parts) - 1} more"
    kinds = {part.times.how for part in parts}
    if len({(part.times.per_second, part.times.values.dtype.kind) for part in parts}) > 1:
        raise DataError(f"{title}: the files count time differently ({'; '.join(sorted(kinds))}): read each by itself.")
    shift = np.cumsum([0] + [part.people for part in parts])
    agent = np.concatenate([part.agent + s for part, s in zip(parts, shift, strict=False)])
    names = np.concatenate([part.names for part in parts])
    if len(parts) > 1:
        names = np.array([f"{part.table.path.name}" for part in parts for _ in part.names])
    xy = np.concatenate([part.xy for part in parts])
    lines = np.concatenate([part.table.lines[part.lines] for part in parts])
    file = np.repeat(np.arange(len(parts)), [len(part.agent) for part in parts])
    values = np.concatenate([part.times.values for part in parts])
    if first.times.how == TIMES_OF_DAY:
        values = past_midnight(values)
    rows = np.concatenate([part.lines for part in parts])
    _refuse_duplicates(parts, file, rows, values, agent, names)
    swapped = ""
    named = [role_of(first.table.names[c]) for c in (first.columns.time, first.columns.agent or 0)] if (
        first.table.names
    ) else []  # fmt: skip
    stated = named in (["frame", "id"], ["time", "id"])  # a header that names both columns is a statement
    if first.columns.agent is not None and not stated and len(parts) == 1 and values.dtype.kind == "i":
        swapped = swap_evidence(values, agent, xy)
        if swapped and not first.columns.stated:
            titles = [first.table.title(c) for c in (first.columns.time, first.columns.agent)]
            raise DataError(
                f"{title}: {titles[0]} as the frame and {titles[1]} as the id cannot be right: {swapped}. They are "
                "probably swapped: say columns='id frame x y', or columns='1 0 2 3' with the numbers of frame, id, x "
                "and y. To read it as it is, say columns='0 1 2 3'."
            )
    raw = RawTimes(values, first.times.per_second, first.times.how, first.times.unknown, first.times.said)
    fps = reading.fps
    dt = reading.dt
    if fps is None and dt is None and first.table.fps:
        dt = 1 / first.table.fps
    clock = clock_of(raw, agent, fps, dt, reading.step, title, _rate_in_comments(first.table))
    scaled = xy * reading.factor
    resampled = resample(clock, agent, scaled, reading.step, reading.gap, title)
    numbered = names.dtype.kind in "iu" and (np.abs(names) < EXACT).all()
    who = (names[agent] if numbered else agent)[resampled.row]
    order = np.lexsort((who, resampled.step))
    name = first.table.path.name if len(parts) == 1 else first.table.path.parent.name
    recording = Recording(
        resampled.step[order], who[order], resampled.xy[order], reading.step, name or first.table.path.stem
    )
    dropped = sum(part.dropped for part in parts)
    tables = [part.table for part in parts]
    return TrackFile(
        recording,
        tables,
        first.columns,
        clock,
        agent,
        names,
        scaled,
        resampled,
        dropped,
        reading,
        lines,
        swapped,
        values,
        [part.columns for part in parts],
    )


def _refuse_duplicates(
    parts: Sequence[_Part],
    file: np.ndarray,
    rows: np.ndarray,
    values: np.ndarray,
    agent: np.ndarray,
    names: np.ndarray,
) -> None:
    """Raise DataError if an agent is there twice at one time."""
    order = np.lexsort((rows, values, agent))
    same = (np.diff(agent[order]) == 0) & (np.diff(values[order]) == 0)
    if not same.any():
        return
    # The first of the second lines, as a reader of the file meets them.
    second = int(order[1:][same][np.argmin(rows[order[1:][same]])])
    first = int(np.flatnonzero((agent == agent[second]) & (values == values[second]))[0])
    table = parts[file[second]].table
    table.refuse(
        int(rows[second]),
        f"`{names[agent[second]]}` is there a second time at {values[second]} (line {table.lines[rows[first]]}); "
        f"{int(same.sum())} such {'rows' if same.sum() > 1 else 'row'} in all",
        "Add a column of ids and name it in `columns`: without one, a file is of one person."
        if parts[0].columns.agent is None
        else "Delete one of the two lines, or give the second agent another id. If the file holds several scenes whose "
        "frames begin anew, make a file of each.",
    )


def _rate_in_comments(table: Table) -> str:
    """What the comments of a file say about its rate."""
    said = [comment for comment in table.comments if _RATE.search(comment)]
    return f" A comment in the file says: {said[0]!r}." if said else ""


def units_in_headers(file: TrackFile) -> list[str | None]:
    """The unit of length that the header of each file says for x and y, if it says one."""
    return [
        length_unit(table, places.x) or length_unit(table, places.y)
        for table, places in zip(file.tables, file.places, strict=True)
    ]


def usual_frames(file: TrackFile) -> float:
    """The most common distance of consecutive frame numbers of an agent."""
    return usual_distance(file.frames - file.frames.min(), file.agent)
