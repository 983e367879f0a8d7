"""What is shown of a benchmark: tables and figures, made from stored runs and studies alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks import running
from motion_gym.benchmarks.jobs import best_settings
from motion_gym.benchmarks.objects import BASELINE, NONE, ORACLE
from motion_gym.benchmarks.own_rows import comparison_tables
from motion_gym.benchmarks.reports import claims, claims_page, online_tables, seed_tables
from motion_gym.benchmarks.reports.conditions import version_of
from motion_gym.benchmarks.reports.sentences import CLAIMS
from motion_gym.benchmarks.reports.table import Table
from motion_gym.benchmarks.running import Results
from motion_gym.data.storage import write_atomic


def short(results: Results) -> list[Table]:
    """The tables that ``motion-gym run`` prints."""
    version_of(every_run(results))
    chosen = results.benchmark.short
    if isinstance(chosen, str):
        tables = [_function(chosen)([(part, runs) for part, runs in results.parts if runs])]
    else:
        shown = [results.parts[number] for number in chosen if number < len(results.parts)]
        tables = [seed_tables.short_table(part, runs) for part, runs in shown if runs]
    sudden = {name: rows for name in results.tried if (rows := stream_rows(results, name, "sudden"))}
    if sudden:
        titles = {name: results.benchmark.shifts[name].title for name in sudden}
        tables.append(online_tables.summary_table(titles, sudden))
    numbers = range(len(results.parts)) if isinstance(chosen, str) else chosen
    titles_shown = {part.title for number, (part, _) in enumerate(results.parts) if number in numbers}
    titles_shown |= {these.title for these in results.benchmark.shifts.values()}
    beside = [table for table in comparison_tables(results) if table.title.rpartition(":")[0] in titles_shown]
    return [*(tables or _study_tables(results)), *beside]


def everything(results: Results) -> list[Table]:
    """All tables: of the parts, of claims and studies, and of streams."""
    results.kept.with_curves()
    version_of(every_run(results))
    parts = [(part, runs) for part, runs in results.parts if runs]
    by_part = [seed_tables.part_tables(part, runs) for part, runs in parts]
    tables = [table for group in by_part[:1] for table in group]
    if len(parts) == len(results.parts):  # these need all rows
        tables += [_function(name)(parts) for name in results.benchmark.tables]
    if results.benchmark.claims and parts:
        comparisons = claims.compare(results.benchmark.claims, claims.part_panels(parts))
        tables.append(claims.claims_table(comparisons, results.benchmark.claims_over))
    tables += _study_tables(results)
    tables += [table for group in by_part[1:] for table in group]
    for name in results.tried:
        tables += _shift_tables(results, name)
    return [*tables, *comparison_tables(results)]


def write(results: Results, folder: Path) -> list[Path]:
    """Write ``tables.md`` and the figures of a benchmark into a folder; returns their paths."""
    from motion_gym.benchmarks.reports import figures  # matplotlib takes a second

    results.kept.with_curves()
    path = folder / "tables.md"
    text = "\n\n".join(table.markdown() for table in everything(results))
    write_atomic(path, f"# {results.benchmark.title}\n\n{text}\n".encode())
    paths = [path]
    for drawing in results.benchmark.drawings:
        part, runs = results.parts[drawing.part]
        if runs:
            paths.append(folder / drawing.file)
            figures.error_over(part, runs, drawing.metric, paths[-1], drawing.label, drawing.log)
    for study in results.benchmark.studies:
        if study.draw and study.name in results.studies:
            paths.append(folder / study.file)
            _function(study.draw)(results.studies[study.name], paths[-1])
    for name, these in results.benchmark.shifts.items():
        panels = {kind: rows for kind in these.streams if (rows := stream_rows(results, name, kind))}
        if panels:
            paths.append(folder / f"{name}.svg")
            figures.over_time(panels, paths[-1], these.title)
    return paths


def claims_about(benchmarks: Sequence[str] = tuple(CLAIMS)) -> str:
    """The page of all sentences about results, held against the stored runs of benchmarks, as Markdown."""
    panels = {}
    for name in benchmarks:
        results = running.run(name)
        results.kept.with_curves()
        shifts = {
            shift: (these.title, {kind: stream_rows(results, shift, kind) for kind in these.streams})
            for shift, these in results.benchmark.shifts.items()
        }
        panels[name] = claims_page.panels_of(name, results.parts, results.studies, shifts)
    sentences = {name: [*running.benchmark(name).claims, *CLAIMS.get(name, ())] for name in benchmarks}
    return claims_page.page(sentences, panels)


def stream_rows(results: Results, name: str, kind: str) -> dict[str, list[Any]]:
    """Runs of the seeds by row, of one kind of stream; none unless the rows that others are compared with are there."""
    rows = {row: runs for (shifts, one, row), runs in results.streams.items() if (shifts, one) == (name, kind)}
    return rows if {BASELINE, NONE, ORACLE} <= rows.keys() else {}


def _shift_tables(results: Results, name: str) -> list[Table]:
    these, tried = results.benchmark.shifts[name], results.tried[name]
    tables = []
    if NONE in tried:
        tables.append(online_tables.choice_table(" then ".join(these.chosen_on["domains"]), these.chosen_with, tried))
    for kind in these.streams:
        rows = stream_rows(results, name, kind)
        if rows:
            title = f"{these.title}: {kind}"
            tables.append(online_tables.stream_table(title, rows, best_settings(tried)))
            tables += [online_tables.milestones_table(f"{title}, after the shift", rows)] if kind == "sudden" else []
    return tables


def every_run(results: Results) -> list[Any]:
    """All runs that tables are made from."""
    runs: Sequence[Any] = [run for _, part in results.parts for run in part]
    return [*runs, *(run for seeds in results.streams.values() for run in seeds)]


def _study_tables(results: Results) -> list[Table]:
    return [
        _function(study.render)(results.studies[study.name])
        for study in results.benchmark.studies
        if study.render and study.name in results.studies
    ]


def _function(target: str) -> Any:
    return catalog.load_class(target, "function")
