"""The store of runs: small files while a command runs, and one packed file per benchmark in the package.

A file in a folder of results that is not a run of this schema is named in a warning and left unchanged.
"""

from __future__ import annotations

import datetime
import functools
import json
import lzma
import platform
import re
import secrets
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from motion_gym.benchmarks.identity import canonical, digest_of, question
from motion_gym.benchmarks.run_schema import SCHEMA, problem_of
from motion_gym.contract import DataError
from motion_gym.data.storage import exclusive, write_atomic
from motion_gym.training.provenance import commit, versions

Run = dict[str, Any]
SHIPPED = Path(__file__).parent.parent / "results"
"""Folder of the packed runs, tables and figures that ship with the package."""
MARKER = ".command"
"""File in a folder of results that names the running command; it is deleted when that command ends."""
NAMED = 5
"""Most files that one warning names."""


class Store:
    """Runs of one benchmark: shipped runs, runs of a packed file, and small files of a folder; later ones win.

    Args:
        name: Name of the benchmark; None for a folder of scores.
        folder: Folder for new runs, one small file each; None to write none.
        shipped: Folder of the packed file that is read first.
    """

    def __init__(self, name: str | None, folder: Path | None = None, shipped: Path = SHIPPED):
        self.name, self.folder = name, folder
        self.runs: dict[str, Run] = {}
        """Runs by their question."""
        for place in dict.fromkeys([shipped, *([folder.parent] if folder else [])]):
            if name is not None and (packed := place / f"{name}.jsonl.xz").is_file():
                self.take(_packed(packed, packed.stat().st_mtime_ns))
        if folder is not None and folder.is_dir():
            self.take(read_folder(folder))

    def take(self, runs: Iterable[Run]) -> None:
        """Add runs; each replaces a run with the same question."""
        self.runs |= {question(run["identity"]): run for run in runs}

    def find(self, identity: Mapping[str, Any]) -> Run | None:
        """The run of an identity; None if it is missing, or was made with other weights, data or versions."""
        identity = canonical(identity)
        run = self.runs.get(question(identity))
        return run if run is not None and run["identity"] == identity else None

    def pack(self, place: Path) -> Path:
        """Write all runs into one file, as sorted lines of JSON; returns its path.

        Runs of a user's own predictors stay in small files of the folder; the small files of others are deleted.
        """
        path = place / f"{self.name}.jsonl.xz"
        place.mkdir(parents=True, exist_ok=True)
        with exclusive(place):
            # Another process may have written runs since this one read them.
            others = [*_packed(path, path.stat().st_mtime_ns)] if path.is_file() else []
            others += read_folder(self.folder) if self.folder is not None and self.folder.is_dir() else []
            runs = {question(run["identity"]): run for run in others} | self.runs
            shipped = [run for _, run in sorted(runs.items()) if run["identity"].get("session") is None]
            text = "".join(json.dumps(run, allow_nan=False) + "\n" for run in shipped)
            write_atomic(path, lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))
            if self.folder is not None:
                for run in shipped:
                    path_of(self.folder, run["identity"]).unlink(missing_ok=True)
        return path


def run_of(identity: Mapping[str, Any], result: Mapping[str, Any]) -> Run:
    """A run made of its identity and its result in JSON types."""
    return {"schema": SCHEMA, **result, "identity": canonical(identity), "provenance": provenance()}


def provenance() -> dict[str, Any]:
    """Versions, commit, machine, time and command, which are recorded beside a result, in JSON types."""
    return {
        "versions": versions(),
        "commit": commit(),
        "machine": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "finished": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="milliseconds"),
        "command": sys.argv[1:],
    }


def write(folder: Path | None, run: Run) -> None:
    """Write a run to a file of its own in a folder; without a folder, do nothing."""
    if folder is not None:
        content = json.dumps(run, indent=1, allow_nan=False) + "\n"
        write_atomic(path_of(folder, run["identity"]), content.encode())


def path_of(folder: Path, identity: Mapping[str, Any]) -> Path:
    """File of a run. Runs with the same question have the same file, so that a newer run replaces an older one."""
    kind = identity["kind"]
    names = {
        "windows": ("predictor", "domain"),
        "stream": ("row", "stream", "of"),
        "study": ("study",),
        "drive": ("predictor", "others", "domain"),
    }[kind]
    slug = re.sub(r"[^A-Za-z0-9.=-]+", "_", "--".join(str(identity[name]) for name in names)).strip("_")[:120]
    return folder / f"{slug}--{digest_of(question(identity))}.json"


@functools.cache
def _packed(path: Path, changed: int) -> tuple[Run, ...]:
    """Runs of a packed file that was last changed at a time; lines that are no runs are named in a warning.

    Raises:
        DataError: the file is damaged.
    """
    try:
        lines = [parse(line) for line in lzma.decompress(path.read_bytes()).splitlines()]
    except (OSError, ValueError, EOFError, lzma.LZMAError) as error:
        raise DataError(f"{path} cannot be read: {error}. Install the package again, or name another folder.") from None
    return tuple(_runs_among(path, {f"line {number}": line for number, line in enumerate(lines, 1)}, "lines"))


def read_folder(folder: Path) -> list[Run]:
    """Runs of the small files in a folder; files that are no runs of this schema are named in a warning."""
    contents: dict[str, Any] = {}
    for path in sorted(path for path in folder.glob("*.json") if path.is_file() or path.is_symlink()):
        try:
            contents[path.name] = parse(path.read_bytes())
        except (OSError, ValueError, RecursionError) as error:
            contents[path.name] = error
    return _runs_among(folder, contents, "files")


def parse(text: bytes) -> Any:
    """A value of JSON; ValueError for NaN and infinities, which are not JSON."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def _runs_among(place: Path, contents: Mapping[str, Any], kind: str) -> list[Run]:
    """Those contents that are runs; a warning names the others, which may be errors."""
    problems = {
        name: str(content) if isinstance(content, Exception) else problem_of(content)
        for name, content in contents.items()
    }
    named = [f"{name} ({problem})" for name, problem in problems.items() if problem]
    if named:
        more = f", and {len(named) - NAMED} more" if len(named) > NAMED else ""
        warnings.warn(
            f"{place} has {len(named)} {kind} that are no results of this version of motion-gym; they are not read, "
            f"and left as they are: {', '.join(named[:NAMED])}{more}",
            RuntimeWarning,
            stacklevel=4,
        )
    return [content for name, content in contents.items() if not problems[name]]


def begin(folder: Path | None, arguments: Sequence[str], resume: bool) -> tuple[str, bool]:
    """Begin a command that writes runs into a folder, or resume the same command if it was interrupted.

    Args:
        folder: Folder of its runs.
        arguments: All arguments of the command that determine its runs.
        resume: Whether to resume.

    Returns:
        Name of the session, and whether an interrupted command has this session.
    """
    if folder is None:
        return secrets.token_hex(8), False
    marker = folder / MARKER
    if resume and marker.is_file():
        try:
            kept = json.loads(marker.read_bytes())
            if kept["arguments"] == list(arguments):
                return str(kept["session"]), True
        except (OSError, ValueError, TypeError, KeyError):
            pass  # an unreadable marker names no command to resume
    session = secrets.token_hex(8)
    write_atomic(marker, json.dumps({"arguments": list(arguments), "session": session}).encode())
    return session, False


def end(folder: Path | None) -> None:
    """End the command that ``begin`` began."""
    if folder is not None:
        (folder / MARKER).unlink(missing_ok=True)
