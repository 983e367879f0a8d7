"""One class for all tables: columns and rows of text, shown as Markdown or in the terminal.

The functions below format numbers, so that all tables have one number format.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.contract import SpecError

WIDEST_CELL = 40
"""Characters after which the text of a cell is folded in the terminal."""
GAP = 3
"""Characters between two columns in the terminal."""
WIDE = 100
"""Width of the terminal, in characters, from which on a mean and its interval are on one line."""


CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Characters that act on a terminal, or turn the direction of the text."""


class Code(str):
    """Text of a cell that is shown as code, such as a spec."""

    __slots__ = ()


class Strong(str):
    """Text of a cell that is shown in bold, such as the best value."""

    __slots__ = ()


@dataclass(frozen=True)
class Table:
    """A table with its caption and notes.

    Attributes:
        title: Heading.
        columns: Names of the columns.
        rows: Cells of each row, one for each column.
        notes: Sentences without a full stop, shown under the table.
        caption: Description of the cells, shown above the table.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()
    caption: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise SpecError(
                    f"Table `{self.title}` has {len(self.columns)} columns, and the row {list(row)} has {len(row)} "
                    "cells: give one cell for each column."
                )
        for name in ("title", "columns", "rows", "notes", "caption"):
            object.__setattr__(self, name, _plain_text(getattr(self, name)))

    def markdown(self, heading: int = 3) -> str:
        """The table as Markdown.

        Args:
            heading: Level of the heading; 0 writes the title in bold before the caption, as in a README.
        """
        named, caption = _one_line(self.title), _one_line(self.caption)
        title = f"{'#' * heading} {named}" if heading else f"**{named}.** {caption}".rstrip()
        parts = [title] if named else []
        parts += [caption] if heading and caption else []
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        parts.append("\n".join(f"| {' | '.join(_markdown(cell) for cell in line)} |" for line in lines))
        parts += ["\n".join(f"- {_one_line(note)}." for note in self.notes)] if self.notes else []
        return "\n\n".join(parts)

    def __rich_console__(self, console: Any, options: Any) -> Iterator[Any]:
        """Print the table with rich; columns that do not fit side by side go into a second table with the same rows.

        The second table begins with as many columns of the first one as tell its rows apart.
        """
        from rich import box
        from rich.padding import Padding
        from rich.table import Table as Grid
        from rich.text import Text

        width = options.max_width
        rows = [[cell if width >= WIDE else cell.replace(" [", "\n[") for cell in row] for row in self.rows]
        yield Text(self.title, style="bold")
        if self.caption:
            yield Text(self.caption, style="dim")
        columns = [list(column) for column in zip(self.columns, *rows, strict=True)]
        for part in _fitting(columns, _keys(rows), width):
            grid = Grid(header_style="bold", box=box.SIMPLE_HEAD)
            for number, (column, of_column) in enumerate(zip(part, _widths(part, width), strict=True)):
                numeric = all(re.match(r"[-+<.\d]|$", cell) for cell in column[1:])
                justify: Any = "right" if number and numeric else "left"
                grid.add_column(Text(column[0]), justify=justify, overflow="fold", width=of_column)
            for cells in zip(*(column[1:] for column in part), strict=True):
                grid.add_row(*map(Text, cells))
            yield grid
        for note in self.notes:
            yield Padding(Text(note, style="dim"), (0, 0, 0, 2))
        yield Text()


def _plain_text(value: Any) -> Any:
    """Texts, in lists or not, in which no character acts on a terminal or ends a line, but for the lines of a cell."""
    if isinstance(value, str):
        kind = type(value)
        return kind(visible(value) if kind is str else visible(value).replace("\n", " "))
    return [_plain_text(part) for part in value]


def visible(text: str) -> str:
    """Text whose control characters are shown as their escapes, except line breaks and tabs."""
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def _keys(rows: Sequence[Sequence[str]]) -> int:
    """Number of first columns that tell the rows apart, up to three; 1 if they do not."""
    counts = range(1, 4)
    return next((count for count in counts if len({tuple(row[:count]) for row in rows}) == len(rows)), 1)


def _fitting(columns: Sequence[list[str]], keys: int, width: int) -> list[list[list[str]]]:
    """Columns in groups that fit a width; each group begins with the first ``keys`` columns."""
    first, others = columns[:keys], columns[keys:]
    parts = [[*first]]
    for column in others:
        if len(parts[-1]) > keys and sum(map(_width, [*parts[-1], column])) >= width:
            parts.append([*first])
        parts[-1].append(column)
    return parts


def _widths(columns: Sequence[list[str]], width: int) -> Sequence[int | None]:
    """Widths at which no word of a column is broken, wider where there is room; None if there is none."""
    room = width - 1 - sum(map(_width, columns))
    if room < 0:
        return [None] * len(columns)
    widths = []
    for column in columns:
        least = _width(column) - GAP
        longest = max(len(line) for cell in column for line in cell.split("\n"))
        widths.append(least + min(room, max(longest - least, 0)))
        room -= widths[-1] - least
    return widths


def _width(column: Sequence[str]) -> int:
    """The least width of a column: longer lines than ``WIDEST_CELL`` are folded, and its head between words."""
    words, lines = column[0].split(), [line for cell in column[1:] for line in cell.split("\n")]
    return min(max(map(len, [*words, *lines]), default=0), WIDEST_CELL) + GAP


def _markdown(cell: str) -> str:
    if isinstance(cell, Code):
        text = cell.replace("`", "'").replace("<!--", "&lt;!--").replace("|", r"\|")
        return f"`{text}`"
    text = _one_line(cell).replace("|", r"\|")
    return f"**{text}**" if isinstance(cell, Strong) else text


def _one_line(text: str) -> str:
    """Text in one line, without HTML tags and comments, so that it contains no marker of a file."""
    return re.sub(r"<(?=[A-Za-z/!?])", "&lt;", text.replace("\n", " "))


def number(value: float | None, sign: bool = False) -> str:
    """Three decimals, or ``-`` for None and NaN.

    The zero before the point is left out, as papers print it, so that a table fits 80 columns.
    """
    if value is None or np.isnan(value):
        return "-"
    return re.sub(r"^([+-]?)0\.", r"\1.", f"{value:{'+' if sign else ''}.3f}")


def spread(values: Iterable[float], sign: bool = False) -> str:
    """Mean ± standard error of several values, or the one value."""
    table = np.asarray(list(values), dtype=float)
    if len(table) < 2:
        return number(float(table[0]) if len(table) else None, sign)
    return f"{number(float(table.mean()), sign)} ± {number(float(table.std(ddof=1) / np.sqrt(len(table))))}"


def interval(value: Mapping[str, Any], sign: bool = False) -> str:
    """``mean [low, high]`` of a summary of a card."""
    return f"{number(value['mean'], sign)} [{number(value['low'], sign)}, {number(value['high'], sign)}]"


def percent(share: float) -> str:
    """A relative difference with its sign, as ``+12 %``."""
    return f"{100 * share:+.0f} %"


def p_text(value: float | None) -> str:
    """A p-value."""
    return "< .001" if value is not None and value < 0.001 else number(value)


def span(values: Iterable[float]) -> str:
    """``3`` for one distinct value, ``3 to 5`` for several."""
    ordered = sorted(set(values))
    return f"{ordered[0]}" if len(ordered) == 1 else f"{ordered[0]} to {ordered[-1]}"
