"""One table for every result: columns and rows of text, shown as Markdown, as HTML or in the terminal.

All cells are text. The functions below write numbers, so that every table has one number format.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.contract import SpecError

WIDEST_CELL = 40
"""Columns of the terminal after which the text of a cell is folded."""
WIDE = 100
"""Columns of the terminal from which on a mean and its interval stand in one line."""


class Code(str):
    """Text of a cell that is shown as code, such as a spec."""

    __slots__ = ()


class Strong(str):
    """Text of a cell that is shown in bold, such as the best value."""

    __slots__ = ()


@dataclass(frozen=True)
class Table:
    """A table with what must be said of it.

    Attributes:
        title: Heading.
        columns: Names of the columns.
        rows: Cells of each row, as many as there are columns.
        notes: Sentences without a full stop, shown under the table.
        caption: What the cells are, shown above the table.
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

    def markdown(self, heading: int = 3) -> str:
        """The table as Markdown.

        Args:
            heading: Level of the heading; 0 writes the title in bold before the caption, as in a README.
        """
        title = f"{'#' * heading} {self.title}" if heading else f"**{self.title}.** {self.caption}".rstrip()
        parts = [title] if self.title else []
        parts += [self.caption] if heading and self.caption else []
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        parts.append("\n".join(f"| {' | '.join(_markdown(cell) for cell in line)} |" for line in lines))
        parts += ["\n".join(f"- {_plain(note)}." for note in self.notes)] if self.notes else []
        return "\n\n".join(parts)

    def html(self) -> str:
        """The table as a plain HTML table; every text is escaped."""
        head = "".join(f"<th>{html.escape(column)}</th>" for column in self.columns)
        body = "\n".join(f"<tr>{''.join(f'<td>{_html(cell)}</td>' for cell in row)}</tr>" for row in self.rows)
        caption = ". ".join(html.escape(text) for text in (self.title, self.caption) if text)
        notes = "".join(f"<li>{html.escape(note)}.</li>\n" for note in self.notes)
        return (
            f"<table>\n<caption>{caption}</caption>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"
            + (f"\n<ul>\n{notes}</ul>" if notes else "")
        )

    def __rich_console__(self, console: Any, options: Any) -> Iterator[Any]:
        """Print the table with rich; columns that do not fit side by side go into a second table with the same rows."""
        from rich import box
        from rich.padding import Padding
        from rich.table import Table as Grid
        from rich.text import Text

        width = options.max_width
        rows = [[cell if width >= WIDE else cell.replace(" [", "\n[") for cell in row] for row in self.rows]
        yield Text(self.title, style="bold")
        if self.caption:
            yield Text(self.caption, style="dim")
        for part in _fitting([list(column) for column in zip(self.columns, *rows, strict=True)], width):
            grid = Grid(header_style="bold", box=box.SIMPLE_HEAD)
            for number, column in enumerate(part):
                shortest = max(map(len, column[0].split()), default=0)
                numeric = all(re.match(r"[-+<.\d]|$", cell) for cell in column[1:])
                justify: Any = "right" if number and numeric else "left"
                grid.add_column(Text(column[0]), justify=justify, overflow="fold", min_width=min(shortest, 20))
            for cells in zip(*(column[1:] for column in part), strict=True):
                grid.add_row(*map(Text, cells))
            yield grid
        for note in self.notes:
            yield Padding(Text(note, style="dim"), (0, 0, 0, 2))
        yield Text()


def _fitting(columns: Sequence[list[str]], width: int) -> list[list[list[str]]]:
    """Columns in parts that fit a width, each part with the first column."""
    first, *others = columns
    parts, used = [[first]], _width(first)
    for column in others:
        if len(parts[-1]) > 1 and used + _width(column) > width:
            parts.append([first])
            used = _width(first)
        parts[-1].append(column)
        used += _width(column)
    return parts


def _width(column: Sequence[str]) -> int:
    words, lines = column[0].split(), [line for cell in column[1:] for line in cell.split("\n")]
    return min(max(map(len, [*words, *lines]), default=0), WIDEST_CELL) + 3


def _markdown(cell: str) -> str:
    if isinstance(cell, Code):
        text = cell.replace("`", "'").replace("<!--", "&lt;!--").replace("|", r"\|")
        return f"`{text}`"
    text = _plain(cell).replace("|", r"\|").replace("\n", " ")
    return f"**{text}**" if isinstance(cell, Strong) else text


def _plain(text: str) -> str:
    """Text that holds no HTML tag and no comment, so that no marker of a file can come from it."""
    return re.sub(r"<(?=[A-Za-z/!])", "&lt;", text)


def _html(cell: str) -> str:
    text = html.escape(cell)
    tag = "code" if isinstance(cell, Code) else "strong" if isinstance(cell, Strong) else None
    return f"<{tag}>{text}</{tag}>" if tag else text


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


def pair(first: str, second: str) -> str:
    """Two cells in one, as ADE / FDE."""
    return f"{first} / {second}"


def percent(share: float) -> str:
    """A relative difference with its sign, as ``+12 %``."""
    return f"{100 * share:+.0f} %"


def p_text(value: float | None) -> str:
    """A p-value."""
    return "< .001" if value is not None and value < 0.001 else number(value)


def span(values: Iterable[float]) -> str:
    """``3`` for one distinct value, ``3 to 5`` for several."""
    there = sorted(set(values))
    return f"{there[0]}" if len(there) == 1 else f"{there[0]} to {there[-1]}"
