"""The store of runs: small files while a command runs, one packed file per benchmark in the package.

Nothing in a folder of results is trusted to be whole: a file that is not a run of this schema is named in a warning
and left as it is.
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
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from motion_gym.benchmarks.identity import canonical, digest_of, question
from motion_gym.benchmarks.run_schema import SCHEMA, problem_of
from motion_gym.contract import DataError
from motion_gym.data.storage import write_atomic
from motion_gym.training.provenance import commit, versions

Run = dict[str, Any]
SHIPPED = Path(__file__).parent.parent / "results"
"""Folder of the packed runs, tables and figures that ship with the package."""
CURVES = ("curve", "shifts")
"""Keys of an online run that are packed into a file of their own: they are most of it, and few tables need them."""
MARKER = ".command"
"""File in a folder of results that names the command that writes there; it is deleted when that command ends."""
NAMED = 5
"""Most files that one warning names."""


class Store:
    """Runs of one benchmark: those that ship, those of a packed file and the small files of a folder; later ones win.

    Args:
        name: Name of the benchmark; None for a folder of scores.
        folder: Where new runs are written, one small file each; None to write nothing.
        shipped: Folder of the packed files that are read first.
    """

    def __init__(self, name: str | None, folder: Path | None = None, shipped: Path = SHIPPED):
        self.name, self.folder = name, folder
        self.runs: dict[str, Run] = {}
        """Runs by their question."""
        self.places = list(dict.fromkeys([shipped, *([folder.parent] if folder else [])]))
        """Folders of packed files."""
        for place in self.places:
            if name is not None and (packed := place / f"{name}.jsonl.xz").is_file():
                self.take(read_packed(packed))
        if folder is not None and folder.is_dir():
            self.take(read_folder(folder))

    def take(self, runs: Iterable[Run]) -> None:
        """Add runs; each replaces one that was asked the same."""
        self.runs |= {question(run["identity"]): run for run in runs}

    def find(self, identity: Mapping[str, Any]) -> Run | None:
        """The run of an identity; None if it is missing, or was made with other weights, data or versions."""
        identity = canonical(identity)
        run = self.runs.get(question(identity))
        return run if run is not None and run["identity"] == identity else None

    def get(self, identity: Mapping[str, Any], compute: Callable[[], Mapping[str, Any]]) -> Run:
        """The run of an identity: kept, or computed now and written.

        Raises:
            StorageError: it could not be written; ``find`` gives it all the same.
        """
        run = self.find(identity)
        if run is None:
            run = run_of(identity, compute())
            self.take([run])
            write(self.folder, run)
        return run

    def with_curves(self) -> None:
        """Read the curves of packed online runs as well."""
        for place in self.places:
            for line in _lines(place / f"{self.name}-curves.jsonl.xz"):
                run = self.runs.get(line.pop("question"))
                if run is not None and run["provenance"]["finished"] == line.pop("finished"):
                    run.update(line)

    def pack(self, place: Path) -> list[Path]:
        """Write all runs into one file, and the curves into another, as sorted lines of JSON; returns their paths.

        Runs of a user's own predictors stay in small files of the folder; the small files of others are deleted.
        """
        self.with_curves()
        lines, curves = [], []
        shipped = {key: run for key, run in self.runs.items() if run["identity"].get("session") is None}
        for key, run in sorted(shipped.items()):
            apart = {name: run[name] for name in CURVES if name in run}
            lines.append({name: _short(value) if name == "metrics" else value for name, value in run.items()
                          if name not in apart})  # fmt: skip
            if apart:
                curves.append({"question": key, "finished": run["provenance"]["finished"], **apart})
        paths = []
        for path, content in ((f"{self.name}.jsonl.xz", lines), (f"{self.name}-curves.jsonl.xz", curves)):
            if content:
                text = "".join(json.dumps(line, sort_keys=True, allow_nan=False) + "\n" for line in content)
                write_atomic(place / path, lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))
                paths.append(place / path)
        if self.folder is not None:
            for run in shipped.values():
                path_of(self.folder, run["identity"]).unlink(missing_ok=True)
        return paths


def run_of(identity: Mapping[str, Any], result: Mapping[str, Any]) -> Run:
    """A run made of what determines a result, and of the result in JSON types."""
    return {"schema": SCHEMA, **result, "identity": canonical(identity), "provenance": provenance()}


def provenance() -> dict[str, Any]:
    """What is recorded beside a result and is no part of its identity, in JSON types."""
    return {
        "versions": versions(),
        "commit": commit(),
        "machine": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "finished": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="milliseconds"),
        "command": sys.argv[1:],
    }


def write(folder: Path | None, run: Run) -> None:
    """Write a run to a file of its own in a folder; nothing without a folder."""
    if folder is not None:
        content = json.dumps(run, indent=1, allow_nan=False) + "\n"
        write_atomic(path_of(folder, run["identity"]), content.encode())


def path_of(folder: Path, identity: Mapping[str, Any]) -> Path:
    """File of a run: the same for the same question, so that a newer answer replaces an older one."""
    kind = identity["kind"]
    names = {"windows": ("predictor", "domain"), "stream": ("row", "stream", "of"), "study": ("study",)}[kind]
    slug = re.sub(r"[^A-Za-z0-9.=-]+", "_", "--".join(str(identity[name]) for name in names)).strip("_")[:120]
    return folder / f"{slug}--{digest_of(question(identity))}.json"


@functools.cache
def _packed(path: Path, changed: int) -> tuple[Run, ...]:
    runs, problems = [], []
    for number, line in enumerate(_lines(path), 1):
        if isinstance(line.get("metrics"), dict):
            line["metrics"] = _long(line["metrics"])
        problem = problem_of({"curve": [], "shifts": [], **line})
        if problem:
            problems.append(f"line {number} ({problem})")
        else:
            runs.append(line)
    _warn(path, problems, "lines")
    return tuple(runs)


def read_packed(path: Path) -> tuple[Run, ...]:
    """Runs of a packed file, without the curves; lines that are no runs are named in a warning."""
    return _packed(path, path.stat().st_mtime_ns)


def read_folder(folder: Path) -> list[Run]:
    """Runs of the small files in a folder; files that are no runs of this schema are named in a warning, not read."""
    runs, problems = [], []
    for path in sorted(folder.glob("*.json")):
        try:
            content = json.loads(path.read_bytes(), parse_constant=_refuse)
        except (OSError, ValueError, RecursionError) as error:
            problems.append(f"{path.name} ({error})")
            continue
        if problem := problem_of(content):
            problems.append(f"{path.name} ({problem})")
        else:
            runs.append(content)
    _warn(folder, problems, "files")
    return runs


def begin(folder: Path | None, arguments: Sequence[str], resume: bool) -> tuple[str, bool]:
    """Begin a command that writes runs into a folder, or go on with the same one that was interrupted.

    Args:
        folder: Where its runs go.
        arguments: What the command does, in full.
        resume: Whether to go on.

    Returns:
        Name of the session, and whether it is that of an interrupted command.
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
            pass  # an unreadable marker names no command to go on with
    session = secrets.token_hex(8)
    write_atomic(marker, json.dumps({"arguments": list(arguments), "session": session}).encode())
    return session, False


def end(folder: Path | None) -> None:
    """End the command that ``begin`` began."""
    if folder is not None:
        (folder / MARKER).unlink(missing_ok=True)


def _lines(path: Path) -> list[dict[str, Any]]:
    """Objects of a packed file; none where it is missing.

    Raises:
        DataError: it is damaged.
    """
    if not path.is_file():
        return []
    try:
        text = lzma.decompress(path.read_bytes()).decode()
        lines = [json.loads(line, parse_constant=_refuse) for line in text.splitlines()]
    except (OSError, ValueError, EOFError, lzma.LZMAError) as error:
        raise DataError(f"{path} cannot be read: {error}. Install the package again, or name another folder.") from None
    return [line for line in lines if isinstance(line, dict)]


def _short(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Metrics of which those that repeat an earlier one are its name, as best of 20 of a deterministic predictor."""
    kept: dict[str, Any] = {}
    for name, value in metrics.items():
        same = next((other for other, content in kept.items() if content == value), None)
        kept[name] = value if same is None else same
    return kept


def _long(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """What ``_short`` was made of."""
    return {name: metrics.get(value) if isinstance(value, str) else value for name, value in metrics.items()}


def _warn(place: Path, problems: Sequence[str], what: str) -> None:
    if problems:
        more = f", and {len(problems) - NAMED} more" if len(problems) > NAMED else ""
        warnings.warn(
            f"{place} has {len(problems)} {what} that are no results of this version of motion-gym; they are not read, "
            f"and left as they are: {', '.join(problems[:NAMED])}{more}",
            RuntimeWarning,
            stacklevel=4,
        )


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON")
