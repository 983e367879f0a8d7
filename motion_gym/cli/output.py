"""What the command line prints with."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

console = Console(emoji=False)


def progress_bar() -> Progress:
    """A bar on the error stream with a description, a count and the time left; nothing where that is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    return Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)


def say(text: str) -> None:
    """Print as it is: no markup, no colours, no lines broken."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)
