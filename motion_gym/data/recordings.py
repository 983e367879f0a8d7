"""Recordings from text files, with errors that name the line.

numpy's C parser reads a file, which is then checked as arrays. If the check fails, the file is read line by line, so
that the error names the line.
"""

from __future__ import annotations

import io
import os
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from motion_gym.contract import EXACT, DataError, Recording, SpecError
from motion_gym.data.tracks.file_content import content_of, decompressed
from motion_gym.specs import number

_NAMES = ("frame", "id", "x", "y")
PACKED = (".gz", ".bz2", ".xz", ".lzma")
"""Endings of names that numpy takes for compression, whatever the content is."""
FARTHEST = 2.0**17
"""Farthest position from the origin, in the unit of the domain: float32 resolves 1/128 there."""


_NUMBER = re.compile(r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.ASCII | re.IGNORECASE)


class _Fault(NamedTuple):
    """The first bad row of a table, an earlier row that it contradicts, the kind of fault and a description."""

    row: int
    earlier: int | None
    kind: str
    description: str


def read_recording(
    path: str | os.PathLike[str],
    *,
    dt: float = 0.4,
    columns: Sequence[int] | None = None,
    name: str | None = None,
) -> Recording:
    """Read the tracks of one place from a text file.

    The file has one row per agent and frame, all of them numbers, separated by tabs, spaces or commas,
    without a header, and every line ends with a newline. Frames do not decrease from line to line; the order
    of agents within a frame is free. Blank lines are skipped.

    Args:
        path: The file.
        dt: Seconds per step.
        columns: Which columns, counted from 0, hold frame, id, x and y; by default those of a file of four columns.
        name: Name of the recording, for messages; by default the name of the file without its ending.

    Returns:
        Recording sorted by frame and agent, positions as they stand in the file.

    Raises:
        DataError: The file cannot be read, or a line is bad; the message names the first bad line and the
            remedy.
        SpecError: ``dt`` or ``columns`` is not allowed.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise SpecError(
            f"path={path!r} is not text: give the name of a file, and quote it in a spec where it looks like a number, "
            "as in \"path='2024'\"."
        )
    path = Path(path)
    chosen = list(range(4)) if columns is None else list(columns) if isinstance(columns, Sequence) else []
    whole = all(isinstance(c, int) and not isinstance(c, bool) and c >= 0 for c in chosen)
    if not whole or len(chosen) != 4 or len(set(chosen)) != 4:
        raise SpecError(
            f"columns={columns!r} must be four different column numbers, counted from 0: those of frame, id, x and y"
        )
    dt = number("dt", dt, above=True, owner=f"{path} (seconds per step)")
    content, packed = decompressed(path, content_of(path))
    delimiter = "," if b"," in content.lstrip().partition(b"\n")[0] else None
    source = io.BytesIO(content) if packed or path.suffix in PACKED else path
    table = _fast(source, content, delimiter)
    if table is not None and columns is None and table.shape[1] != 4:
        table = None
    if table is None or max(chosen) >= table.shape[1] or _first_fault(table[:, chosen]) is not None:
        table = _careful(path, content, chosen, columns is None)
    else:
        table = table[:, chosen]
    if not _rises(table):
        table = table[np.lexsort((table[:, 1], table[:, 0]))]
    return Recording(
        frame=table[:, 0].astype(np.int64),
        agent=table[:, 1].astype(np.int64),
        xy=np.ascontiguousarray(table[:, 2:]),
        dt=dt,
        name=name or path.stem,
    )


def recording_of_scenes(xy: np.ndarray, dt: float, name: str) -> Recording:
    """One recording of scenes [S, T, N, 2] one after another, T frames each, with a new id for each agent."""
    scenes, steps, agents = xy.shape[:3]
    frame = np.repeat(np.arange(scenes * steps), agents)
    agent = np.repeat(np.arange(scenes * agents).reshape(scenes, 1, agents), steps, axis=1)
    return Recording(frame, agent.reshape(-1), xy.reshape(-1, 2), dt, name)


def check_recording(recording: Recording) -> None:
    """Check the values of a recording that was built in memory, in the same way as a file.

    Raises:
        DataError: A row is bad; the message names the first bad row, counted from 0, and the remedy.
        SpecError: ``dt`` is not allowed.
    """
    name, frame, agent = recording.name, recording.frame, recording.agent
    number("dt", recording.dt, above=True, owner=f"recording {name} (seconds per step)")
    if len(frame) == 0:
        raise DataError(f"recording {name} has no rows. Expected at least one frame with one agent.")
    fault = _first_fault(np.column_stack([frame, agent, recording.xy]))
    swapped = np.flatnonzero((np.diff(frame) == 0) & (np.diff(agent) < 0))
    if fault is None and len(swapped):
        row = int(swapped[0]) + 1
        fault = _Fault(row, row - 1, "order", f"agent {agent[row]} comes after agent {agent[row - 1]} of its frame")
    if fault is not None:
        remedy = {
            "order": "Sort all columns: order = numpy.lexsort((agent, frame)).",
            "duplicate": "Keep one of the two rows, or give the second agent another id.",
        }.get(fault.kind, "Correct or leave out the row.")
        earlier = "" if fault.earlier is None else f" (row {fault.earlier})"
        raise DataError(f"recording {name}, row {fault.row}: {fault.description}{earlier}. {remedy}")
    far = np.abs(recording.xy - recording.origin).max(axis=1) > FARTHEST
    if far.any():
        row = int(far.argmax())
        raise DataError(
            f"recording {name}, row {row}: the position {recording.xy[row].tolist()} is more than {FARTHEST:,.0f} from "
            f"the origin {recording.origin.tolist()}, where float32 no longer resolves 0.01. Correct the row, leave "
            "`origin` out so that it follows from the first row (dataclasses.replace: origin=None), or make two "
            "recordings of two places."
        )


def _fast(source: Path | io.BytesIO, content: bytes, delimiter: str | None) -> np.ndarray | None:
    """[R, C] as read by numpy's C parser; None if the parser refuses the file."""
    if not content.endswith((b"\n", b"\r")):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # By path, since numpy reads a path in large pieces, but an open file line by line.
            table = np.loadtxt(source, delimiter=delimiter, comments=None, ndmin=2, encoding="utf-8")
        return table  # type: ignore[no-any-return]
    except (ValueError, UserWarning):
        return None


def _rises(table: np.ndarray) -> bool:
    """Whether rows are strictly sorted by frame and agent, as in most files."""
    with np.errstate(invalid="ignore"):
        frame, agent = np.diff(table[:, :2], axis=0).T
    return bool(((frame > 0) | ((frame == 0) & (agent > 0))).all())


def _first_fault(table: np.ndarray) -> _Fault | None:
    """The first bad row of [R, 4] frame, id, x, y."""
    earlier = np.arange(len(table))
    if not _rises(table):
        _, first, pair = np.unique(table[:, :2], axis=0, return_index=True, return_inverse=True)
        earlier = first[pair.reshape(-1)]
    with np.errstate(invalid="ignore"):
        broken = (table[:, :2] != np.rint(table[:, :2])) | (np.abs(table[:, :2]) >= EXACT)
        backwards = np.diff(table[:, 0], prepend=table[:1, 0]) < 0
    bad = {
        "finite": ~np.isfinite(table).all(axis=1),
        "whole": broken.any(axis=1),
        "order": backwards,
        "duplicate": earlier < np.arange(len(table)),
    }
    rows = {kind: int(rows.argmax()) for kind, rows in bad.items() if rows.any()}
    if not rows:
        return None
    kind = min(rows, key=lambda kind: rows[kind])
    row, clash = rows[kind], {"order": rows[kind] - 1, "duplicate": int(earlier[rows[kind]])}.get(kind)
    frame, agent = (f"{value:.17g}" for value in table[row, :2])
    column = int((~np.isfinite(table[row]) if kind == "finite" else broken[row]).argmax())
    description = {
        "finite": f"{_NAMES[column]} is {table[row, column]}, not a finite number",
        "whole": f"{_NAMES[column]} is {table[row, column]:.17g}, not a whole number below 2**53",
        "order": f"frame {frame} comes after frame {table[row - 1, 0]:.17g}",
        "duplicate": f"frame {frame} has agent {agent} a second time",
    }[kind]
    return _Fault(row, clash, kind, description)


def _careful(path: Path, content: bytes, columns: list[int], four: bool) -> np.ndarray:
    """[R, 4] as read line by line; a DataError names the first bad line."""
    text = content.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    lines = [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip()]
    if not lines:
        raise DataError(f"{path} is empty. Expected lines of numbers: {' '.join(_NAMES)}.")
    # By majority, as the width below, because the first line may be bad.
    delimiter = "," if 2 * sum("," in line for _, line in lines) > len(lines) else None
    split = [[field.strip() for field in line.split(delimiter)] for _, line in lines]
    width = Counter(map(len, split)).most_common(1)[0][0]
    bad = [_bad_line(fields, width, columns) for fields in split]
    tracks = f"read the file as motion_gym.domain('tracks', path={path.name!r})"
    if not any(map(_NUMBER.fullmatch, split[0])):
        bad[0] = ("this is not a line of numbers", f"Delete the header line, or {tracks}.")
    elif four and width != 4:
        problem = f"{width} columns, and `columns` does not say which of them hold frame, id, x and y"
        bad[0] = (problem, f"Give columns=(0, 1, 2, 3) or the numbers that are right, counted from 0, or {tracks}.")
    elif not text.endswith("\n"):
        bad[-1] = (
            "the file ends in the middle of this line",
            "It was probably truncated: get it again. If the line is complete, end it with a newline.",
        )
    good = next((number for number, problem in enumerate(bad) if problem), len(lines))
    table = np.array([[float(fields[column]) for column in columns] for fields in split[:good]]).reshape(-1, 4)
    fault = _first_fault(table)
    if fault is not None:
        earlier = "" if fault.earlier is None else f" (line {lines[fault.earlier][0]})"
        _refuse(path, *lines[fault.row], fault.description + earlier, _remedy(fault.kind, path, delimiter, columns))
    if good < len(lines):
        _refuse(path, *lines[good], *(bad[good] or ("", "")))
    return table


def _bad_line(fields: list[str], width: int, columns: list[int]) -> tuple[str, str] | None:
    """The fault of the fields of a line and its remedy; None if there is no fault."""
    text = next((number for number, field in enumerate(fields) if not _NUMBER.fullmatch(field)), None)
    if len(fields) != width:
        return f"{len(fields)} columns where the other lines have {width}", "Correct or delete the line."
    if width <= max(columns):
        return (
            f"{width} columns, but columns={tuple(columns)} needs {max(columns) + 1}",
            "Say with `columns` which columns, counted from 0, hold frame, id, x and y.",
        )
    if text is not None:
        return (
            f"column {text} (counted from 0) is {fields[text]!r}, not a number",
            "Correct or delete the line; numbers have a decimal point, and columns are separated by tabs, "
            "spaces or commas.",
        )
    return None


def _remedy(kind: str, path: Path, delimiter: str | None, columns: list[int]) -> str:
    frame, agent = columns[0] + 1, columns[1] + 1
    comma = "-t, " if delimiter else ""
    keys = f"-k{frame},{frame}g -k{agent},{agent}g"
    return {
        "order": f"Sort it: `LC_ALL=C sort {comma}{keys} {path.name} > sorted.txt`.",
        "duplicate": "Delete one of the two lines, or give the second agent another id.",
        "finite": "Delete the line, so that the agent is not there in this frame.",
        "whole": "Frames and ids are counted: correct the line, or say with `columns` where they are.",
    }[kind]


def _refuse(path: Path, number: int, line: str, fault: str, remedy: str) -> NoReturn:
    shown = line if len(line) <= 100 else line[:100] + "..."
    raise DataError(
        f"{path}, line {number}: {fault}: {shown!r}. Expected {' '.join(_NAMES)} in each line, frames and ids "
        f"whole numbers, x and y finite. {remedy}"
    )
