"""Tables of results, for the terminal and for Markdown, from the same rows."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from motion_gym.contract import DataError
from motion_gym.data.storage import write_atomic

Result = Mapping[str, Any]
WIDE = 100
"""Columns of a terminal from which on a cell fits one line."""
BEGIN, END = "<!-- results: {name} -->", "<!-- results end -->"


def groups(results: Iterable[Result]) -> list[list[Result]]:
    """Results that may stand in one table: the same domain, split, protocol and k."""
    return _by(results, lambda r: (r["identity"]["domain"], *_options(r)))


def header(k: int) -> list[str]:
    """Names of the columns for k samples."""
    many = [f"minADE/FDE_{k}", f"JADE/JFDE_{k}"] if k > 1 else []
    return ["predictor", "ADE [95 %]", "FDE [95 %]", "ADE vs. const. velocity", *many]


def row(result: Result, between: str = " ") -> list[str]:
    """The cells of one result; ``between`` stands between a mean and its interval."""
    metrics, k = result["metrics"], result["k"]
    difference = result["versus_baseline"]["ADE"]
    cells = [label(result), _interval(metrics["ADE"], between), _interval(metrics["FDE"], between)]
    cells.append("-" if result["predictor"] == "constant_velocity" else _interval(difference, between, sign=True))
    if k > 1:
        for a, b in ((f"minADE_{k}", f"minFDE_{k}"), (f"JADE_{k}", f"JFDE_{k}")):
            cells.append(f"{number(metrics[a]['mean'])} / {number(metrics[b]['mean'])}")
    return cells


def label(result: Result) -> str:
    """Predictor, with its seed if that is not 0, and marked if it is an oracle."""
    seed = f", seed {result['seed']}" if result["seed"] else ""
    oracle = " (oracle)" if result["oracle"] else ""
    return f"{result['predictor']}{seed}{oracle}"


def counts(result: Result) -> str:
    """What stands behind a score."""
    ade = result["metrics"]["ADE"]
    return (
        f"{ade['agent_windows']} agent-windows of {ade['agents']} agents in {ade['scenes']} scenes; {result['scored']}"
    )


def warnings(rows: Sequence[Result]) -> list[str]:
    """What must stand right under a table: side channels and leaks."""
    return list(dict.fromkeys(leak for result in rows for leak in result["leaks"]))


def conditions(results: Sequence[Result]) -> list[str]:
    """What is true of all tables together: protocol, k, aggregation, how weights were selected."""
    first = results[0]
    lines = [
        f"{first['split']} split, protocol {first['protocol']}, k = {first['k']}; means over agent-windows in metres; "
        "95 % intervals by bootstrap of whole agents",
    ]
    shown = {r["predictor"]: r["reference_scenes"] for r in results if r["reference_scenes"]}
    lines += [f"{name}: was shown {n} reference scenes, disjoint from those scored" for name, n in shown.items()]
    given = dict.fromkeys((r["predictor"], r["shots"]) for r in results if r["shots"])
    lines += [f"{name}: was given {n} scenes of the domain's training split" for name, n in given]
    single = dict.fromkeys(r["predictor"] for r in results if r["samples"] < r["k"])
    lines += [f"{', '.join(single)}: deterministic, one forecast stands for all {first['k']} samples"] if single else []
    selected: dict[str, dict[str, None]] = {}
    for result in results:
        selected.setdefault(result["selection"], {})[result["predictor"]] = None
    return lines + [f"{', '.join(names)}: {how}" for how, names in selected.items()]


def title(result: Result) -> str:
    """Heading of a table."""
    return str(result["spec"])


def print_table(console: Console, rows: Sequence[Result]) -> None:
    """Print one group of results."""
    console.print(f"[bold]{escape(title(rows[0]))}", highlight=False)
    names, between = header(rows[0]["k"]), " " if console.width >= WIDE else "\n"
    # What needs several samples is a table of its own: one with all columns fits no terminal.
    for part in (names[:4], names[:1] + names[4:]):
        table = Table(header_style="bold", box=box.SIMPLE_HEAD)
        for number, name in enumerate(part):
            table.add_column(escape(name), justify="left" if number == 0 else "right", overflow="fold")
        for result in rows:
            cells = dict(zip(names, row(result, between), strict=True))
            table.add_row(*(escape(cells[name]) for name in part))
        if len(part) > 1:
            console.print(table)
    for line in [counts(rows[0]), *warnings(rows)]:
        console.print(Padding(escape(line), (0, 0, 0, 2)), style="dim", highlight=False)
    console.print()


def print_conditions(console: Console, results: Sequence[Result]) -> None:
    """Print what is true of all tables."""
    console.print("differences are paired, negative is better", style="dim", highlight=False)
    for line in conditions(results):
        console.print(escape(line), style="dim", highlight=False)


def markdown(results: Sequence[Result]) -> str:
    """Results as Markdown: a row for each domain, a column for each predictor; a table per split, protocol and k."""
    return "\n\n".join(_markdown_table(part) for part in _by(results, _options))


def _markdown_table(results: Sequence[Result]) -> str:
    tables = groups(results)
    names = list(dict.fromkeys(label(result) for rows in tables for result in rows))
    lines = [f"| domain | {' | '.join(names)} | scored |", f"|---|{'---|' * len(names)}---|"]
    for rows in tables:
        by_name = {label(result): result for result in rows}
        cells = [_cell(by_name[name]) if name in by_name else "" for name in names]
        notes = "".join(f"; {note}" for note in warnings(rows))
        lines.append(f"| `{title(rows[0])}` | {' | '.join(cells)} | {counts(rows[0])}{notes} |")
    k = results[0]["k"]
    best = f", then minADE_{k} / minFDE_{k} and JADE_{k} / JFDE_{k}" if k > 1 else ""
    ends = [f"- {line}." for line in [f"Cells are ADE [95 %] / FDE{best}", *conditions(results)]]
    return "\n".join([*lines, "", *ends])


def insert(path: Path, name: str, text: str) -> bool:
    """Replace what stands between the markers ``<!-- results: name -->`` and ``<!-- results end -->``.

    Returns:
        Whether the file changed.

    Raises:
        DataError: the file has no such markers, or cannot be read.
    """
    old, pattern = check_markers(path, name)
    begin = BEGIN.format(name=name)
    new = pattern.sub(lambda _: f"{begin}\n{text}\n{END}", old, count=1)
    if new != old:
        write_atomic(path, new.encode())
    return new != old


def check_markers(path: Path, name: str) -> tuple[str, re.Pattern[str]]:
    """The text of a file, and what finds the part between the markers in it; DataError if it has none."""
    begin = BEGIN.format(name=name)
    try:
        old = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise DataError(f"{path} cannot be read: {error}. Name a text file to put the table into.") from None
    pattern = re.compile(re.escape(begin) + r"\n(?:(?!<!-- results: ).)*?" + re.escape(END), re.DOTALL)
    if not pattern.search(old):
        raise DataError(f"{path} has no lines `{begin}` and `{END}` to put the table between: add them.")
    return old, pattern


def _cell(result: Result) -> str:
    _, ade, _, _, *best = row(result)
    return ", ".join([f"{ade} / {number(result['metrics']['FDE']['mean'])}", *best])


def _options(result: Result) -> tuple[Any, ...]:
    asked = result["identity"]
    return result["split"], result["protocol"], result["k"], asked["references"], asked["shots"]


def _by(results: Iterable[Result], key: Callable[[Result], Any]) -> list[list[Result]]:
    found: dict[Any, list[Result]] = {}
    for result in results:
        found.setdefault(key(result), []).append(result)
    return list(found.values())


def _interval(value: Mapping[str, Any], between: str, sign: bool = False) -> str:
    low, high = number(value["low"], sign), number(value["high"], sign)
    return f"{number(value['mean'], sign)}{between}[{low}, {high}]"


def number(value: float | None, sign: bool = False) -> str:
    """Three decimals, or ``-`` for None."""
    # Without the zero before the point, as papers print it, so that a table fits 80 columns.
    return "-" if value is None else re.sub(r"^([+-]?)0\.", r"\1.", f"{value:{'+' if sign else ''}.3f}")
