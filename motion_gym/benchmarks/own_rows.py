"""Rows of a user among those that ship: scored on the same columns and streams, and compared with two shipped rows."""

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
from motion_gym.benchmarks.identity import facts_of, label_of, row_name, shipped_card, windows_identity
from motion_gym.benchmarks.jobs import Job, compute_missing, score_stream, stream_job
from motion_gym.benchmarks.objects import BASELINE, NONE, SEEDS, Part, Shifts, with_parameters
from motion_gym.benchmarks.reports.table import Code, Table, interval, p_text
from motion_gym.benchmarks.running import Results
from motion_gym.benchmarks.store import Run
from motion_gym.contract import SpecError
from motion_gym.metrics.bootstrap import clustered_interval, paired_difference
from motion_gym.scoring.cards import in_json
from motion_gym.stepping.harness import ready


def add(
    results: Results,
    predictors: Sequence[Any],
    adapters: Sequence[Any],
    of: str | None,
    session: str,
    how: Mapping[str, Any],
) -> None:
    """Score predictors on every column and adapters on every stream, and add their rows to the results.

    Args:
        results: The shipped rows; runs are added.
        predictors: Specs, classes or objects.
        adapters: Specs or classes of adapters.
        of: Predictor that the adapters are put around; by default that of each of the shifts.
        session: Name of the command.
        how: Arguments of ``compute_missing``.
    """
    chosen = results.benchmark
    if predictors and not chosen.parts:
        raise SpecError(f"{chosen.name} has no columns for a predictor: name an adapter, as --adapter module:Mine.")
    if adapters and not chosen.shifts:
        raise SpecError(
            f"{chosen.name} has no streams for an adapter: name a predictor, as --predictor my_module:Mine."
        )
    jobs = [job for predictor in predictors for job in _predictor_jobs(results, predictor, session)]
    jobs += [job for adapter in adapters for job in _adapter_jobs(results, adapter, of, session)]
    parts = {part.title: runs for part, runs in results.parts}
    for (where, column, row), runs in compute_missing(results.kept, jobs, **{**how, "only": ()}).items():
        if where in parts:
            parts[where].extend(runs)
        else:
            results.streams[where, column, row] = runs
        title = where if where in parts else chosen.shifts[where].title
        results.compared.append((row, title, column, runs[0]["versus"]))


def versions_of(predictor: Any) -> list[tuple[Any, int]]:
    """What is scored for a row, each with the seed of its samples and fit.

    A spec with weights stands for all of their seeds, unless it names one; what is fitted is fitted with five seeds.
    """
    instance = catalog.predictor(predictor)
    parameters = catalog.parse_spec(predictor)[1] if isinstance(predictor, str) else {}
    weights = parameters.get("weights")
    if weights is not None and "seed" not in parameters:
        path = Path(str(weights)).expanduser()
        file = path.suffix == ".safetensors"
        card = json.loads(path.with_suffix(".json").read_bytes()) if file else shipped_card(str(weights), predictor)
        return [(with_parameters(predictor, seed=seed), 0) for seed in card["seeds"]]
    fitted = not isinstance(predictor, (str, type)) or getattr(instance, "fitted", False)
    return [(predictor, seed) for seed in (SEEDS if hasattr(instance, "fit") and not fitted else (0,))]


def _predictor_jobs(results: Results, predictor: Any, session: str) -> Iterator[Job]:
    versions, row = versions_of(predictor), row_name(label_of(predictor))
    covered: set[str] = set()
    for part, runs in results.parts:
        asked = {f"{facts_of(part.domain(column)).spec} {part.options(column)}" for column in part.domains}
        if row in map(row_name, (*part.plain, *part.trained)) or asked <= covered:
            continue  # a row that ships, or columns that an earlier part has
        covered |= asked
        for column, spec in part.domains.items():
            place, options = part.domain(column), part.options(column)
            identities = [windows_identity(v, place, seed=seed, session=session, **options) for v, seed in versions]
            compute = functools.partial(_score_column, versions, part, column, best_row(part, runs, column))
            yield Job(f"{row} on {spec}", (part.title, column), row, spec, identities, compute)


_FITTED: dict[tuple[Any, ...], Any] = {}
"""Predictors that were fitted in this process, by what they were fitted to."""


def _ready(spec: Any, place: Any, seed: int) -> Any:
    """A predictor for ``evaluate``: fitted once for all columns that have the same sources."""
    instance = catalog.predictor(spec)
    if not isinstance(spec, (str, type)) or not hasattr(instance, "fit") or getattr(instance, "fitted", False):
        return spec
    key = (spec, seed, *(facts_of(source).spec for source in place.sources()))
    if key not in _FITTED:
        _FITTED[key] = ready(spec, place, seed)  # type: ignore[arg-type]
    return copy.deepcopy(_FITTED[key])


def _score_column(
    versions: Sequence[tuple[Any, int]], part: Part, column: str, best: str | None
) -> list[dict[str, Any]]:
    """Results of all seeds on a column, each with the comparison of their mean."""
    from motion_gym.scoring.evaluation import evaluate

    place, options = part.domain(column), part.options(column)
    # Verifying the forecasts of one seed verifies the code of all.
    cards = [
        evaluate(_ready(spec, place, seed), place, seed=seed, verify=number == 0, **options)
        for number, (spec, seed) in enumerate(versions)
    ]
    others = {name: evaluate(name, place, **options).values["ADE"] for name in (BASELINE, best) if name}
    agents = cards[0].truth.observation.agent
    versus = compared(np.mean([card.values["ADE"] for card in cards], axis=0), others, agents, best)
    return [
        {**card.as_dict(), "predictor": label_of(spec), "versus": versus}
        for card, (spec, _) in zip(cards, versions, strict=True)
    ]


def compared(
    errors: np.ndarray, others: Mapping[str, np.ndarray], agents: np.ndarray, best: str | None
) -> dict[str, Any]:
    """Mean error with its interval, and paired differences from constant velocity and from the best shipped row.

    Args:
        errors: [A] ADE, the mean over seeds.
        others: [A] ADE of the shipped rows by their specs.
        agents: [A] ids; whole agents are resampled.
        best: Spec of the best shipped row; None if there is none.
    """
    mean, low, high = clustered_interval(errors, agents)[:3]
    differences = {name: dataclasses.asdict(paired_difference(errors, other, agents)) for name, other in others.items()}
    kept = {"ade": {"mean": mean, "low": low, "high": high}, BASELINE: differences[BASELINE]}
    return in_json({**kept, **({"best": {"row": best, **differences[best]}} if best else {})})  # type: ignore[no-any-return]


def best_row(part: Part, runs: Sequence[Run], column: str) -> str | None:
    """The shipped row of the lowest mean ADE on a column that is no oracle and reads no more than constant velocity."""
    errors: dict[str, list[float]] = {}
    first: dict[str, str] = {}
    own = [run for run in runs if part.column_of(run) == column and not run["oracle"]]
    allowed = {leak for run in own if run["predictor"] == BASELINE for leak in run["leaks"]}
    for run in own:
        if set(run["leaks"]) <= allowed:
            row = row_name(run["predictor"])
            errors.setdefault(row, []).append(run["metrics"]["ADE"]["mean"])
            first.setdefault(row, run["predictor"])
    return first[min(errors, key=lambda row: np.mean(errors[row]))] if errors else None


def _adapter_jobs(results: Results, adapter: Any, of: str | None, session: str) -> Iterator[Job]:
    row = label_of(adapter)
    for name in results.tried:
        these = results.benchmark.shifts[name]
        for kind, seed in itertools.product(these.streams, SEEDS):
            source, best = these.of(seed), _best_adapter(results, these, name, kind)
            job = stream_job(these, (name, kind), row, adapter, of or source, these.played(kind, seed), session)
            # The comparison takes further runs: the first seed stands for all.
            compare = functools.partial(_compared_on_stream, adapter, of or source, source, best, job.place)
            yield job if seed else dataclasses.replace(job, compute=compare)


def _best_adapter(results: Results, these: Shifts, name: str, kind: str) -> str | None:
    """Spec of the shipped row, no filter and no oracle, of the lowest mean ADE on a stream."""
    rows = [results.streams[name, kind, row] for row in (NONE, *these.rows) if (name, kind, row) in results.streams]
    best = min(rows, key=lambda runs: np.mean([run["ade"]["mean"] for run in runs]), default=None)
    return best[0]["row"] if best else None


def _compared_on_stream(adapter: Any, of: str, source: str, best: str | None, arguments: str) -> list[dict[str, Any]]:
    """Result of an adapter on a stream, with its comparison with two shipped rows."""
    card, result = score_stream(adapter, of, None, arguments)
    others = {row: score_stream(row, source, None, arguments)[0].values for row in (BASELINE, best) if row}
    return [{**result, "versus": compared(card.values, others, card.person, best)}]


def comparison_tables(results: Results) -> list[Table]:
    """Rows of a user, column by column, beside constant velocity and the best shipped row: a table for each part."""
    by_title: dict[str, list[list[str]]] = {}
    for row, title, column, versus in results.compared:
        best = versus.get("best")
        cells = [interval(versus["ade"]), interval(versus[BASELINE], sign=True), p_text(versus[BASELINE]["p_value"])]
        cells += [interval(best, sign=True), p_text(best["p_value"]), Code(best["row"])] if best else ["-"] * 3
        by_title.setdefault(title, []).append([Code(row), column, *cells])
    columns = ["method", "on", "ADE [95 %]", f"vs {BASELINE}", "p", "vs best shipped", "p", "best shipped"]
    notes = [
        "differences in ADE are paired by forecast, with 95 % intervals by bootstrap of whole agents; negative: better "
        "than the shipped row",
        "the mean over seeds of the new row against the named seed of the best shipped row that is no oracle and reads "
        f"nothing that {BASELINE} does not; on streams seed 0 of both",
    ]
    return [Table(f"{title}: beside the shipped rows", columns, rows, notes) for title, rows in by_title.items()]
