"""The runs that a benchmark consists of: what each one computes, and how missing ones are computed."""

from __future__ import annotations

import concurrent.futures
import functools
import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks import store as stores
from motion_gym.benchmarks.identity import answered_by, canonical
from motion_gym.benchmarks.objects import (
    FILTERS,
    NONE,
    ORACLE,
    SEEDS,
    Benchmark,
    Report,
    Shifts,
    Study,
    domain,
    row_name,
)
from motion_gym.benchmarks.store import Run, Store
from motion_gym.contract import MotionGymError
from motion_gym.data.storage import StorageError

NOT_ASKED = "it was not asked for"
"""Why a row is missing that ``only`` does not name."""
Tried = dict[str, dict[str, float]]
"""ADE in metres by row and its settings."""


@dataclass(frozen=True)
class Job:
    """Runs that may have to be computed, together.

    Attributes:
        label: What they are, for people.
        row: Row of a table.
        place: Domains that are read; jobs of the same ones follow each other.
        identities: What determines the result of each run.
        compute: Makes the results, in JSON types; it can be pickled if it is to be called in another process.
    """

    label: str
    row: str
    place: str
    identities: Sequence[Mapping[str, Any]]
    compute: Callable[[], Sequence[Mapping[str, Any]]]


def compute_missing(
    kept: Store,
    jobs: Sequence[Job],
    *,
    fresh: bool,
    only: Sequence[str],
    count: int,
    report: Report,
    reasons: dict[str, str],
) -> None:
    """Compute the jobs that the store lacks, and write each as soon as it is done.

    Args:
        kept: The store.
        jobs: All jobs.
        fresh: Compute all of them.
        only: Rows that are computed; all if empty.
        count: Processes.
        report: As for ``run``.
        reasons: Filled with what went wrong by question of a job.
    """
    wanted = {
        _questions(job.identities): job
        for job in jobs
        if (not only or job.row in only) and (fresh or not all(kept.find(identity) for identity in job.identities))
    }
    # One domain after the other, as its windows are kept.
    order = sorted(wanted.values(), key=lambda job: job.place)
    for done, (job, answer) in enumerate(_answers(order, kept.folder, count, report)):
        try:
            runs, problem = answer()
            kept.take(runs)
        except MotionGymError as error:
            problem = str(error)
        if problem:
            reasons.update(dict.fromkeys(_questions(job.identities), problem))
        report(done + 1, len(order), job.label)


def _answers(
    order: Sequence[Job], folder: Path | None, count: int, report: Report
) -> Iterator[tuple[Job, Callable[[], tuple[list[Run], str]]]]:
    if count == 1 or len(order) < 2:
        for done, job in enumerate(order):
            report(done, len(order), job.label)
            yield job, functools.partial(_computed, job, folder)
        return
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(min(count, len(order)), mp_context=context) as pool:
        futures = {pool.submit(_computed, job, folder): job for job in order}
        try:
            for future in concurrent.futures.as_completed(futures):
                yield futures[future], future.result
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _computed(job: Job, folder: Path | None) -> tuple[list[Run], str]:
    """Runs of a job, and what kept them from being written."""
    runs = [stores.run_of(identity, result) for identity, result in zip(job.identities, job.compute(), strict=True)]
    try:
        for run in runs:
            stores.write(folder, run)
    except StorageError as error:
        return runs, str(error)
    return runs, ""


def _questions(identities: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    return tuple(stores.question(canonical(identity)) for identity in identities)


def window_jobs(chosen: Benchmark, session: str) -> Iterator[Job]:
    """Every predictor on every column."""
    for part in chosen.parts:
        for predictor, column in part.runs():
            spec = part.domains[column]
            compute = functools.partial(score_windows, predictor, spec, part.options(column))
            yield Job(
                f"{predictor} on {spec}",
                row_name(predictor),
                spec,
                [part.identity(predictor, column, session)],
                compute,
            )


def score_windows(predictor: str, spec: str, options: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Scores of a predictor on a domain, in JSON types."""
    from motion_gym.scoring.evaluation import evaluate

    return [evaluate(predictor, domain(spec), **options).as_dict()]


def study_identity(study: Study, session: str) -> dict[str, Any]:
    """Identity of a study: its name, arguments and version, and what takes part."""
    answered = answered_by(study.uses, [domain(spec) for spec in study.reads], session)
    answered["versions"] |= {"study": study.version}
    if not study.compute.startswith("motion_gym."):
        answered["session"] = session  # the code of a user cannot be known
    return {"kind": "study", "study": study.name, "arguments": dict(study.arguments), **answered}


def study_jobs(chosen: Benchmark, session: str) -> Iterator[Job]:
    """Every study."""
    for study in chosen.studies:
        yield Job(study.name, study.name, "", [study_identity(study, session)], functools.partial(_study, study))


def _study(study: Study) -> list[dict[str, Any]]:
    compute: Any = catalog.load_class(study.compute, "study")
    return [{"study": study.name, "value": json.loads(json.dumps(compute(**study.arguments), allow_nan=False))}]


def choice_jobs(chosen: Benchmark, shifts: Sequence[str], session: str) -> Iterator[Job]:
    """Every setting of every adapter on the stream that settings are chosen on."""
    for name in shifts or chosen.shifts:
        these = chosen.shifts[name]
        if these.chosen_on:
            of = these.of(0, these.chosen_with)
            specs = [(NONE, NONE), *((row, spec) for row in these.rows for spec in these.settings(row))]
            for row, spec in specs:
                label = f"choosing for {name}: {spec}"
                yield _stream_job(these, row, spec, of, these.chosen_stream(), label, session)


def stream_jobs(chosen: Benchmark, names: Sequence[str], tried: Mapping[str, Tried], session: str) -> Iterator[Job]:
    """Every adapter, with its best settings, on every stream with every seed."""
    for name in names:
        these = chosen.shifts[name]
        for kind, row, seed in ((k, r, s) for k in these.streams for r in rows_of(these) for s in SEEDS):
            spec = best_settings(tried[name]).get(row, row)
            label = f"{name}, {kind}: {spec}, seed {seed}"
            yield _stream_job(these, row, spec, these.of(seed), these.played(kind, seed), label, session)


def _stream_job(these: Shifts, row: str, spec: str, of: str, on: Mapping[str, Any], label: str, session: str) -> Job:
    identity = these.identity(spec, of, on, session)
    arguments = json.dumps(dict(on), sort_keys=True)
    compute = functools.partial(_stream_result, spec, of, these.oracle_of(on["seed"]), arguments)
    return Job(label, row, arguments, [identity], compute)


def _stream_result(spec: str, of: str, oracle: str | Mapping[str, str], arguments: str) -> list[dict[str, Any]]:
    return [score_stream(spec, of, oracle, arguments)[1]]


def score_stream(row: Any, of: str, oracle: Any, arguments: str, **options: Any) -> tuple[Any, dict[str, Any]]:
    """Card of a row around a predictor on a stream, and the result in JSON types.

    Args:
        row: Spec of an adapter, a class of adapters, one of ``FILTERS`` or ``oracle``.
        of: Predictor that is adapted.
        oracle: Specs of the oracle's predictors.
        arguments: Of ``stream``, as JSON.
        **options: Of ``evaluate_online``.
    """
    from motion_gym.online.evaluation import evaluate_online
    from motion_gym.online.target_oracle import TargetOracle

    if row == ORACLE:
        predictor: Any = TargetOracle(oracle)
    else:
        predictor = catalog.predictor(row) if row in FILTERS else catalog.adapter(row, of)
    card = evaluate_online(predictor, _played(arguments), **options)
    return card, {"row": row if isinstance(row, str) else row.__name__, "of": of, **card.as_dict()}


@functools.lru_cache(maxsize=8)
def _played(arguments: str) -> Any:
    from motion_gym.online.streams import stream

    return stream(**json.loads(arguments))


def rows_of(these: Shifts) -> tuple[str, ...]:
    """Rows of a table of shifts."""
    return (*FILTERS, NONE, ORACLE, *these.rows)


def best_settings(tried: Tried) -> dict[str, str]:
    """The best settings of each row."""
    return {row: min(values, key=lambda spec: values[spec]) for row, values in tried.items()}


def reason_of(identities: Sequence[Mapping[str, Any]], reasons: Mapping[str, str]) -> str:
    """Why runs are missing."""
    return next((reasons[key] for key in _questions(identities) if key in reasons), NOT_ASKED)


def processes(count: int) -> int:
    """A number of processes; SpecError unless it is allowed."""
    return catalog.whole_number("jobs", count, 1, 4 * (os.cpu_count() or 1))
