"""Tables of results, for the terminal and for Markdown, from the same rows."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from motion_gym.contract import DataError
from motion_gym.storage import write_atomic

Result = Mapping[str, Any]
WIDE = 100
"""Columns of a terminal from which on a cell fits one line."""
BEGIN, END = "<!-- results: {name} -->", "<!-- results end -->"


def groups(results: Iterable[Result]) -> list[list[Result]]:
    """Results that may stand in one table: the same domain, split, protocol and k."""
    found: dict[tuple[Any, ...], list[Result]] = {}
    for result in results:
        identity = result["identity"]
        key = (identity["domain"], result["split"], result["protocol"], result["k"])
        found.setdefault(key, []).append(result)
    return list(found.values())


def header(k: int) -> list[str]:
    """Names of the columns for k samples."""
    many = [f"minADE/FDE_{k}", f"JADE/JFDE_{k}"] if k > 1 else []
    return ["predictor", "ADE [95 %]", "FDE [95 %]", "ADE vs. const. velocity", *many]


def row(result: Result, between: str = " ") -> list[str]:
    """The cells of one result; ``between`` stands between a mean and its interval."""
    metrics, k = result["metrics"], result["k"]
    difference = result["versus_baseline"]["ADE"]
    name = result["predictor"] + (" (oracle)" if any(n.startswith("oracle:") for n in result["notes"]) else "")
    cells = [name, _interval(metrics["ADE"], between), _interval(metrics["FDE"], between)]
    cells.append("-" if result["predictor"] == "constant_velocity" else _interval(difference, between, sign=True))
    if k > 1:
        for a, b in ((f"minADE_{k}", f"minFDE_{k}"), (f"JADE_{k}", f"JFDE_{k}")):
            cells.append(f"{_number(metrics[a]['mean'])} / {_number(metrics[b]['mean'])}")
    return cells


def caption(rows: Sequence[Result]) -> list[str]:
    """What a reader must know about a table: counts, protocol, k, leaks, and how weights were selected."""
    first = rows[0]
    ade = first["metrics"]["ADE"]
    lines = [
        f"{ade['agent_windows']} agent-windows of {ade['agents']} agents in {ade['scenes']} scenes "
        f"({first['split']} split); metres; k = {first['k']}; protocol {first['protocol']}; intervals resample agents"
    ]
    lines += [n for n in dict.fromkeys(n for r in rows for n in r["notes"]) if not n.startswith("oracle:")]
    selected: dict[str, list[str]] = {}
    for result in rows:
        selected.setdefault(result["selection"], []).append(result["predictor"])
    lines += [f"{', '.join(names)}: {how}" for how, names in selected.items()]
    return lines


def title(result: Result) -> str:
    """Heading of a table."""
    return str(result["identity"]["spec"])


def print_table(console: Console, rows: Sequence[Result]) -> None:
    """Print one group of results."""
    table = Table(
        title=f"[bold]{escape(title(rows[0]))}", title_justify="left", header_style="bold", box=box.SIMPLE_HEAD
    )
    for number, name in enumerate(header(rows[0]["k"])):
        table.add_column(escape(name), justify="left" if number == 0 else "right", overflow="fold")
    for result in rows:
        table.add_row(*(escape(cell) for cell in row(result, " " if console.width >= WIDE else "\n")))
    console.print(table)
    for line in caption(rows):
        console.print(Padding(escape(line), (0, 0, 0, 2)), style="dim", highlight=False)
    console.print()


def markdown(rows: Sequence[Result]) -> str:
    """One group of results as Markdown."""
    head = header(rows[0]["k"])
    lines = [f"**{title(rows[0])}**", "", f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    lines += [f"| {' | '.join(row(result))} |" for result in rows]
    return "\n".join([*lines, "", "; ".join(caption(rows)[:1]) + "."])


def insert(path: Path, name: str, text: str) -> bool:
    """Replace what stands between the markers ``<!-- results: name -->`` and ``<!-- results end -->``.

    Returns:
        Whether the file changed.

    Raises:
        DataError: the file has no such markers.
    """
    begin = BEGIN.format(name=name)
    old = path.read_text()
    pattern = re.compile(re.escape(begin) + r"\n.*?" + re.escape(END), re.DOTALL)
    if not pattern.search(old):
        raise DataError(f"{path} has no lines `{begin}` and `{END}` to put the table between: add them.")
    new = pattern.sub(lambda _: f"{begin}\n{text}\n{END}", old, count=1)
    if new != old:
        write_atomic(path, new.encode())
    return new != old


def _interval(value: Mapping[str, Any], between: str, sign: bool = False) -> str:
    low, high = _number(value["low"], sign), _number(value["high"], sign)
    return f"{_number(value['mean'], sign)}{between}[{low}, {high}]"


def _number(value: float | None, sign: bool = False) -> str:
    # Without the zero before the point, as papers print it, so that a table fits 80 columns.
    return "-" if value is None else re.sub(r"^([+-]?)0\.", r"\1.", f"{value:{'+' if sign else ''}.3f}")
