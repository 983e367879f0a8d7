"""Printing and progress bars, and the start and end of commands that write runs."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, TextIO

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from motion_gym.benchmarks import store
from motion_gym.benchmarks.jobs import Runner
from motion_gym.benchmarks.reports.table import visible
from motion_gym.contract import PredictorError
from motion_gym.data.storage import StorageError

NARROWEST = 40
"""Characters; where COLUMNS says less, as 0 in some jobs, tables are as wide as in a terminal of 80."""


class Terminal(Console):
    """A console on which no text of a file or a name acts on the terminal."""

    def __init__(self, **options: Any):
        super().__init__(emoji=False, **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print with the control characters of texts shown as their escapes."""
        super().print(*(visible(part) if isinstance(part, str) else part for part in objects), **options)


console = Terminal()
if console.width < NARROWEST:
    console = Terminal(width=80)
Out = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]
Text = Annotated[str | None, tyro.conf.arg(metavar="TEXT")]
Json = Annotated[bool, tyro.conf.arg(name="json")]
_json_to: TextIO | None = None
SECONDS_BETWEEN_LINES = 20.0
"""Shortest time between two lines of progress where the error stream is not a terminal."""


def progress_bar() -> Progress:
    """A bar on the error stream with a description, a count and the time left; hidden outside a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    return Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)


def reporter(progress: Progress, title: str) -> Callable[[int, int, str], None]:
    """A function that shows the number of finished steps, the number of all steps, and a label.

    It moves a bar in a terminal, and prints a line now and then elsewhere, as in the log of a job.
    """
    task: Any = progress.add_task(escape(visible(title)), total=None)
    last = time.monotonic()

    def report(done: int, total: int, label: str) -> None:
        nonlocal last
        label = visible(label)
        progress.update(task, total=total, completed=done, description=escape(label))
        if progress.disable and time.monotonic() - last >= SECONDS_BETWEEN_LINES:
            last = time.monotonic()
            print(f"{done} of {total} done: {label}", file=sys.stderr, flush=True)

    return report


@contextlib.contextmanager
def only_json() -> Iterator[None]:
    """Keep the standard output for ``print_json``: all else, as what predictors print, goes to the error stream."""
    global _json_to
    _json_to = sys.stdout
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _json_to = None


def print_json(value: Any) -> None:
    """Print a value of JSON types to the standard output."""
    print(json.dumps(value, indent=1, allow_nan=False), file=_json_to or sys.stdout)


def say(text: str) -> None:
    """Print without markup, colours and line breaks."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def shown(path: Path, start: Path) -> Path:
    """A path as it is printed: relative to the folder where the command began, if it lies there."""
    return path.relative_to(start) if path.is_relative_to(start) else path


def begin(folder: Path | None, arguments: Sequence[str], resume: bool) -> str:
    """Begin a command that writes runs into a folder, or resume the interrupted one; returns its session."""
    place = None if folder is None else shown(folder, Path.cwd())
    session, resumed = store.begin(folder, arguments, resume)
    if resume:
        message = (
            f"Going on with the same command, which was interrupted: its runs in {place} are reused."
            if resumed
            else f"There is no interrupted command with these arguments in {place}: it begins anew."
        )
        print(message, file=sys.stderr)
    return session


def end(folder: Path | None, runner: Runner) -> None:
    """End a command that writes runs into a folder.

    Raises:
        PredictorError: rows are not shown. The command can be resumed.
        StorageError: runs could not be written.
    """
    if message := runner.not_shown():
        raise PredictorError(message)
    if runner.unwritten:
        raise StorageError("\n".join(runner.unwritten))
    store.end(folder)
