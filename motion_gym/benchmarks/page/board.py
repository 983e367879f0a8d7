"""The leaderboard: every row of every benchmark on every column, with its conditions and its rank."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.objects import BASELINE, LEVEL
from motion_gym.benchmarks.reports.conditions import Result, measured
from motion_gym.benchmarks.reports.significance import paired_p
from motion_gym.benchmarks.running import Results
from motion_gym.benchmarks.store import Run

OWN = "your own"
RANKING = (
    "A row's rank is 1 plus the number of rows that are significantly better, so rows that cannot be told apart share "
    "a rank. On windows, a row is better if the 95 % interval of its paired difference from constant velocity lies "
    "wholly below the other's (over all seeds of both); on streams, if a paired t-test over seeds says so at "
    f"{LEVEL:g}. Oracles and rows with leaks that constant velocity does not have are not ranked."
)


@dataclass
class Entry:
    """One method on one column: the mean over the seeds of its weights.

    Attributes:
        benchmark: Name of the benchmark.
        table: Title of the part, or of the sort of shift.
        method: Row of the table.
        column: Column of the table.
        domain: Spec of the domain, or name of the stream without its seed.
        kind: How the method came about: see ``_kind``.
        protocol: Protocol of its runs.
        unit: Unit of its errors.
        ade: [seeds] ADE.
        interval: 95 % interval of the ADE: the mean of those of its runs.
        fde: Mean FDE.
        best: Mean minADE_k; None where one forecast is scored.
        k: k of its runs.
        versus: Paired difference of the ADE from constant velocity: mean, lowest low and highest high of its seeds;
            None on streams.
        forecast_seconds: Seconds for one forecast.
        machine: Machine of the last run.
        leaks: Declared leaks of the future.
        conditions: Sentences on how it was scored, the leaks included.
        rank: See ``RANKING``; None if it is not ranked.
    """

    benchmark: str
    table: str
    method: str
    column: str
    domain: str
    kind: str
    protocol: str
    unit: str
    ade: np.ndarray
    interval: tuple[float, float]
    fde: float
    best: float | None
    k: int
    versus: tuple[float, float, float] | None
    forecast_seconds: float
    machine: str
    leaks: tuple[str, ...]
    conditions: list[str]
    rank: int | None = None


def entries_of(results: Results) -> list[Entry]:
    """All entries of a benchmark, ranked within each column."""
    columns: dict[tuple[str, str], list[Entry]] = {}
    for part, runs in results.parts:
        for (row, column), group in _grouped(runs, part.column_of).items():
            entry = _window_entry(results.benchmark.name, part.title, row, column, group)
            columns.setdefault((part.title, column), []).append(entry)
    for (name, column, row), group in results.streams.items():
        title = results.benchmark.shifts[name].title
        columns.setdefault((title, column), []).append(_stream_entry(results.benchmark.name, title, row, column, group))
    for entries in columns.values():
        _rank(entries)
    return [entry for entries in columns.values() for entry in sorted(entries, key=lambda entry: entry.ade.mean())]


def _grouped(runs: Iterable[Run], column_of: Any) -> dict[tuple[str, str], list[Run]]:
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((row_name(run["predictor"]), column_of(run)), []).append(run)
    return groups


def _window_entry(benchmark: str, table: str, row: str, column: str, runs: Sequence[Run]) -> Entry:
    first, k = runs[0], runs[0]["k"]
    ade = [run["metrics"]["ADE"] for run in runs]
    differences = [run["versus_baseline"]["ADE"] for run in runs]
    sampled = first["samples"] > 1 and f"minADE_{k}" in first["metrics"]
    return Entry(
        benchmark, table, row, column, first["spec"], _kind(first), first["protocol"], first["unit"],
        ade=np.array([summary["mean"] for summary in ade]),
        interval=_interval(ade),
        fde=_mean(run["metrics"]["FDE"]["mean"] for run in runs),
        best=_mean(run["metrics"][f"minADE_{k}"]["mean"] for run in runs) if sampled else None,
        k=k,
        versus=(
            _mean(d["mean"] for d in differences),
            min(d["low"] for d in differences),
            max(d["high"] for d in differences),
        ) if row != BASELINE and all(d["low"] is not None for d in differences) else None,
        forecast_seconds=_mean(run["seconds"] / max(run["metrics"]["ADE"]["agent_windows"], 1) for run in runs),
        machine=_machine(runs),
        leaks=tuple(first["leaks"]),
        conditions=[
            f"{first['split']} split, protocol {first['protocol']}, k = {k}, {first['samples']} drawn",
            measured(runs),
            *_counts(ade[0]), first["scored"], first["aggregation"], first["selection"],
            f"{first['reference_scenes']} reference scenes, {first['shots']} scenes to learn from",
            *first["leaks"], first["verified"], *_origin(runs),
        ],
    )  # fmt: skip


def _stream_entry(benchmark: str, table: str, row: str, column: str, runs: Sequence[Run]) -> Entry:
    first = runs[0]
    stream = first["stream"].partition(", seed=")[0].removesuffix(")") + ")"
    units = {card["unit"] for card in first["domains"].values()}
    return Entry(
        benchmark, table, row_name(row), column, stream, _kind(first), first["protocol"], units.pop(),
        ade=np.array([run["ade"]["mean"] for run in runs]),
        interval=_interval([run["ade"] for run in runs]),
        fde=_mean(run["fde"]["mean"] for run in runs),
        best=None,
        k=first["k"],
        versus=None,
        forecast_seconds=_mean(run["tick_seconds"][0] for run in runs),
        machine=_machine(runs),
        leaks=tuple(first["leaks"]),
        conditions=[
            f"a stream, labels {first['labels']}, learned state kept for the {first['scope']}, around {first['of']}; "
            f"{measured(runs)}",
            *_counts(first["ade"]), first["aggregation"], first["selection"],
            f"{first['updates']} updates, {first['rolled_back']} rolled back, {first['censored']} forecasts censored",
            *first["leaks"], *_origin(runs),
        ],
    )  # fmt: skip


def _rank(entries: Sequence[Entry]) -> None:
    """Rank the entries of one column."""
    baseline = next((entry for entry in entries if entry.method == BASELINE), None)
    allowed = set(baseline.leaks) if baseline else set()
    ranked = [entry for entry in entries if entry.kind != "oracle" and set(entry.leaks) <= allowed]
    for entry in ranked:
        entry.rank = 1 + sum(_is_better(other, entry) for other in ranked if other is not entry)


def _is_better(one: Entry, other: Entry) -> bool:
    """Whether one entry is significantly better than another of the same column."""
    if one.ade.mean() >= other.ade.mean():
        return False
    if one.versus or other.versus:
        first, second = (entry.versus or (0.0, 0.0, 0.0) for entry in (one, other))
        return first[2] < second[1]
    return len(one.ade) == len(other.ade) > 1 and paired_p(one.ade - other.ade) < LEVEL


def _kind(run: Result) -> str:
    """``oracle``, ``your own``, ``trained``, ``fitted`` to the sources in closed form, or ``training-free``."""
    if run["oracle"]:
        return "oracle"
    if run["identity"].get("session"):
        return OWN
    if run["identity"].get("weights"):
        return "trained"
    return "fitted" if run["selection"].startswith("fitted") else "training-free"


def _interval(summaries: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    return _mean(s["low"] for s in summaries), _mean(s["high"] for s in summaries)


def _mean(values: Iterable[float | None]) -> float:
    """Mean; NaN if a value is missing."""
    return float(np.mean([np.nan if value is None else value for value in values]))


def _counts(summary: Mapping[str, Any]) -> list[str]:
    return [
        f"{summary['agent_windows']} agent-windows of {summary['agents']} agents in {summary['scenes']} scenes; 95 % "
        f"interval by bootstrap of whole agents, {summary['replicates']} replicates"
    ]


def _machine(runs: Sequence[Run]) -> str:
    return str(runs[-1]["provenance"].get("machine", "not recorded"))


def _origin(runs: Sequence[Run]) -> list[str]:
    """Versions of libraries and the time of the last run."""
    provenance = runs[-1]["provenance"]
    versions = ", ".join(f"{name} {version}" for name, version in provenance["versions"].items())
    return [f"computed {provenance['finished'][:10]} with {versions}"]
