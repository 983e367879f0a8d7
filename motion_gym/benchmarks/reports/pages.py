"""The tables and figures of a benchmark, made from stored runs and studies alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks.claims import panels
from motion_gym.benchmarks.drives import Drives
from motion_gym.benchmarks.jobs import best_settings
from motion_gym.benchmarks.objects import NONE
from motion_gym.benchmarks.own_rows import comparison_tables
from motion_gym.benchmarks.reports import curves, drive_tables, online_tables, seed_tables
from motion_gym.benchmarks.reports.conditions import unit_of
from motion_gym.benchmarks.reports.table import Table
from motion_gym.benchmarks.running import Results
from motion_gym.benchmarks.store import Run
from motion_gym.data.storage import write_atomic


def short(results: Results) -> list[Table]:
    """The tables that ``motion-gym run`` prints."""
    numbers, shifts = results.benchmark.short, results.benchmark.shifts
    parts = [part for number, part in enumerate(results.parts) if part[1] and (number in numbers or not numbers)]
    if numbers:
        tables = [seed_tables.short_table(*part) for part in parts]
    else:
        tables = [function(name)(parts) for name in results.benchmark.tables]
    for drives, runs in driven(results)[:1]:
        tables += [drive_tables.score_table(drives, runs), drive_tables.correlation_table(drives, runs)]
    sudden = {name: rows for name in results.errors if (rows := results.stream_rows(name, "sudden"))}
    units = {name: unit_of([run for runs in rows.values() for run in runs]) for name, rows in sudden.items()}
    for unit in dict.fromkeys(units.values()):
        own = {name: rows for name, rows in sudden.items() if units[name] == unit}
        tables.append(online_tables.summary_table({name: shifts[name].title for name in own}, own))
    titles = {part.title for part, _ in parts} | {shift.title for shift in shifts.values()}
    comparisons = [table for title, table in comparison_tables(results).items() if title in titles]
    return [*(tables or _study_tables(results)), *comparisons]


def everything(results: Results) -> list[Table]:
    """All tables: of the parts, of claims and studies, and of streams."""
    parts = [part for part in results.parts if part[1]]
    by_part = [seed_tables.part_tables(*part) for part in parts]
    tables = [table for group in by_part[:1] for table in group]
    if len(parts) == len(results.parts):  # these tables need all rows
        tables += [function(name)(parts) for name in results.benchmark.tables]
    if results.benchmark.claims and parts:
        comparisons = panels.compare(results.benchmark.claims, panels.part_panels(parts))
        tables.append(panels.claims_table(comparisons, results.benchmark.claims_over))
    tables += _study_tables(results)
    for drives, runs in driven(results):
        tables += drive_tables.tables(drives, runs)
    tables += [table for group in by_part[1:] for table in group]
    for name in results.errors:
        tables += _shift_tables(results, name)
    if combined := results.with_experts():
        titles = {name: shift.title for name, shift in results.benchmark.shifts.items()}
        tables.append(online_tables.regret_table(titles, combined))
    return [*tables, *comparison_tables(results).values()]


def driven(results: Results) -> list[tuple[Drives, list[Run]]]:
    """Tables of driven episodes with at least one complete row."""
    return [(drives, runs) for drives, runs in results.drives if drive_tables.by_cell(drives, runs)]


def write(results: Results, folder: Path) -> list[Path]:
    """Write ``tables.md`` and the figures of a benchmark into a folder; returns their paths."""
    from motion_gym.benchmarks.reports import figures  # matplotlib takes a second

    paths = [folder / "tables.md"]
    text = "\n\n".join(table.markdown() for table in everything(results))
    write_atomic(paths[0], f"# {results.benchmark.title}\n\n{text}\n".encode())
    for drawing in results.benchmark.drawings:
        part, runs = results.parts[drawing.part]
        if runs:
            paths.append(folder / drawing.file)
            figures.draw([curves.error_over(part, runs, drawing.metric, drawing.label, drawing.log)], paths[-1])
    for study in results.benchmark.studies:
        if study.file and study.name in results.studies:
            paths.append(folder / study.file)
            if study.curves:
                figures.draw(function(study.curves)(results.studies[study.name]), paths[-1])
            else:
                function(study.draw)(results.studies[study.name], paths[-1])
    for number, (drives, runs) in enumerate(driven(results)):
        paths.append(folder / f"score_by_error_{number + 1}.svg")
        figures.score_by_error(drives, runs, paths[-1])
    for name, shifts in results.benchmark.shifts.items():
        panels = {kind: rows for kind in shifts.streams if (rows := results.stream_rows(name, kind))}
        if panels:
            paths.append(folder / f"{name}.svg")
            figures.draw(curves.over_time(panels, shifts.title), paths[-1])
    return paths


def _shift_tables(results: Results, name: str) -> list[Table]:
    shifts, errors = results.benchmark.shifts[name], results.errors[name]
    tables = []
    if NONE in errors:
        domains = " then ".join(shifts.chosen_on["domains"])
        tables.append(online_tables.choice_table(domains, shifts.chosen_with, errors))
    for kind in shifts.streams:
        if rows := results.stream_rows(name, kind):
            title = f"{shifts.title}: {kind}"
            tables.append(online_tables.stream_table(title, rows, best_settings(errors)))
            if kind == "sudden":
                tables.append(online_tables.milestones_table(f"{title}, after the shift", rows))
    return tables


def _study_tables(results: Results) -> list[Table]:
    return [
        function(study.render)(results.studies[study.name])
        for study in results.benchmark.studies
        if study.render and study.name in results.studies
    ]


def function(target: str) -> Any:
    """A function by ``"module:function"``."""
    return catalog.load_class(target, "function")
