"""Files of tracks of a user's own, resampled by time."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.contract import WINDOW, DataError, Recording, SpecError
from motion_gym.data.domains import RecordedDomain, argument_of
from motion_gym.data.storage import digest
from motion_gym.data.tracks.track_files import Reading, TrackFile, find_files, read_track_files
from motion_gym.data.windows import Tracks as Cut
from motion_gym.specs import format_spec, three_shares, whole_number

SHARES = (0.6, 0.2, 0.2)
"""Shares of the time for train, val and test."""
SHORT_SHARES = (0.5, 0.0, 0.5)
"""The same of recordings that are too short for three parts."""
LONG = 200
"""Steps from which on each of three parts has room for windows."""
WHOLE = "0 0 1"
"""The split whose test part is the whole file."""
SOURCE_SHARES = (0.8, 0.2, 0.0)
"""The same of a file that is only trained on."""
PARTS = ("train", "val", "test")


class Tracks(RecordedDomain):
    """Any file of tracks: a row for each agent and frame.

    ## Description
    Reads text and csv (header or not; comma, semicolon, tab or spaces; decimal commas; UTF-8, UTF-16; gzip, bzip2, xz),
    Parquet (with pyarrow), TrajNet++ ndjson and the ETH ``obsmat``, converts the unit to metres, and resamples by time
    to ``step`` seconds. Where a step is a whole number of frames, positions are those of listed frames; else each is
    extrapolated linearly from the agent's last two samples at or before it, which uses no later sample. Nothing is
    filled over more than ``gap`` seconds, and a gap ends a window. ``motion-gym inspect FILE`` says how a file was
    understood.

    ## Observation
    x and y, in metres, or in pixels for ``unit="px"`` without a scale.

    ## Splits
    Consecutive parts of the time of every recording, ``split`` their shares, with one window (20 steps) left out
    between them. ``reference`` is the training part.

    ## Arguments
    Args:
        path: The file, or a pattern (``*``, ``?``). Files of one person each in one folder are one recording; files of
            several people are a recording each.
        columns: Which columns hold frame (or time), id, x and y, in this order: names of the header, or numbers from 0;
            a sequence or one text separated by spaces. Without a header, names are the layout from left to right, with
            ``-`` for columns that are not needed. Three columns, without id, are a file of one person. By default they
            are found by the header, or are the four columns of a file without one.
        fps: Frames per second of the frame *numbers*, as 25; 1000 for milliseconds.
        dt: Seconds between consecutive *listed* frames, instead of fps. A column of seconds or of dates needs neither.
        unit: Unit of the file: m, cm, mm, km, ft, in, yd or px.
        scale: What positions are multiplied by before the unit is converted: metres per pixel for px.
        step: Seconds per step that tracks are resampled to.
        gap: Longest time, in seconds, between two samples of an agent that is bridged, at most 20 steps; by default
            half a step, or the usual time between samples if that is longer.
        split: Shares of the time for train, val and test; by default 0.6 0.2 0.2 (0.5 0 0.5 of files shorter than 200
            steps), or 0 0 1 if sources are named.
        sources: Other files to train on, read in the same way; by default the training part of this file.
        min_agents: Smallest number of complete agents in a window.
        stride: Steps between the starts of two windows.
    """

    name = "tracks"
    headline = ("path",)

    def __init__(
        self,
        path: Any,
        columns: Any = None,
        fps: float | None = None,
        dt: float | None = None,
        unit: str = "m",
        scale: float | None = None,
        step: float = 0.4,
        gap: float | None = None,
        split: Any = None,
        sources: Any = None,
        min_agents: int = 1,
        stride: int = 1,
    ):
        find_files(path)  # a missing file is named at once
        self.reading = Reading(columns, fps, dt, unit, scale, step, gap)
        if self.reading.columns is not None:
            columns = " ".join(f"'{c}'" if " " in str(c) else str(c) for c in self.reading.columns)
        self.others = _paths(sources)
        stated = None if split is None else three_shares(split)
        self._stated = (0.0, 0.0, 1.0) if stated is None and self.others else stated
        self._parameters: dict[str, Any] = {
            "path": os.fspath(path),
            "columns": columns,
            "fps": fps,
            "dt": dt,
            "unit": unit,
            "scale": scale,
            "step": step,
            "gap": gap,
            "split": None if split is None else " ".join(f"{share:g}" for share in stated or ()),
            "sources": list(self.others) or None,
            "min_agents": min_agents,
            "stride": stride,
        }
        self.unit, self.dt = self.reading.domain_unit, self.reading.step  # type: ignore[misc]
        self.min_agents = whole_number("min_agents", min_agents, 1, 1000)
        self.stride = whole_number("stride", stride, 1, 1_000_000)

    @property
    def parameters(self) -> dict[str, Any]:
        """The constructor's arguments with their values."""
        return dict(self._parameters)

    @property
    def path(self) -> str:
        """The file or pattern."""
        return str(self._parameters["path"])

    @property
    def world(self) -> str:
        """The files, whatever is read of them."""
        return format_spec(self.name, {"path": str(Path(self.path).expanduser().absolute())})

    @property
    def files(self) -> Mapping[str, str]:
        """sha256 of each file."""
        return self.kept("digests", lambda: {str(p): digest(p.read_bytes()) for p in find_files(self.path)})

    @property
    def source(self) -> str:  # type: ignore[override]
        """The files, and which part of them each split is."""
        parts = [f"{part} {_percent(edges)}" for part, edges in self.edges().items() if edges[1] > edges[0]]
        how = dict.fromkeys(file.resampled.how for file in self.track_files())
        guard = f", {WINDOW} steps left out between them" if len(parts) > 1 else ""
        return f"{self.path}: {', '.join(parts)} of the time{guard}; {'; '.join(how)}"

    @property
    def shares(self) -> tuple[float, float, float]:
        """Shares of the time for train, val and test."""
        if self._stated is not None:
            return self._stated
        long = any(_steps(file.recording) >= LONG for file in self.track_files())
        return SHARES if long else SHORT_SHARES

    def edges(self) -> dict[str, tuple[float, float]]:
        """First and last share of the time of each part."""
        ends = np.cumsum((0.0, *self.shares)).round(9).tolist()
        return dict(zip(PARTS, itertools.pairwise(ends), strict=True))

    def track_files(self) -> list[TrackFile]:
        """What was read, a recording each."""
        return self.kept("track files", self._read)

    def _read(self) -> list[TrackFile]:
        return read_track_files(self.path, self.reading)

    def recordings(self, split: str) -> list[Recording]:
        """The part of each recording that is a split.

        Raises:
            DataError: the files cannot be read, or the split has a share of the time and no window.
        """
        self.check_split(split)
        part = "train" if split == "reference" else split
        low, high = self.edges()[part]
        if high <= low:
            return []
        parts = self.kept(f"part {part}", lambda: self._cut(part, low, high))
        return [dataclasses.replace(r, frame=r.frame.copy(), agent=r.agent.copy(), xy=r.xy.copy()) for r in parts]

    def _cut(self, part: str, low: float, high: float) -> list[Recording]:
        cuts = []
        for whole in (file.recording for file in self.track_files()):
            steps = _steps(whole)
            first, last = (round(share * steps) for share in (low, high))
            first += WINDOW if low > 0 else 0
            frame = whole.frame - whole.frame[:1].sum()
            keep = (frame >= first) & (frame < last)
            if keep.any():
                cuts.append(
                    dataclasses.replace(whole, frame=whole.frame[keep], agent=whole.agent[keep], xy=whole.xy[keep])
                )
        self._check_windows(part, cuts)
        return cuts

    def samples(self, split: str) -> list[Recording]:
        """The samples of the files within a split, before resampling; frames are the numbers of the listed times."""
        self.check_split(split)
        low, high = self.edges()["train" if split == "reference" else split]
        parts = []
        for file in self.track_files():
            time = (file.clock.seconds - file.resampled.seconds.min(initial=np.inf)) / self.dt
            steps = _steps(file.recording)
            keep = (time >= round(low * steps) + (WINDOW if low > 0 else 0)) & (time < round(high * steps))
            frame = np.unique(file.clock.seconds, return_inverse=True)[1].reshape(-1)
            parts.append(Recording(frame[keep], file.agent[keep], file.xy[keep], self.dt, file.recording.name))
        return parts

    def _check_windows(self, part: str, cuts: Sequence[Recording]) -> None:
        """Raise DataError if a part has no window, with counts of what it has."""
        tracks = [Cut.of(recording) for recording in cuts]
        if any(len(cut.complete()) for cut in tracks):
            return
        longest = max((int(cut.age.max(initial=-1)) + 1 for cut in tracks), default=0)
        agents, rows = sum(len(np.unique(cut.agent)) for cut in tracks), sum(len(cut.tick) for cut in tracks)
        whole = max((int(Cut.of(f.recording).age.max(initial=-1)) + 1 for f in self.track_files()), default=0)
        guard = f", less the first {WINDOW} steps" if self.edges()[part][0] > 0 else ""
        if whole < WINDOW:
            remedy = (
                f"The longest track of the file lasts {max(whole - 1, 0) * self.dt:g} s, and a window "
                f"{(WINDOW - 1) * self.dt:g} s. If agents are seen for longer, check fps, dt and columns, or allow a "
                "longer gap; else give a smaller step (predictors of other steps refuse)."
            )
        else:
            low, high = self.edges()[part]
            larger = {"train": 0.7, "test": 0.3}.get(part, 1.0) > high - low
            remedy = (
                f"The longest track of the whole file has {whole} steps. {self.advice_on_the_whole_file()}"
                f"{' Or leave out validation: split=0.7 0 0.3.' if larger else ''}"
            )
        raise DataError(
            f"{self.path}: split `{part}`, {_percent(self.edges()[part])} of the time{guard}, has no window: nobody "
            f"is there for 20 consecutive steps of {self.dt:g} s ({rows} rows of {agents} agents, the "
            f"longest unbroken track has {longest} steps). {remedy}"
        )

    def advice_on_the_whole_file(self) -> str:
        """What to do where the split ``test`` has few windows or none: score the whole file."""
        if self.shares[2] == 1:
            return f"The other agents are in no window of {WINDOW} consecutive steps ({(WINDOW - 1) * self.dt:g} s)."
        return (
            f"To score the whole file, write {argument_of(self.replace(split=WHOLE))} (for `inspect`: --split "
            f"'{WHOLE}'). Predictors that are fitted then need sources=OTHER_FILE."
        )

    def without_sources(self) -> str:
        """What to do where a predictor must be trained and the split leaves no part to train on."""
        halves = " ".join(f"{share:g}" for share in SHORT_SHARES)
        return (
            f"has nothing to train on: split={self.parameters['split']} leaves no part of the file for training. Write "
            f"{argument_of(self.replace(split=halves))}, or name another file to train on, sources=OTHER_FILE."
        )

    def sources(self) -> list[RecordedDomain]:
        """The other files, or this file, whose training part is another one than its test part."""
        if not self.others:
            return [self] if self.shares[0] > 0 else []
        own = {**self.parameters, "sources": None, "split": " ".join(map(str, SOURCE_SHARES))}
        return self.kept("sources", lambda: [type(self)(**{**own, "path": other}) for other in self.others])


def _steps(recording: Recording) -> int:
    """Steps from the first to the last frame."""
    return int(recording.frame[-1] - recording.frame[0]) + 1 if len(recording.frame) else 0


def _percent(edges: tuple[float, float]) -> str:
    return f"{100 * edges[0]:g} to {100 * edges[1]:g} %"


def _paths(sources: Any) -> tuple[str, ...]:
    """The other files: one path, or a sequence of paths."""
    if sources is None:
        return ()
    listed = [sources] if isinstance(sources, (str, os.PathLike)) else sources
    if not isinstance(listed, (list, tuple)) or not listed:
        raise SpecError(f"sources={sources!r} must be the name of a file, or a sequence of such names.")
    for other in listed:
        find_files(other)
    return tuple(map(os.fspath, listed))
