"""What the command line prints with, and the options that several verbs share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from motion_gym.benchmarks import store

console = Console(emoji=False)
Out = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]
Text = Annotated[str | None, tyro.conf.arg(metavar="TEXT")]


def progress_bar() -> Progress:
    """A bar on the error stream with a description, a count and the time left; nothing where that is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    return Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)


def reporter(progress: Progress, title: str) -> Callable[[int, int, str], None]:
    """A function that shows on a bar: the number of steps done, of all, and what is next."""
    task: Any = progress.add_task(escape(title), total=None)

    def report(done: int, of: int, what: str) -> None:
        progress.update(task, total=of, completed=done, description=escape(what))

    return report


def say(text: str) -> None:
    """Print as it is: no markup, no colours, no lines broken."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def session_of(folder: Path | None, arguments: Sequence[str], resume: bool) -> str:
    """Begin a command that writes runs into a folder, or go on with the interrupted one, and say so."""
    session, resumed = store.begin(folder, arguments, resume)
    if resume:
        say(
            f"Going on with the same command, which was interrupted: its runs in {folder} are reused."
            if resumed
            else f"There is no interrupted command with these arguments in {folder}: it begins anew."
        )
    return session
