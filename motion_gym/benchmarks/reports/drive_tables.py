"""Tables of driven episodes: scores by style, what happens in the episodes, and whether lower errors drive better."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from motion_gym.benchmarks.claims.panels import Panel
from motion_gym.benchmarks.drives import Drives
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.objects import ORACLE
from motion_gym.benchmarks.reports.conditions import Result, leaks, measured, selections
from motion_gym.benchmarks.reports.table import Code, Table, number, spread
from motion_gym.driving.episodes import OTHERS, STEPS
from motion_gym.driving.planner import WEIGHTS
from motion_gym.driving.proposals import DT
from motion_gym.driving.run import FORECAST_METRICS, METRICS

ALL = "all"
"""The mean over all columns, each counting the same."""
REPLICATES = 1000
"""Resamples of the interval of a rank correlation."""
NAMES = {"stand_still": "stand_still (no forecast)", ORACLE: "oracle (knows the future)"}
"""Rows whose names need an explanation."""
Cells = Mapping[tuple[str, str], Sequence[Result]]
"""Runs of all seeds by row and column."""


def tables(drives: Drives, results: Sequence[Result]) -> list[Table]:
    """All tables of one part: scores, further scores, and rank correlations."""
    return [score_table(drives, results), detail_table(drives, results), correlation_table(drives, results)]


def score_table(drives: Drives, results: Sequence[Result]) -> Table:
    """The composite of the planner, a row for each predictor and a column for each domain."""
    cells = by_cell(drives, results)
    rows = []
    for row in _rows(cells):
        values = [means(cells, row, column, "score") for column in drives.domains]
        rows.append([Code(NAMES.get(row, row)), spread(np.mean(values, axis=0)), *map(spread, values)])
    seeds = len(next(iter(cells.values())))
    parts = ", ".join(f"{name} {weight:g}" for name, weight in WEIGHTS.items())
    notes = [
        f"{measured(results)}; cells are mean ± standard error over {seeds} seeds of {drives.episodes} episodes of "
        f"{STEPS * DT:g} s, each with traffic of its own",
        f"others {drives.others}: {OTHERS[drives.others]}",
        f"score of an episode: 0 after a collision or off the road, else the weighted mean of three parts: {parts}",
        f"{ALL}: mean of the columns, each counting the same",
        *_failures(results),
        *leaks(results),
        *selections(results),
    ]
    caption = "Composite score of the planner, 0 to 1, higher is better"
    return Table(drives.title, ["forecasts by", ALL, *drives.domains], rows, notes, caption)


def loss_panel(drives: Drives, results: Sequence[Result]) -> Panel:
    """What the planner lost, 1 - score, by row and column, for claims; the panel has the name of ``Drives.others``."""
    cells = by_cell(drives, results)
    columns = tuple(drives.domains)
    losses = {(row, column): 1 - means(cells, row, column, "score") for row in _rows(cells) for column in columns}
    losses |= {(row, ALL): np.mean([losses[row, column] for column in columns], axis=0) for row in _rows(cells)}
    return Panel(drives.others, losses, (ALL, *columns), drives.title)


def detail_table(drives: Drives, results: Sequence[Result]) -> Table:
    """What happens in the episodes, how exact the forecasts are, and how long they take."""
    cells = by_cell(drives, results)
    names = [name for name in METRICS if name != "score"]
    rows = []
    for row in _rows(cells):
        runs = [run for column in drives.domains for run in cells[row, column]]
        values = [_mean(run["metrics"][name]["mean"] for run in runs) for name in (*names, *FORECAST_METRICS)]
        times = [float(np.median([run["seconds"][name] for run in runs])) for name in ("forecast", "plan")]
        rows.append([
            Code(NAMES.get(row, row)), *map(number, values), f"{times[0] * 1000:.1f}", f"{1 / sum(times):.0f}"
        ])  # fmt: skip
    columns = ["forecasts by", *names, *FORECAST_METRICS, "ms per forecast", "replans/s"]
    notes = [f"{name}: {METRICS[name]}" for name in names]
    notes.append(
        "ADE, FDE and MR_2m: of the forecasts of the others that the planner used and that matured in their episode; "
        "mean over episodes; metres"
    )
    notes.append("ms per forecast, and forecasts with plans a second: medians, on a machine that did other work too")
    caption = "Means over all columns, seeds and episodes"
    return Table(f"{drives.title}: what happens", columns, rows, notes, caption)


def correlation_table(drives: Drives, results: Sequence[Result]) -> Table:
    """Spearman correlation over the rows between each error of the forecasts and the score of the planner."""
    cells = by_cell(drives, results)
    names = [row for row in _rows(cells) if row != ORACLE]
    rows = []
    for metric in FORECAST_METRICS:
        texts = []
        for column in (ALL, *drives.domains):
            chosen = tuple(drives.domains) if column == ALL else (column,)
            rho, low, high = correlation(cells, names, chosen, metric)
            texts.append(f"{rho:+.2f} [{low:+.2f}, {high:+.2f}]")
        rows.append([metric, *texts])
    caption = (
        "Spearman correlation between the mean error of the forecasts and the mean score of the planner, over "
        f"{len(names)} rows without the oracle; -1: the lower error always drives better"
    )
    note = f"95 % intervals: bootstrap of episodes, the same ones for all rows, {REPLICATES} replicates"
    return Table(
        f"{drives.title}: do lower errors drive better?", ["error", ALL, *drives.domains], rows, [note], caption
    )


@functools.cache
def _drawn(columns: int, seeds: int, episodes: int) -> np.ndarray:
    """How often each replicate draws each episode, [1 + REPLICATES, columns, seeds, episodes]; in the first, once."""
    share = np.full(episodes, 1 / episodes)
    counts = np.random.default_rng(0).multinomial(episodes, share, (REPLICATES, columns, seeds)).astype(float)
    return np.concatenate([np.ones_like(counts[:1]), counts])


def correlation(cells: Cells, rows: Sequence[str], columns: Sequence[str], metric: str) -> tuple[float, float, float]:
    """Spearman correlation over rows between the means of an error and of the score, with its 95 % interval.

    Episodes are the same for all rows, and are resampled within each seed and column.
    """
    from scipy.stats import rankdata  # takes a second to import

    values = [
        np.array([[_values(cells, row, column, name) for column in columns] for row in rows])
        for name in (metric, "score")
    ]
    counts = _drawn(*values[0].shape[1:])
    ranks = []
    for table in values:
        known = np.isfinite(table)
        sums = np.einsum("ncse,rcse->nrc", counts, np.where(known, table, 0.0), optimize=True)
        sums /= np.maximum(np.einsum("ncse,rcse->nrc", counts, known.astype(float), optimize=True), 1)
        ranks.append(rankdata(sums.mean(axis=2), axis=1))
    one, other = (each - each.mean(axis=1, keepdims=True) for each in ranks)
    spread_of_ranks = np.sqrt((one**2).sum(axis=1) * (other**2).sum(axis=1))
    rhos = np.divide((one * other).sum(axis=1), spread_of_ranks, out=np.zeros(len(one)), where=spread_of_ranks > 0)
    low, high = np.quantile(rhos[1:], (0.025, 0.975))
    return float(rhos[0]), float(low), float(high)


def by_cell(drives: Drives, results: Sequence[Result]) -> dict[tuple[str, str], list[Result]]:
    """Runs of all seeds, in order, by row and column."""
    cells: dict[tuple[str, str], list[Result]] = {}
    for run in sorted(results, key=lambda run: run["seed"]):
        cells.setdefault((row_name(run["predictor"]), drives.column_of(run)), []).append(run)
    rows = dict.fromkeys(row for row, _ in cells)
    complete = [row for row in rows if all((row, column) in cells for column in drives.domains)]
    return {key: runs for key, runs in cells.items() if key[0] in complete}


def means(cells: Cells, row: str, column: str, metric: str) -> np.ndarray:
    """[seeds] means of a row in a column."""
    return np.array([run["metrics"][metric]["mean"] for run in cells[row, column]], dtype=float)


def _rows(cells: Cells) -> list[str]:
    return sorted(dict.fromkeys(row for row, _ in cells), key=lambda row: row == ORACLE)


def _values(cells: Cells, row: str, column: str, metric: str) -> np.ndarray:
    """[seeds, episodes] values; NaN where they are not defined."""
    return np.array([run["values"][metric] for run in cells[row, column]], dtype=float)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _failures(results: Sequence[Result]) -> list[str]:
    """Rows whose predictor failed, with the first message."""
    notes = []
    for row in dict.fromkeys(row_name(run["predictor"]) for run in results):
        errors = [text for run in results if row_name(run["predictor"]) == row for text in run["errors"].values()]
        if errors:
            notes.append(f"{row} failed in {len(errors)} episodes, which have the score 0: {errors[0].rstrip('.')}")
    return notes
