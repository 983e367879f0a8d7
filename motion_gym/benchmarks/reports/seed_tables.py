"""Tables of a part of a benchmark: the mean over seeds for each row and column."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.objects import Part
from motion_gym.benchmarks.reports.conditions import (
    Result,
    in_order,
    leaks,
    measured,
    not_computed,
    scored,
    selections,
    unit_of,
)
from motion_gym.benchmarks.reports.table import Code, Strong, Table, number, spread

Parts = Sequence[tuple[Part, Sequence[Result]]]
"""Each part of a benchmark with the results of its runs."""
Errors = dict[tuple[str, str], np.ndarray]
"""Values of all seeds by row and column."""
SEEDS = "cells are mean ± standard error over seeds; the interval of every run is stored with it"


def over_seeds(part: Part, results: Sequence[Result], metric: str = "ADE") -> Errors:
    """Values of all seeds by row and column, with the pooled columns."""
    values: dict[tuple[str, str], list[float]] = {}
    for result in in_order(results):
        values.setdefault((row_name(result["predictor"]), part.column_of(result)), []).append(
            result["metrics"][metric]["mean"]
        )
    for row in dict.fromkeys(row for row, _ in values):
        for name, columns in part.pooled.items():
            if all((row, column) in values for column in columns):
                values[row, name] = np.mean([values[row, column] for column in columns], axis=0).tolist()
    return {key: np.array(seeds, dtype=float) for key, seeds in values.items()}


def part_tables(part: Part, results: Sequence[Result]) -> list[Table]:
    """Tables of one part, one for each way to aggregate over samples: a row for each method, a column for each domain.

    Raises:
        DataError: the results are of several units or scoring versions.
    """
    k = max(result["k"] for result in results)
    tables = [_table(part, results, part.title, "k = 1", ("ADE", "FDE"), notes(part, results))]
    if any(result["samples"] > 1 for result in results):
        for unit, names in (("agent", (f"minADE_{k}", f"minFDE_{k}")), ("scene", (f"JADE_{k}", f"JFDE_{k}"))):
            samples = f"k = {k}, best sample of each {unit}"
            tables.append(_table(part, results, f"{part.title}: {samples}", samples, names, []))
    return tables


def short_table(part: Part, results: Sequence[Result]) -> Table:
    """The table of the ADE at k = 1."""
    return _table(part, results, part.title, "k = 1", ("ADE",), notes(part, results))


def _table(
    part: Part, results: Sequence[Result], title: str, samples: str, metrics: Sequence[str], notes: Sequence[str]
) -> Table:
    columns = [*part.pooled, *part.domains]
    errors = [over_seeds(part, results, metric) for metric in metrics]
    rows = []
    for row in dict.fromkeys(row for row, _ in errors[0]):
        cells = [" / ".join(spread(values.get((row, column), [])) for values in errors) for column in columns]
        seeds = max(len(values) for (name, _), values in errors[0].items() if name == row)
        rows.append([Code(row), *cells, str(seeds) if seeds > 1 else "-"])
    unit = unit_of(results)
    caption = f"{' / '.join(metrics)}, {unit}, {samples}; lower is better"
    return Table(title, ["method", *columns, "seeds"], rows, notes, caption)


def notes(part: Part, results: Sequence[Result]) -> list[str]:
    """Notes on all cells."""
    return [f"protocol {part.protocol}; {measured(results)}; {SEEDS}", scored(results), *further_notes(part, results)]


def further_notes(part: Part, results: Sequence[Result]) -> list[str]:
    """Notes on pooled columns, reference scenes, shots, leaks, and how weights were selected."""
    ordered = in_order(results)
    shots = {name: max([r["shots"] for r in results if part.column_of(r) == name], default=0) for name in part.domains}
    references = max(result["reference_scenes"] for result in results)
    lines = [f"{name}: mean of {', '.join(columns)}, each counting the same" for name, columns in part.pooled.items()]
    lines += [f"rows with a style read the style from {references} reference scenes"] if references else []
    if any(shots.values()):
        lines.append(
            f"scenes of the domain's training split that rows learn from: {', '.join(map(str, shots.values()))}"
        )
    return [*lines, *not_computed(results), *leaks(ordered), *selections(ordered)]


def schedules(parts: Parts) -> Table:
    """Errors of each schedule on a held-out domain, for each choice of what ``transfer`` tunes; the best is bold.

    Args:
        parts: The parts of the benchmark; the last one holds ``transfer`` with every schedule, and the untuned row.
    """
    part, results = parts[-1]
    values, columns = over_seeds(part, results), list(part.domains)
    means: dict[str, dict[tuple[int, float], float]] = {}
    for row in dict.fromkeys(row for row, _ in values):
        name, parameters = catalog.parse_spec(row)
        if name == "transfer":
            schedule = (int(parameters["epochs"]), float(parameters["rate"]))
            means.setdefault(parameters["parts"], {})[schedule] = _mean(values[row, column] for column in columns)
    tried = list(dict.fromkeys(schedule for errors in means.values() for schedule in errors))
    rows = []
    for tuned, errors in means.items():
        best = min(errors, key=lambda schedule: errors[schedule])
        cells = [Strong(number(errors[s])) if s == best else number(errors.get(s)) for s in tried]
        rows.append([tuned, *cells])
    (untuned_row,) = {row for row, _ in values if row not in part.plain and catalog.parse_spec(row)[0] != "transfer"}
    untuned = _mean(values[untuned_row, column] for column in columns)
    size = round(part.shots[columns[0]] / float(columns[0]))
    caption = (
        f"ADE, {unit_of(results)}, on a held-out domain ({part.title}), mean over seeds and over {', '.join(columns)} "
        f"batches of {size} scenes. Without tuning it is {number(untuned)}. `transfer` takes the best schedule of each "
        "row by default."
    )
    heads = ["tuned", *(f"{epochs} epochs, {rate:g}" for epochs, rate in tried)]
    return Table("Which schedule", heads, rows, [measured(results)], caption)


def _mean(values: Iterable[np.ndarray]) -> float:
    return float(np.mean([column.mean() for column in values]))
