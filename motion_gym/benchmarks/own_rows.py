"""A user's rows beside the shipped rows: scored on the same columns and streams, and compared with two shipped rows."""

from __future__ import annotations

import copy
import dataclasses
import functools
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks import running
from motion_gym.benchmarks.identity import facts_of, label_of, row_name, shipped_card
from motion_gym.benchmarks.jobs import Job, score_stream, stream_job
from motion_gym.benchmarks.objects import BASELINE, NONE, SEEDS, Benchmark, Part
from motion_gym.benchmarks.reports.table import Code, Table, interval, p_text
from motion_gym.benchmarks.row_specs import with_parameters
from motion_gym.benchmarks.running import Results
from motion_gym.benchmarks.store import Run
from motion_gym.contract import SpecError
from motion_gym.metrics.bootstrap import (
    FEWER_REPLICATES,
    MANY_CLUSTERS,
    REPLICATES,
    clustered_interval,
    paired_difference,
)
from motion_gym.scoring.cards import in_json
from motion_gym.stepping.harness import is_fitted_here, ready


def check(benchmark: Benchmark, predictors: Sequence[Any], adapters: Sequence[Any], of: str | None) -> None:
    """Make each predictor and adapter once, before anything is computed.

    Raises:
        SpecError: a name is not known, the benchmark has no columns for a predictor, or no streams for an adapter.
    """
    name = benchmark.name
    if predictors and not benchmark.parts and not benchmark.drives:
        raise SpecError(f"{name} has no columns for a predictor: name an adapter, as --adapter module:Mine.")
    if adapters and not benchmark.shifts:
        raise SpecError(f"{name} has no streams for an adapter: name a predictor, as --predictor my_module:Mine.")
    for predictor in predictors:
        catalog.predictor(predictor)
    for adapter in adapters:
        catalog.adapter(adapter, of or next(iter(benchmark.shifts.values())).of(0))


def add(results: Results, predictors: Sequence[Any], adapters: Sequence[Any], of: str | None, session: str) -> None:
    """Score predictors on every column and adapters on every stream, and add their runs to the results.

    Args:
        results: The shipped rows; runs are added.
        predictors: Specs, classes or objects.
        adapters: Specs or classes of adapters.
        of: Predictor that the adapters are put around; by default the one of each of the shifts.
        session: Name of the command.
    """
    jobs = [job for predictor in predictors for job in _predictor_jobs(results, predictor, session)]
    jobs += [job for adapter in adapters for job in _adapter_jobs(results, adapter, of, session)]
    jobs += [job for predictor in predictors for job in _drive_jobs(results, predictor, session)]
    parts = {part.title: runs for part, runs in results.parts}
    parts |= {drives.title: runs for drives, runs in results.drives}
    for (where, column, row), runs in dataclasses.replace(results.runner, only=None).rows(jobs).items():
        if where in parts:
            parts[where].extend(runs)
        else:
            results.streams[where, column, row] = runs


def with_stored(name: str, folder: Path | None) -> Results:
    """The stored runs of a benchmark, with the rows of a user's that a folder of results holds.

    Args:
        name: Name of the benchmark.
        folder: Folder that ``motion-gym run --out`` wrote; None for the shipped runs alone.
    """
    results = running.run(name, (), None if folder is None else folder / name, only=())
    own = [stored for stored in results.runner.store.runs.values() if stored["identity"].get("session")]
    streams = {
        each["identity"]["stream"]: (shift, kind) for (shift, kind, _), runs in results.streams.items() for each in runs
    }
    for stored in own:
        identity = stored["identity"]
        if identity["kind"] == "stream" and identity["stream"] in streams:
            results.streams.setdefault((*streams[identity["stream"]], stored["row"]), []).append(stored)
        for part, runs in results.parts if identity["kind"] == "windows" else ():
            options = {"protocol": part.protocol, "k": part.samples, "references": part.references}
            column = part.find_column(stored)
            if column is not None and all(identity[key] == value for key, value in options.items()):
                runs.append(stored)
    return results


def _seeds_of(predictor: Any) -> list[tuple[Any, int]]:
    """The predictors whose mean is a row, each with the seed of its samples and fit.

    A spec with weights stands for all of their seeds, unless it names a seed. Predictors with ``fit`` are fitted with
    five seeds.
    """
    instance = catalog.predictor(predictor)
    name, parameters = catalog.parse_spec(predictor) if isinstance(predictor, str) else ("", {})
    weights = parameters.get("weights") if name in catalog.PREDICTORS else None
    if weights is not None and "seed" not in parameters:
        path = Path(str(weights)).expanduser()
        file = path.suffix == ".safetensors"
        card = json.loads(path.with_suffix(".json").read_bytes()) if file else shipped_card(str(weights), predictor)
        return [(with_parameters(predictor, seed=seed), 0) for seed in card["seeds"]]
    return [(predictor, seed) for seed in (SEEDS if is_fitted_here(predictor, instance) else (0,))]


def _predictor_jobs(results: Results, predictor: Any, session: str) -> Iterator[Job]:
    seeds, row = _seeds_of(predictor), row_name(label_of(predictor))
    covered: set[str] = set()
    for part, runs in results.parts:
        columns = {f"{facts_of(part.domain(column)).spec} {part.options(column)}" for column in part.domains}
        if row in map(row_name, (*part.plain, *part.trained, *part.fingerprints)) or columns <= covered:
            continue  # a shipped row, or the columns of an earlier part
        covered |= columns
        for column, spec in part.domains.items():
            identities = [part.identity(each, column, session, seed=seed) for each, seed in seeds]
            compute = functools.partial(_score_column, seeds, part, column, best_row(part, runs, column))
            yield Job(f"{row} on {spec}", (part.title, column), row, spec, identities, compute)


def _drive_jobs(results: Results, predictor: Any, session: str) -> Iterator[Job]:
    """A predictor on every column that is driven in, with the weights of each seed if it has several."""
    specs, row = [spec for spec, _ in _seeds_of(predictor)], row_name(label_of(predictor))
    for drives, _ in results.drives:
        if row not in map(row_name, drives.rows()):
            chosen = [specs[number % len(specs)] for number in range(len(SEEDS))]
            yield from (drives.job(row, chosen, column, session) for column in drives.domains)


_FITTED: dict[tuple[Any, ...], Any] = {}
"""Predictors that were fitted in this process, by spec, seed and sources."""


def _ready(spec: Any, place: Any, seed: int) -> Any:
    """A predictor for ``evaluate``: fitted once for all columns that have the same sources."""
    if not is_fitted_here(spec, catalog.predictor(spec)):
        return spec
    key = (spec, seed, *(facts_of(source).spec for source in place.sources()))
    if key not in _FITTED:
        _FITTED[key] = ready(spec, place, seed)
    return copy.deepcopy(_FITTED[key])


def _score_column(seeds: Sequence[tuple[Any, int]], part: Part, column: str, best: str | None) -> list[dict[str, Any]]:
    """Results of all seeds on a column, each with the comparison of their mean."""
    from motion_gym.scoring.evaluation import evaluate

    place, options = part.domain(column), part.options(column)
    # The forecasts of all seeds come from the same code: those of one seed are verified.
    cards = [
        evaluate(_ready(spec, place, seed), place, seed=seed, verify=number == 0, **options)
        for number, (spec, seed) in enumerate(seeds)
    ]
    others = {name: evaluate(name, place, **options).values["ADE"] for name in (BASELINE, best) if name}
    agents = cards[0].truth.observation.agent
    versus = _compare(np.mean([card.values["ADE"] for card in cards], axis=0), others, agents, best)
    return [
        {**card.as_dict(), "predictor": label_of(spec), "versus": versus}
        for card, (spec, _) in zip(cards, seeds, strict=True)
    ]


def _compare(
    errors: np.ndarray, others: Mapping[str, np.ndarray], agents: np.ndarray, best: str | None
) -> dict[str, Any]:
    """Mean error with its interval, and paired differences from other rows, the best shipped row among them.

    Args:
        errors: [A] ADE, the mean over seeds.
        others: [A] ADE of the shipped rows by their specs.
        agents: [A] ids; whole agents are resampled.
        best: Spec of the best shipped row; None if there is none.
    """
    mean, low, high = clustered_interval(errors, agents)[:3]
    differences = {name: dataclasses.asdict(paired_difference(errors, other, agents)) for name, other in others.items()}
    named = {name: differences[name] for name in (BASELINE, NONE) if name in differences}
    versus = {"ade": {"mean": mean, "low": low, "high": high}, **named}
    return in_json({**versus, **({"best": {"row": best, **differences[best]}} if best else {})})  # type: ignore[no-any-return]


def best_row(part: Part, runs: Sequence[Run], column: str) -> str | None:
    """The shipped row with the lowest mean ADE on a column.

    Oracles, external programs and rows with more leaks than the baseline do not count.

    Returns:
        Spec of its first seed; None if there is no such row.
    """
    runs = [run for run in runs if part.column_of(run) == column and not run["oracle"]]
    runs = [run for run in runs if run["predictor"] not in part.fingerprints]  # they may be impossible to compute here
    allowed = {leak for run in runs if run["predictor"] == BASELINE for leak in run["leaks"]}
    by_row: dict[str, list[Run]] = {}
    for run in runs:
        if set(run["leaks"]) <= allowed:
            by_row.setdefault(row_name(run["predictor"]), []).append(run)
    best = min(by_row.values(), key=lambda row: np.mean([run["metrics"]["ADE"]["mean"] for run in row]), default=None)
    return best[0]["predictor"] if best else None


def _adapter_jobs(results: Results, adapter: Any, of: str | None, session: str) -> Iterator[Job]:
    row = label_of(adapter)
    for name in results.errors:
        shifts = results.benchmark.shifts[name]
        for kind, seed in itertools.product(shifts.streams, SEEDS):
            rows = [results.streams.get((name, kind, row)) for row in (NONE, *shifts.rows)]
            best = min(filter(None, rows), key=lambda runs: np.mean([run["ade"]["mean"] for run in runs]), default=None)
            best_spec = best[0]["row"] if best else None
            source, arguments = shifts.of(seed), {**shifts.streams[kind], "seed": seed}
            job = stream_job(shifts, (name, kind), row, adapter, of or source, arguments, session)
            # The comparison takes further runs: it is made for the first seed alone.
            fitted_to = tuple(shifts.fitted_to)
            compare = functools.partial(
                _compare_on_stream, adapter, of or source, source, best_spec, job.domain, fitted_to
            )
            yield job if seed else dataclasses.replace(job, compute=compare)


def _compare_on_stream(
    adapter: Any, of: str, source: str, best: str | None, arguments: str, fitted_to: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Result of an adapter on a stream, compared with constant velocity, ``none`` and the best shipped row."""
    card, result = score_stream(adapter, of, None, arguments, fitted_to)
    rows = dict.fromkeys(row for row in (BASELINE, NONE, best) if row)
    others = {row: score_stream(row, source, None, arguments, fitted_to)[0].values for row in rows}
    return [{**result, "versus": _compare(card.values, others, card.person, best)}]


def comparison_tables(results: Results) -> dict[str, Table]:
    """A user's rows beside constant velocity and the best shipped row: a table for each part or sort of shift."""
    rows: dict[str, dict[tuple[str, str], list[str]]] = {}
    others: dict[str, list[str]] = {}
    runs = [(part.title, part.column_of(run), run) for part, runs in results.parts for run in runs]
    runs += [
        (results.benchmark.shifts[name].title, kind, seeds[0]) for (name, kind, _), seeds in results.streams.items()
    ]
    for title, column, run in runs:
        if versus := run.get("versus"):
            row, best = run.get("row") or row_name(run["predictor"]), versus.get("best")
            others[title] = [BASELINE, NONE] if run.get("row") else [BASELINE]
            cells = [interval(versus["ade"])]
            for name in others[title]:
                other = versus.get(name)
                cells += [interval(other, sign=True), p_text(other["p_value"])] if other else ["-"] * 2
            cells += [interval(best, sign=True), p_text(best["p_value"]), Code(best["row"])] if best else ["-"] * 3
            rows.setdefault(title, {})[row, column] = [Code(row), column, *cells]
    paired = (
        "differences in ADE are paired by forecast, with 95 % intervals by bootstrap of whole agents; negative: better "
        f"than the shipped row; p is two-sided, by the same replicates ({REPLICATES:,}; {FEWER_REPLICATES:,} from "
        f"{MANY_CLUSTERS:,} agents on, whose smallest p is {2 / FEWER_REPLICATES:g}), not corrected for several rows"
    )
    of_windows = (
        "the new row, mean over seeds, against the named seed of the best shipped row; oracles, external programs and "
        f"rows with more declared leaks than {BASELINE} are left out; rows that read a style from scenes count"
    )
    on_stream = "ADE over the whole stream with seed 0; other tables show the mean over seeds, or a part of the stream"
    columns = {
        title: ["method", "on", "ADE [95 %]", *(cell for name in names for cell in (f"vs {name}", "p"))]
        for title, names in others.items()
    }
    last = ["vs best shipped", "p", "best shipped"]
    return {
        title: Table(
            f"{title}: beside the shipped rows",
            [*columns[title], *last],
            [*by_column.values()],
            [on_stream, paired] if NONE in others[title] else [paired, of_windows],
        )
        for title, by_column in rows.items()
    }
