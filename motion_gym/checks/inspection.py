"""What was understood of a file of tracks or a domain, measurements of it, and warnings."""

from __future__ import annotations

import glob
import os
import re
import textwrap
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks import track_measurements as measure
from motion_gym.checks.speeds import speed
from motion_gym.checks.track_measurements import Finding, Steps
from motion_gym.contract import DataError, Domain, Recording, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.data.storage import digest
from motion_gym.data.tracks.column_names import FLAGS, plain_name
from motion_gym.data.tracks.file_content import missing_file
from motion_gym.data.tracks.tables import Table
from motion_gym.data.tracks.track_columns import unknown_unit
from motion_gym.data.tracks.track_files import METRES, TrackFile, units_in_headers, usual_frames
from motion_gym.data.windows import counts
from motion_gym.scoring.cards import is_shipped

SPLITS = ("train", "val", "test")
FEW = 10
"""Agents in the test split below which there is a warning."""


@dataclass(frozen=True)
class Inspection:
    """What was understood and measured.

    Attributes:
        title: Spec of the domain.
        understood: How it was read, and counts.
        measured: Measurements, some with a warning.
    """

    title: str
    understood: tuple[Finding, ...]
    measured: tuple[Finding, ...]

    @property
    def warnings(self) -> list[str]:
        """What is not usual, with what to do."""
        return [finding.warning for finding in (*self.understood, *self.measured) if finding.warning]

    def as_dict(self) -> dict[str, Any]:
        """All of it in JSON types."""
        return {
            "domain": self.title,
            "understood": {finding.name: finding.value for finding in self.understood},
            "measured": {finding.name: finding.value for finding in self.measured},
            "warnings": self.warnings,
        }

    def __str__(self) -> str:
        return self.text(100_000)

    def text(self, width: int) -> str:
        """The report in lines of at most ``width`` characters, where the words and commands in it allow it."""
        names = max(len(finding.name) for finding in (*self.understood, *self.measured))
        lines = [self.title]
        for title, findings in (("Understood", self.understood), ("Measured", self.measured)):
            lines += ["", title, *(_wrapped(f"  {f.name:<{names}}  ", f.text, width) for f in findings)]
        lines += ["", "Warnings", *(_wrapped("  - ", text, width) for text in self.warnings or ["none"])]
        return "\n".join(lines)


def _wrapped(start: str, text: str, width: int) -> str:
    """A text behind the start of a line; its further lines are indented, and no option is cut from its value."""
    whole = re.sub(r"""--\w+ ("[^"]*"|'[^']*')""", lambda option: option[0].replace(" ", "\xa0"), text)
    options: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
    lines = textwrap.wrap(whole, width, initial_indent=start, subsequent_indent=" " * len(start), **options)
    return "\n".join(lines).replace("\xa0", " ") or start.rstrip()


def inspect(domain: str | os.PathLike[str] | Domain, **keywords: Any) -> Inspection:
    """Say how a file of tracks or a domain was understood, measure it, and warn of what is not usual.

    Args:
        domain: A file of tracks or a pattern, which the domain ``tracks`` reads; or a name, a spec, ``"module:Class"``
            or a domain.
        **keywords: Parameters of the domain, as ``fps=25``.

    Raises:
        DataError: the file or the data cannot be read.
        SpecError: the domain or a keyword is not known.
    """
    place = domain_of(domain, **keywords)
    files, recordings = _files(place), _recordings(place)
    understood = [*_of_files(files), *_of_domain(place, recordings)]
    return Inspection(spec_of(place), tuple(understood), tuple(_measurements(place, files, recordings)))


def warnings_of(place: Any) -> list[str]:
    """The warnings about a user's domain; none about shipped ones, whose defects are documented, or broken ones.

    That the split ``test`` has no windows is left out: scoring raises it as an error.
    """
    files = _files(place)
    if not files and is_shipped(place):
        return []
    recordings = _recordings(place)
    counted = _of_domain(place, recordings) if files else []
    findings = [*_of_files(files), *counted, *_measurements(place, files, recordings)]
    return [f.warning for f in findings if f.warning and (f.name, f.value) != ("windows of test", None)]


def warn_about(places: Sequence[Any]) -> None:
    """Emit each of the warnings about users' domains once, as Python warnings."""
    for text in dict.fromkeys(text for place in places for text in warnings_of(place)):
        warnings.warn(text, stacklevel=2)


def _files(place: Any) -> Sequence[TrackFile]:
    return place.track_files() if hasattr(place, "track_files") else ()


def _recordings(place: Any) -> list[Recording]:
    """What is measured: whole files, or the test split of another domain."""
    return [f.recording for f in _files(place)] or [r for r in place.recordings("test") if len(r.frame)]


def _measurements(place: Any, files: Sequence[TrackFile], recordings: Sequence[Recording]) -> list[Finding]:
    card = place.card
    steps = Steps.of(recordings, card.unit)
    stated = next((f"{k}={card.parameters[k]:g}" for k in ("dt", "fps") if files and card.parameters.get(k)), "")
    median = float(np.median(steps.moving)) if len(steps.moving) else 0.0
    reading = files[0].reading if files else None
    measured = [*speed(steps, _rate(files, card.dt), reading), measure.standing(steps)]
    timed = bool(files) and "dt" not in stated  # by fps or by times: there is no doubt about the step
    if not timed and not card.source.startswith("simulated"):
        straight = measure.straightness(steps, stated)
        measured += [straight] if straight else []
    measured += [measure.jumps(steps, recordings), measure.absences(recordings), measure.gaps(recordings, card.dt)]
    measured += [measure.extent(recordings, card.unit), measure.people(recordings)]
    if recordings:
        first = max(recordings, key=lambda r: len(r.frame))
        rows = (first.frame.astype(float), first.agent, first.xy, float(_distance(first)))
        factor = 1.0
        if files:
            largest = max(files, key=lambda f: len(f.agent))
            rows = (largest.clock.seconds, largest.agent, largest.xy, largest.clock.interval)
            factor = largest.reading.factor
        measured += [measure.resolution(rows[2], card.unit, median, factor), measure.noise(*rows, card.unit, median)]
    return measured


def _rate(files: Sequence[TrackFile], dt: float) -> float:
    """Frame numbers per second, as understood; 0 if the files themselves say the time."""
    if not files:
        return 1 / dt
    if files[0].reading.fps:
        return files[0].reading.fps
    return 0.0 if files[0].clock.measured else float(np.median([1 / file.clock.tick for file in files]))


def domain_of(domain: str | os.PathLike[str] | Domain, **keywords: Any) -> Any:
    """The domain of a name, a spec or an object, or the domain ``tracks`` of a file or a pattern."""
    if isinstance(domain, (str, os.PathLike)):
        text = os.fspath(domain)
        if Path(text).expanduser().exists() or (glob.has_magic(text) and glob.glob(os.path.expanduser(text))):
            return catalog.domain("tracks", path=text, **keywords)
        name = catalog.parse_spec(text)[0] if "=" in text or ":" not in text else text
        if name not in catalog.DOMAINS and ":" not in text and (Path(text).suffix or "/" in text):
            raise missing_file(Path(text).expanduser())
        return catalog.domain(text, **keywords)
    return catalog.domain(domain, **keywords)


def _of_files(files: Sequence[TrackFile]) -> list[Finding]:
    """How files were read."""
    if not files:
        return []
    first = files[0]
    table, tables = first.tables[0], [table for file in files for table in file.tables]
    form = [
        table.format,
        table.encoding,
        f"separated by {table.delimiter}" if table.delimiter else "",
        table.compression,
    ]
    rows, dropped = sum(len(f.agent) + f.dropped for f in files), sum(f.dropped for f in files)
    header = f"header {', '.join(table.names)}" if table.names else f"no header, {len(table.columns)} columns"
    shape = f"{len(files)} {'recordings' if len(files) > 1 else 'recording'} of {len(tables)} files"
    people = "of one person each, put together" if len(first.tables) > 1 else "each a recording of its own"
    reading = first.reading
    scaled = f", times {reading.scale:g}" if reading.scale is not None else ""
    scaled += f", converted to {reading.domain_unit}" if reading.unit != reading.domain_unit else ""
    constant = [table.title(c) for c in range(len(table.columns)) if _constant(table.columns[c])]
    off = np.concatenate([file.resampled.irregular for file in files])
    lines = [file.lines[file.resampled.irregular[:1]] for file in files if len(file.resampled.irregular)]
    at = [file.frames[file.resampled.irregular[:1]] for file in files if len(file.resampled.irregular)]
    left_out = f"{dropped} of {rows} rows have no position and were left out" if dropped else ""
    irregular = ""
    if len(off):
        irregular = (
            f"{len(off)} rows are between the regular frames, which are {usual_frames(first):g} apart, and are not "
            f"used; the first is frame {at[0][0]} in line {lines[0][0]}. Renumber the frames if they are right; else "
            "nothing is to be done."
        )
    cut = "" if table.complete or table.format != "text" else (
        " (the last line does not end with a newline: if the file was cut off, its last number may be wrong)"
    )  # fmt: skip
    swapped = next((file.swapped for file in files if file.swapped), "")
    if swapped:
        swapped = (
            f"Frame and id seem to be swapped: {swapped}. Check the order of `columns`: frame (or time), id, x, y."
        )
    starts = [file for file in files if len(file.tables) > 2 and _starts_alike(file)]
    together = (
        f"All {len(starts[0].tables)} files of one person each begin at the same time. If these people were not seen "
        "together, their times are wrong: write the time of one clock, or score the files one by one."
        if starts
        else ""
    )
    rate = [c for c in table.comments if "fps" in c.lower() or "rate" in c.lower()]
    return [
        Finding("file", [str(t.path) for t in tables], str(table.path) if len(tables) == 1 else f"{shape}, {people}",
                together),
        Finding("format", table.format, ", ".join(filter(None, form)) + cut),
        Finding("header", list(table.names or ()), header),
        Finding("columns", first.columns.said(table), first.columns.said(table), swapped),
        Finding("constant columns", constant, ", ".join(constant) or "none"),
        Finding("rows", {"rows": rows, "dropped": dropped}, f"{rows}{f'; {left_out}' if left_out else ''}",
                f"{left_out}: agents are not there at these times." if dropped > 0.05 * rows else ""),
        Finding("time", first.clock.how, first.clock.how + (f" (comment: {rate[0]})" if rate else "")),
        Finding("steps", first.resampled.how, first.resampled.how),
        Finding("irregular frames", len(off), f"{len(off)} rows" if len(off) else "none", irregular),
        Finding("unit", reading.unit, f"{reading.unit}{scaled}", _other_unit(files)),
        *_flags(files), *_twins(tables),
    ]  # fmt: skip


def _other_unit(files: Sequence[TrackFile]) -> str:
    """A warning if a header says another unit than was read or an unknown one, or the headers of files differ."""
    read = files[0].reading.unit
    columns = [(t, column) for f in files for t, p in zip(f.tables, f.places, strict=True) for column in (p.x, p.y)]
    unknown = sorted(filter(None, {unknown_unit(table, column) for table, column in columns}))
    if unknown and files[0].reading.scale is None:
        return (
            f"The header says {unknown[0]}, which is no known unit ({', '.join(METRES)}), and unit={read} was read: if "
            f"it is a unit, say scale=, the metres of one {unknown[0]}."
        )
    said = [(unit, table) for file in files for unit, table in zip(units_in_headers(file), file.tables, strict=True)]
    other = next(((unit, table) for unit, table in said if unit and unit != read), None)
    if other is None and len({unit for unit, _ in said}) < 2:
        return ""
    if len({unit for unit, _ in said}) < 2 and other:
        return f"The header says {other[0]}, and unit={read} was read: say unit={other[0]}."
    unit, table = next((unit, table) for unit, table in said if unit) if other is None else other
    return (
        f"The headers of the files say different units: {table.path.name} says {unit}, others say another or none, "
        f"and unit={read} was read for all {len(said)} files. Read files of one unit at a time."
    )


def _flagged_rows(file: TrackFile) -> dict[str, int]:
    """Number of rows whose position was not seen, by the column that marks them."""
    counts: dict[str, int] = {}
    for table in file.tables:
        for column, name in enumerate(table.names or ()):
            unseen = FLAGS.get(plain_name(name)[0])
            if unseen is None:
                continue
            words = ("1", "1.0", "true", "yes") if unseen else ("0", "0.0", "false", "no")
            count = sum(str(text).lower() in words for text in table.texts(column))
            if count:
                counts[name] = counts.get(name, 0) + count
    return counts


def _flags(files: Sequence[TrackFile]) -> list[Finding]:
    """Columns that mark positions that were not seen."""
    counts: Counter[str] = Counter()
    for file in files:
        counts.update(_flagged_rows(file))
    told = ", ".join(f"{count} rows by `{name}`" for name, count in counts.items())
    warning = f"Positions are marked as not seen and are used: {told}. Delete these rows, if they are guesses."
    return [Finding("marked rows", dict(counts), told, warning)] if counts else []


def _twins(tables: Sequence[Table]) -> list[Finding]:
    """Files with the same content."""
    first: dict[str, Table] = {}
    for table in tables if len(tables) > 1 else ():
        other = first.setdefault(digest(table.path.read_bytes()), table)
        if other is not table:
            warning = (
                f"{table.path.name} has the same content as {other.path.name}, so that the same people count twice: "
                "delete the copy, or give a pattern without it."
            )
            return [Finding("equal files", [str(other.path), str(table.path)], table.path.name, warning)]
    return []


def _of_domain(place: Any, recordings: Sequence[Recording]) -> list[Finding]:
    """Counts of a domain."""
    card = place.card
    agents = sum(len(np.unique(r.agent)) for r in recordings)
    frames = sum(len(np.unique(r.frame)) for r in recordings)
    findings = [
        Finding("step", card.dt, f"{card.dt:g} s, horizon {12 * card.dt:g} s"),
        Finding("recordings", len(recordings), f"{len(recordings)}, with {frames} steps and {agents} agents"),
    ]
    for split in SPLITS:
        name = f"windows of {split}"
        try:
            seen = counts(place.windows(split))
        except (DataError, SpecError) as error:
            findings.append(Finding(name, None, "none", str(error) if split == "test" else ""))
            continue
        text = f"{seen['scenes']} windows, {seen['agent_windows']} agent-windows of {seen['agents']} agents"
        few = ""
        if split == "test" and seen["agents"] < FEW and seen["agents"] < agents and _files(place):
            few = (
                f"Only {seen['agents']} of {agents} agents have windows in the split `test`, so intervals will be "
                f"wide. {place.advice_on_the_whole_file()}"
            )
        findings.append(Finding(name, seen, text, few))
    return findings


def _starts_alike(file: TrackFile) -> bool:
    """Whether every agent is seen first at the same time."""
    order = np.lexsort((file.frames, file.agent))
    first = order[np.append(True, np.diff(file.agent[order]) != 0)]
    return bool((file.frames[first] == file.frames[first[0]]).all())


def _distance(recording: Recording) -> int:
    frames = np.unique(recording.frame)
    return int(np.diff(frames).min()) if len(frames) > 1 else 1


def _constant(fields: Any) -> bool:
    return len(fields) > 1 and bool(
        (fields == fields[0]).all() if isinstance(fields, np.ndarray) else len(set(fields)) == 1
    )
