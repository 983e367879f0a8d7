"""Files of the Stanford Drone Dataset: annotations and window tables as positions, and scales."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from motion_gym.contract import DataError
from motion_gym.data.tracks.file_content import content_of
from motion_gym.data.tracks.tables import NUMBER, short

VIDEOS: Mapping[str, int] = {
    "bookstore": 7, "coupa": 4, "deathCircle": 5, "gates": 9, "hyang": 15, "little": 4, "nexus": 12, "quad": 4
}  # fmt: skip
"""Number of videos of each scene."""
CLIPS = {f"{scene}_{video}": (scene, video) for scene, count in VIDEOS.items() for video in range(count)}
"""Scene and number of the video of each clip."""
STEP_FRAMES = 12
"""Video frames of a step of 0.4 s; a clip has 30 frames a second."""
CLASSES = ("pedestrian", "biker", "skater", "cart", "car", "bus")
OTHER = "other"
"""Class of a person of the window tables that is neither pedestrian, biker nor car."""
LARGEST = 10_000.0
"""Largest coordinate, pixels; images of the clips are at most 2,019 pixels wide or high."""
LAST_FRAME = 10**7
"""Largest frame number, four days."""
MOST_AGENTS = 10**9
"""Ids of people are below this."""
_WHOLE = re.compile(r"[+-]?\d{1,18}", re.ASCII)

_BOX = [("agent", "i8"), *((side, "f8") for side in ("xmin", "ymin", "xmax", "ymax"))]
ANNOTATION = np.dtype([*_BOX, *((name, "i8") for name in ("frame", "lost", "occluded", "generated")), ("label", "U16")])
WINDOW_ROW = np.dtype(
    [("frame", "i8"), ("agent", "i8"), ("x", "f8"), ("y", "f8"), ("clip", "U32"), ("window", "i8")]
)  # fmt: skip
LABEL_ROW = np.dtype([("split", "U8"), ("clip", "U32"), ("agent", "i8"), ("label", "U16")])
"""Columns of the three sorts of files."""


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of people in clips, sorted by clip, agent and frame; frames are multiples of 12.

    Attributes:
        clips: Names of the clips.
        clip: [R] int64, number of the clip of each row.
        agent: [R] int64, id of the person within the clip.
        frame: [R] int64, frame of the video.
        xy: [R, 2] float64, pixels of the full-size image, y downwards.
        label: [R] class of the person, one of ``CLASSES`` or ``OTHER``.
    """

    clips: tuple[str, ...]
    clip: np.ndarray
    agent: np.ndarray
    frame: np.ndarray
    xy: np.ndarray
    label: np.ndarray

    @classmethod
    def of(cls, clip: np.ndarray, agent: np.ndarray, frame: np.ndarray, xy: np.ndarray, label: np.ndarray) -> Positions:
        """Sort the columns; ``clip`` [R] holds names."""
        clips = tuple(sorted(set(clip.tolist())))
        number = _numbers(clip, clips)
        order = np.lexsort((frame, agent, number))
        return cls(clips, *(column[order] for column in (number, agent, frame, xy, label)))


def read_windows(tables: Sequence[Path], labels: Path) -> Positions:
    """The rows of window tables, with the classes of a table of labels.

    Raises:
        DataError: A file cannot be read, or a line is bad; the message names the line.
    """
    rows = np.concatenate([_read(path, WINDOW_ROW, header=True)[0] for path in tables])
    classes, _ = _read(labels, LABEL_ROW, header=True, delimiter=",")
    clips = tuple({*rows["clip"].tolist(), *classes["clip"].tolist()})
    person, known = (_numbers(part["clip"], clips) * MOST_AGENTS + part["agent"] for part in (rows, classes))
    order = np.argsort(known)
    at = order[np.searchsorted(known[order], person) % len(order)]
    label = np.where(known[at] == person, np.char.lower(classes["label"])[at], OTHER)
    return Positions.of(rows["clip"], rows["agent"], rows["frame"], np.column_stack([rows["x"], rows["y"]]), label)


def read_clips(paths: Mapping[str, Path]) -> Positions:
    """The annotations of clips, by name of the clip: centres of the boxes of every 12th frame, without lost rows.

    Raises:
        DataError: A file cannot be read, or a line is bad; the message names the line.
    """
    parts = {clip: read_annotations(path) for clip, path in paths.items()}
    rows = np.concatenate(list(parts.values()))
    clip = np.repeat(list(parts), [len(part) for part in parts.values()])
    used = (rows["lost"] == 0) & (rows["frame"] % STEP_FRAMES == 0)
    rows, clip = rows[used], clip[used]
    xy = np.column_stack([rows["xmin"] + rows["xmax"], rows["ymin"] + rows["ymax"]]) / 2
    return Positions.of(clip, rows["agent"], rows["frame"], xy, np.char.lower(rows["label"]))


def mean_speeds(rows: Positions, start: np.ndarray, person: np.ndarray) -> np.ndarray:
    """[P] mean speed of each person, pixels per video frame, over steps without a gap; NaN without such a step.

    Args:
        rows: Positions, sorted by person.
        start: [P] first row of each person.
        person: [R] number of the person of each row.
    """
    length = np.linalg.norm(np.diff(rows.xy, axis=0), axis=1)
    unbroken = (np.diff(rows.frame) == STEP_FRAMES) & (np.diff(person) == 0)
    path = np.bincount(person[1:][unbroken], length[unbroken], minlength=len(start))
    count = np.bincount(person[1:][unbroken], minlength=len(start))
    return np.where(count > 0, path / np.maximum(count, 1) / STEP_FRAMES, np.nan)


def read_annotations(path: Path, content: bytes | None = None) -> np.ndarray:
    """The rows of a file of annotations, as they are: [R] of the type ``ANNOTATION``.

    Args:
        path: The file.
        content: Its bytes; by default they are read.

    Raises:
        DataError: The file cannot be read, or a line is bad; the message names the first bad line.
    """
    rows, text = _read(path, ANNOTATION, content=content)
    sides = np.column_stack([rows[side] for side in ("xmin", "ymin", "xmax", "ymax")])
    order = np.lexsort((rows["frame"], rows["agent"]))
    agent, frame = rows["agent"][order], rows["frame"][order]
    twice = np.zeros(len(rows), bool)
    twice[order[1:]] = (agent[1:] == agent[:-1]) & (frame[1:] == frame[:-1])
    for bad, fault in (
        (~(np.abs(sides) <= LARGEST).all(axis=1), f"a side of the box is farther than {LARGEST:,.0f} pixels from 0"),
        (
            (sides[:, :2] > sides[:, 2:]).any(axis=1),
            "the box ends before it begins",
        ),
        ((rows["frame"] < 0) | (rows["frame"] > LAST_FRAME), f"the frame is not between 0 and {LAST_FRAME:,}"),
        (~np.isin(rows["lost"], (0, 1)), "`lost` is neither 0 nor 1"),
        (~np.isin(np.char.lower(rows["label"]), CLASSES), f"the class is none of {', '.join(CLASSES)}"),
        (twice, "this track is in this frame a second time"),
    ):
        if bad.any():
            _refuse(path, *_numbered(text)[int(bad.argmax())], fault, ANNOTATION)
    return rows


def read_scales(path: Path) -> dict[str, tuple[float, float]]:
    """Metres per pixel and the certainty of this estimate, 0 to 1, of each clip that a file of scales names.

    Raises:
        DataError: The file cannot be read, or a line is bad; the message names the line.
    """
    scales: dict[str, dict[str, float]] = {}
    scene = clip = ""
    for number, line in enumerate(content_of(path).decode(errors="replace").splitlines(), 1):
        key, colon, value = (part.strip() for part in line.partition(":"))
        if not line.strip() or line.strip().startswith("#"):
            continue
        if colon and not value and key.startswith("video"):
            clip = f"{scene}_{key.removeprefix('video')}"
            scales[clip] = {}
        elif colon and not value:
            scene = key
        elif clip and key in ("scale", "certainty") and NUMBER.fullmatch(value) and 0 <= float(value) < 1e3:
            scales[clip][key] = float(value)
        else:
            raise DataError(
                f"{path}, line {number}: expected `SCENE:`, `videoN:`, `scale: METRES` or `certainty: SHARE`, found "
                f"{short(line)}. Correct the line."
            )
    return {clip: (of["scale"], of.get("certainty", 0.0)) for clip, of in scales.items() if of.get("scale", 0) > 0}


def scale_of(path: Path, clip: str) -> float:
    """Metres per pixel of a clip; DataError if the file has no scale of the clip, see ``read_scales``."""
    scales = read_scales(path)
    if clip not in scales:
        raise DataError(f"{path} has no scale of the clip {clip}. Add it, leave the clip out, or use unit=px.")
    return scales[clip][0]


def _read(
    path: Path, row: np.dtype, *, header: bool = False, delimiter: str | None = None, content: bytes | None = None
) -> tuple[np.ndarray, str]:
    """[R] rows of a text file, and its text without the header."""
    text = (content_of(path) if content is None else content).decode("utf-8-sig", errors="replace")
    if header:
        text = "\n" + text.partition("\n")[2]  # so that lines keep their numbers
    if not text.strip():
        raise DataError(f"{path} has no rows. Expected lines of {_layout(row)}.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            rows = np.loadtxt(io.StringIO(text), row, comments=None, delimiter=delimiter, ndmin=1, quotechar='"')
        return rows, text
    except (ValueError, OverflowError, Warning):
        for number, line in _numbered(text):
            _check_line(path, number, line, row, delimiter)
        raise DataError(f"{path} cannot be read. Expected lines of {_layout(row)}. Get it again.") from None


def _numbered(text: str) -> list[tuple[int, str]]:
    """Number and text of each line that is not blank."""
    return [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip()]


def _numbers(names: np.ndarray, known: Sequence[str]) -> np.ndarray:
    """[R] int64, the place of each name among the known ones; equal names mostly follow each other."""
    start = np.flatnonzero(np.concatenate([[True], names[1:] != names[:-1]]))
    place = {name: number for number, name in enumerate(known)}
    numbers = np.array([place[name] for name in names[start].tolist()], np.int64)
    return np.repeat(numbers, np.diff(np.append(start, len(names))))


def _check_line(path: Path, number: int, line: str, row: np.dtype, delimiter: str | None) -> None:
    """Raise DataError if the fields of a line are not those of a row."""
    fields, names = [field.strip().strip('"') for field in line.split(delimiter)], row.names or ()
    if len(fields) != len(names):
        _refuse(path, number, line, f"{len(fields)} columns instead of {len(names)}", row)
    for name, field in zip(names, fields, strict=True):
        kind = row[name].kind
        if kind == "i" and not _WHOLE.fullmatch(field):
            _refuse(path, number, line, f"`{name}` is {field!r}, not a whole number", row)
        if kind == "f" and not NUMBER.fullmatch(field):
            _refuse(path, number, line, f"`{name}` is {field!r}, not a number", row)


def _refuse(path: Path, number: int, line: str, fault: str, row: np.dtype) -> NoReturn:
    raise DataError(
        f"{path}, line {number}: {fault}: {short(line)}. Expected {_layout(row)}. Correct or delete the line."
    )


def _layout(row: np.dtype) -> str:
    return " ".join(row.names or ())
