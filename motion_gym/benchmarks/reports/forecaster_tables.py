"""Published forecasters beside the numbers of their papers: a table for each k and each way to pick the best sample."""

from __future__ import annotations

from motion_gym.benchmarks import published
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.objects import SAMPLES
from motion_gym.benchmarks.reports.conditions import leaks, measured, scored, selections, unit_of
from motion_gym.benchmarks.reports.seed_tables import Parts, over_seeds
from motion_gym.benchmarks.reports.table import Code, Table, number


def one_forecast(parts: Parts) -> Table:
    """ADE and FDE of one forecast."""
    return _table(parts, 0, "Published forecasters at k = 1", "ADE", "FDE")


def best_of_20(parts: Parts) -> Table:
    """ADE and FDE of the best of 20 samples of each agent."""
    names = (f"minADE_{SAMPLES}", f"minFDE_{SAMPLES}")
    return _table(parts, 1, f"Published forecasters, best of {SAMPLES}", *names)


def best_of_20_scenes(parts: Parts) -> Table:
    """ADE and FDE of the best of 20 samples of each scene."""
    names = (f"JADE_{SAMPLES}", f"JFDE_{SAMPLES}")
    return _table(parts, 1, f"Published forecasters, best of {SAMPLES} for the whole scene", *names, papers=False)


def _table(parts: Parts, which: int, title: str, ade: str, fde: str, papers: bool = True) -> Table:
    part, results = parts[which]
    columns = list(part.domains)
    ades, fdes = over_seeds(part, results, ade), over_seeds(part, results, fde)
    names = {row_name(spec): row.name for row in part.external for spec in map(row.predictor, row.weights)}
    rows = []
    for row in dict.fromkeys(row for row, _ in ades):
        cells = [
            f"{number(ades[row, column].mean())} / {number(fdes[row, column].mean())}" if (row, column) in ades else "-"
            for column in columns
        ]
        rows.append([names.get(row, Code(row)), *cells])
    if papers:
        for name, (k, errors) in published.FORECASTERS.items():
            if k == part.samples:
                cells = [" / ".join(map(number, errors[c])) if c in errors else "-" for c in columns]
                rows.append([f"{name}, its paper", *cells])
    notes = [f"protocol {part.protocol}; {measured(results)}", scored(results), *leaks(results)]
    if any(run["samples"] == 1 for run in results) and part.samples > 1:
        notes.append(f"rows with one forecast have it for all {part.samples} samples")
    notes += selections([run for run in results if row_name(run["predictor"]) not in names])
    by_name = {
        run["selection"]: names[row_name(run["predictor"])].partition(",")[0]
        for run in results
        if row_name(run["predictor"]) in names
    }
    notes += [f"selection, {name}: {text}" for text, name in by_name.items()]
    notes.append("external programs: stored rows, computed with checkouts of their repositories")
    return Table(title, ["method", *columns], rows, notes, f"{ade} / {fde}, {unit_of(results)}, k = {part.samples}")
