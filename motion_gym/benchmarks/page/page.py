"""The results page as one file of HTML, made from packed runs and a file of scenes alone."""

from __future__ import annotations

import base64
import dataclasses
import importlib.metadata
import itertools
import json
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.benchmarks import own_rows, running
from motion_gym.benchmarks.claims import claims_page, panels
from motion_gym.benchmarks.claims.sentences import CLAIMS
from motion_gym.benchmarks.identity import SCORING_VERSION
from motion_gym.benchmarks.page import board
from motion_gym.benchmarks.reports import curves, pages
from motion_gym.benchmarks.reports.colors import color_of, styles_of
from motion_gym.benchmarks.reports.curves import Curves
from motion_gym.benchmarks.reports.table import Code, Strong, Table
from motion_gym.benchmarks.running import Results
from motion_gym.contract import DataError
from motion_gym.data.storage import write_atomic

ASSETS = Path(__file__).parent / "assets"
SCRIPTS = ("uPlot.iife.min.js", "sortable.min.js", "board.js", "charts.js", "player.js", "page.js")
STYLES = ("uPlot.min.css", "page.css")


@dataclasses.dataclass(frozen=True)
class Section:
    """What the page shows of one benchmark."""

    name: str
    title: str
    short: Sequence[Table]
    further: Sequence[Table]
    charts: Sequence[int]
    claims: Table | None


def write(out: Path, folder: Path | None, scenes: Mapping[str, Any]) -> None:
    """Write the page.

    Args:
        out: File of the page.
        folder: Folder of results, as ``motion-gym run --out`` writes it, with rows of your own; None for the shipped
            results alone.
        scenes: File of scenes, see ``scenes.compute``.

    Raises:
        DataError: there are no results.
        StorageError: the page cannot be written.
    """
    results = [own_rows.with_stored(name, folder) for name in running.BENCHMARKS]
    write_atomic(out, html(results, scenes).encode())


def html(results: Sequence[Results], scenes: Mapping[str, Any]) -> str:
    """The page.

    Args:
        results: Stored runs of each benchmark.
        scenes: File of scenes.
    """
    import jinja2  # takes a tenth of a second

    entries = [entry for each in results for entry in board.entries_of(each)]
    if not entries:
        raise DataError("There are no stored results to show: compute some with `motion-gym run NAME --out FOLDER`.")
    charts: list[Curves] = []
    sections = [_section(each, charts) for each in results if each.runner.store.runs]
    data = {
        "board": _board(entries),
        "charts": [_chart(chart) for chart in charts],
        "scenes": scenes.get("scenes", []),
        "colors": {row: color_of(row) for row in _methods(entries, scenes)},
    }
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(ASSETS), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["sort_key"] = _sort_key
    environment.tests["code"] = lambda cell: isinstance(cell, Code)
    environment.tests["strong"] = lambda cell: isinstance(cell, Strong)
    return environment.get_template("page.html.j2").render(
        sections=sections,
        ranked={entry.benchmark for entry in entries},
        data=_packed(data),
        ranking=board.RANKING,
        introduction=claims_page.INTRODUCTION,
        version=importlib.metadata.version("motion-gym"),
        scoring_version=SCORING_VERSION,
        runs=sum(len(each.runner.store.runs) for each in results),
        scripts=[(ASSETS / name).read_text() for name in SCRIPTS],
        styles=[(ASSETS / name).read_text() for name in STYLES],
        licenses=(ASSETS / "LICENSES.txt").read_text(),
    )


def _packed(data: Mapping[str, Any]) -> str:
    """JSON as the page carries it: compressed, in base64. `DecompressionStream` of a browser reads it."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def _sort_key(cell: str) -> Any:
    """Attributes of a cell that begins with a number, by which a table is sorted; none for texts."""
    from markupsafe import Markup

    match = re.match(r"[-+<]?\s?\d*\.?\d+", cell)
    return Markup(f' class="number" data-sort="{float(match[0].replace("<", "").strip())}"') if match else ""


def _section(results: Results, charts: list[Curves]) -> Section:
    """The tables, charts and claims of a benchmark; its charts are added to those of the page."""
    benchmark = results.benchmark
    short = pages.short(results)
    first = len(charts)
    charts += _charts(results)
    sentences = [*benchmark.claims, *CLAIMS.get(benchmark.name, ())]
    tested = panels.compare(sentences, claims_page.panels_of(results)) if sentences else []
    return Section(
        benchmark.name,
        benchmark.title,
        short,
        [table for table in pages.everything(results) if table not in short],
        range(first, len(charts)),
        claims_page.verdict_table("Claims", sentences, tested) if sentences else None,
    )


def _charts(results: Results) -> Iterator[Curves]:
    benchmark = results.benchmark
    for drawing in benchmark.drawings:
        part, runs = results.parts[drawing.part]
        if runs:
            yield curves.error_over(part, runs, drawing.metric, drawing.label, drawing.log)
    for study in benchmark.studies:
        if study.curves and study.name in results.studies:
            yield from pages.function(study.curves)(results.studies[study.name])
    for name, shifts in benchmark.shifts.items():
        panels = {kind: rows for kind in shifts.streams if (rows := results.stream_rows(name, kind))}
        if panels:
            yield from curves.over_time(panels, shifts.title)


def _methods(entries: Iterable[board.Entry], scenes: Mapping[str, Any]) -> list[str]:
    drawn = (row for scene in scenes.get("scenes", ()) for row in scene["methods"])
    return list(dict.fromkeys([*(entry.method for entry in entries), *drawn]))


def _board(entries: Sequence[board.Entry]) -> dict[str, Any]:
    """Entries as lists of values; texts that return are numbers of a list of texts."""
    texts: dict[str, int] = {}

    def name(text: str) -> int:
        return texts.setdefault(text, len(texts))

    rows = [
        [
            *map(name, (e.benchmark, e.table, e.method, e.column, e.domain, e.kind, e.protocol, e.unit, e.machine)),
            e.rank,
            *_rounded([e.ade.mean(), *e.interval, e.ade.std(ddof=1) / len(e.ade) ** 0.5 if len(e.ade) > 1 else None]),
            len(e.ade),
            *_rounded([e.fde, e.best]),
            e.k,
            _rounded(e.versus) if e.versus else None,
            *_rounded([e.forecast_seconds * 1e3]),
            list(map(name, e.conditions)),
        ]
        for e in entries
    ]
    return {"texts": list(texts), "rows": rows}


def _chart(chart: Curves) -> dict[str, Any]:
    """A chart with one x axis for all lines; a line has null where it has no value."""
    x = sorted(set(itertools.chain.from_iterable(line.x.tolist() for line in chart.lines.values())))
    place = {value: number_ for number_, value in enumerate(x)}
    styles = styles_of(chart.lines)
    lines = []
    for row, line in chart.lines.items():
        mean: list[float | None] = [None] * len(x)
        spread: list[float | None] = [None] * len(x)
        for value, middle, deviation in zip(line.x.tolist(), line.mean, line.deviation, strict=True):
            mean[place[value]], spread[place[value]] = _rounded([middle, deviation], 3)
        lines.append({"name": row, "color": styles[row][0], "dash": styles[row][1], "mean": mean, "deviation": spread})
    return {
        "title": chart.title,
        "x": _rounded(x, 5),
        "x_label": chart.x_label,
        "y_label": chart.y_label,
        "scale": chart.scale,
        "ticks": list(chart.ticks),
        "marks": [list(mark) for mark in chart.marks],
        "lines": lines,
    }


def _rounded(values: Iterable[float | None], digits: int = 4) -> list[float | None]:
    """Significant digits, so that the page stays small; None for NaN."""
    return [None if v is None or not np.isfinite(v) else float(f"{v:.{digits}g}") for v in values]
