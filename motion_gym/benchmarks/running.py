"""How a benchmark is run: what the store has is shown, what is missing is computed."""

from __future__ import annotations

import concurrent.futures
import functools
import json
import multiprocessing
import os
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks import store as stores
from motion_gym.benchmarks.identity import answered_by, canonical
from motion_gym.benchmarks.objects import (
    BASELINE,
    NONE,
    ORACLE,
    SEEDS,
    Benchmark,
    Part,
    Report,
    Shifts,
    Study,
    domain,
    row_name,
)
from motion_gym.benchmarks.store import Run, Store
from motion_gym.contract import MotionGymError, SpecError
from motion_gym.data.storage import StorageError

BENCHMARKS: Mapping[str, str] = {
    "spurious": "motion_gym.benchmarks.definitions.places:SPURIOUS",
    "original": "motion_gym.benchmarks.definitions.places:ORIGINAL",
    "style": "motion_gym.benchmarks.definitions.styles:STYLE",
    "crowd": "motion_gym.benchmarks.definitions.styles:CROWD",
    "transfer": "motion_gym.benchmarks.definitions.styles:TRANSFER",
    "refinement": "motion_gym.benchmarks.definitions.styles:REFINEMENT",
    "pretraining": "motion_gym.benchmarks.definitions.styles:PRETRAINING",
    "online": "motion_gym.benchmarks.definitions.streams:ONLINE",
    "baselines": "motion_gym.benchmarks.definitions.places:BASELINES",
}
"""Where each shipped benchmark is defined, by its name."""
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


@dataclass
class Results:
    """Runs of a benchmark, as tables read them.

    Attributes:
        benchmark: The benchmark.
        kept: The store that the runs are from.
        parts: Each part with its runs.
        tried: ADE on the shift that settings are chosen on, by name of the shifts.
        streams: Runs of the seeds by name of the shifts, kind and row.
        studies: What was computed by name of the study.
        missing: Rows that are not shown, since some of their runs are missing, and why.
        unwritten: Why runs that are shown could not be written.
        compared: Rows of a user: row, title of the table, column, and the comparison with shipped rows.
    """

    benchmark: Benchmark
    kept: Store
    parts: list[tuple[Part, list[Run]]] = field(default_factory=list)
    tried: dict[str, Tried] = field(default_factory=dict)
    streams: dict[tuple[str, str, str], list[Run]] = field(default_factory=dict)
    studies: dict[str, dict[str, Any]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    unwritten: list[str] = field(default_factory=list)
    compared: list[tuple[str, str, str, dict[str, Any]]] = field(default_factory=list)

    def __str__(self) -> str:
        """The tables that ``motion-gym run`` prints, as Markdown."""
        from motion_gym.benchmarks import pages  # which needs what is defined here

        return "\n\n".join(table.markdown() for table in pages.short(self))


def benchmark(name: str | Benchmark) -> Benchmark:
    """A benchmark by its name, by ``"module:OBJECT"``, or as it is.

    Raises:
        SpecError: there is none of that name.
    """
    if isinstance(name, Benchmark):
        return name
    if name not in BENCHMARKS and ":" not in name:
        raise SpecError(
            f"There is no benchmark `{name}`.{catalog.suggest(name, BENCHMARKS)} Your own: `module:OBJECT`."
        )
    module, _, attribute = BENCHMARKS.get(name, name).partition(":")
    try:
        made = getattr(import_module(module), attribute)
    except ModuleNotFoundError as error:
        raise SpecError(f"There is no module `{error.name}` for the benchmark `{name}`: run from its folder.") from None
    except AttributeError:
        raise SpecError(f"Module `{module}` has no `{attribute}`: name a Benchmark that it defines.") from None
    if callable(made):
        made = made()
    if not isinstance(made, Benchmark):
        raise SpecError(f"`{name}` is a {type(made).__name__}: make it a motion_gym.benchmarks.objects.Benchmark.")
    return made


def run(
    name: str | Benchmark,
    predictors: Sequence[Any] = (),
    folder: Path | None = None,
    *,
    adapters: Sequence[Any] = (),
    of: str | None = None,
    shifts: Sequence[str] = (),
    fresh: bool = False,
    only: Sequence[str] = (),
    jobs: int = 1,
    session: str | None = None,
    report: Report = lambda done, of, what: None,
) -> Results:
    """Show what the store has of a benchmark, and compute what is missing.

    Args:
        name: The benchmark.
        predictors: Further rows: predictors of a user, which are scored on every column.
        folder: For one small file per run; None to keep none.
        adapters: Further rows on streams: adapters of a user.
        of: Predictor that these adapters are put around; by default that of each of the shifts.
        shifts: Names of the shifts that are run; all by default.
        fresh: Compute also what the store has.
        only: Rows that are computed; all by default.
        jobs: Processes that compute.
        session: Name of the command, see ``identity.answered_by``; by default a new one.
        report: Called before each run with the number of runs done, of all, and what is next.

    Raises:
        SpecError: a name is not known.
        PredictorError: a predictor of the user broke its contract.
    """
    chosen = benchmark(name)
    for wanted in shifts:
        if wanted not in chosen.shifts:
            raise SpecError(f"{chosen.name} has no shift `{wanted}`.{catalog.suggest(wanted, chosen.shifts)}")
    _check_rows(chosen, only)
    session = session or secrets.token_hex(8)
    kept = Store(chosen.name, folder)
    results = Results(chosen, kept)
    reasons: dict[str, str] = {}
    how: dict[str, Any] = {"fresh": fresh, "only": only, "count": jobs, "report": report, "reasons": reasons}
    first = [*_window_jobs(chosen, session), *_study_jobs(chosen, session), *_choice_jobs(chosen, shifts, session)]
    compute_missing(kept, first, **how)
    for part in chosen.parts:
        results.parts.append((part, _rows_of(part, kept, session, results.missing, reasons)))
    for study in chosen.studies:
        stored = kept.find(study_identity(study, session))
        if stored is not None:
            results.studies[study.name] = stored["value"]
    names = shifts or list(chosen.shifts)
    results.tried = {one: _tried(chosen.shifts[one], kept, session) for one in names}
    compute_missing(kept, list(_stream_jobs(chosen, names, results.tried, session)), **how)
    _take_streams(results, kept, names, session, reasons)
    if predictors or adapters:
        from motion_gym.benchmarks import own_rows  # which needs what is defined here

        own_rows.add(results, kept, predictors, adapters, of, session, how)
    results.unwritten = list(dict.fromkeys(reason for key, reason in reasons.items() if key in kept.runs))
    return results


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


def _window_jobs(chosen: Benchmark, session: str) -> Iterator[Job]:
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


def _study_jobs(chosen: Benchmark, session: str) -> Iterator[Job]:
    for study in chosen.studies:
        yield Job(study.name, study.name, "", [study_identity(study, session)], functools.partial(_study, study))


def _study(study: Study) -> list[dict[str, Any]]:
    compute: Any = catalog.load_class(study.compute, "study")
    return [{"study": study.name, "value": json.loads(json.dumps(compute(**study.arguments), allow_nan=False))}]


def _choice_jobs(chosen: Benchmark, shifts: Sequence[str], session: str) -> Iterator[Job]:
    for name in shifts or chosen.shifts:
        these = chosen.shifts[name]
        if these.chosen_on:
            of = these.of(0, these.chosen_with)
            specs = [(NONE, NONE), *((row, spec) for row in these.rows for spec in these.settings(row))]
            for row, spec in specs:
                label = f"choosing for {name}: {spec}"
                yield _stream_job(these, row, spec, of, these.chosen_stream(), label, session)


def _stream_jobs(chosen: Benchmark, names: Sequence[str], tried: Mapping[str, Tried], session: str) -> Iterator[Job]:
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
        row: Spec of an adapter, a class of adapters, ``constant_velocity`` or ``oracle``.
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
        predictor = catalog.predictor(BASELINE) if row == BASELINE else catalog.adapter(row, of)
    card = evaluate_online(predictor, _played(arguments), **options)
    return card, {"row": row if isinstance(row, str) else row.__name__, "of": of, **card.as_dict()}


@functools.lru_cache(maxsize=8)
def _played(arguments: str) -> Any:
    from motion_gym.online.streams import stream

    return stream(**json.loads(arguments))


def rows_of(these: Shifts) -> tuple[str, ...]:
    """Rows of a table of shifts."""
    return (BASELINE, NONE, ORACLE, *these.rows)


def best_settings(tried: Tried) -> dict[str, str]:
    """The best settings of each row."""
    return {row: min(values, key=lambda spec: values[spec]) for row, values in tried.items()}


def _tried(these: Shifts, kept: Store, session: str) -> Tried:
    """ADE of each row by its settings on the shift that they are chosen on, the mean over its segments."""
    tried: Tried = {}
    if these.chosen_on:
        of, on = these.of(0, these.chosen_with), these.chosen_stream()
        for row in (NONE, *these.rows):
            for spec in [NONE] if row == NONE else these.settings(row):
                found = kept.find(these.identity(spec, of, on, session))
                if found is not None:
                    ade = float(np.mean([segment["ade"]["mean"] for segment in found["segments"]]))
                    tried.setdefault(row, {})[spec] = ade
    return tried


def _take_streams(
    results: Results, kept: Store, names: Sequence[str], session: str, reasons: Mapping[str, str]
) -> None:
    for name in names:
        these = results.benchmark.shifts[name]
        for kind in these.streams:
            for row in rows_of(these):
                spec = best_settings(results.tried[name]).get(row, row)
                identities = [these.identity(spec, these.of(s), these.played(kind, s), session) for s in SEEDS]
                runs = [kept.find(identity) for identity in identities]
                if all(runs):
                    results.streams[name, kind, row] = [r for r in runs if r]
                else:
                    results.missing[f"{row} ({name}, {kind})"] = reason_of(identities, reasons)


def _rows_of(part: Part, kept: Store, session: str, missing: dict[str, str], reasons: Mapping[str, str]) -> list[Run]:
    """Runs of the rows all of whose columns are there."""
    by_row: dict[str, list[Any]] = {}
    for predictor, column in part.runs():
        by_row.setdefault(row_name(predictor), []).append(part.identity(predictor, column, session))
    runs: list[Run] = []
    for row, identities in by_row.items():
        found = [kept.find(identity) for identity in identities]
        if all(found):
            runs += [r for r in found if r]
        else:
            missing[f"{row} ({part.title})"] = reason_of(identities, reasons)
    return runs


def reason_of(identities: Sequence[Mapping[str, Any]], reasons: Mapping[str, str]) -> str:
    """Why runs are missing."""
    return next((reasons[key] for key in _questions(identities) if key in reasons), NOT_ASKED)


def _check_rows(chosen: Benchmark, only: Sequence[str]) -> None:
    known = [row_name(row) for part in chosen.parts for row in (*part.plain, *part.trained)]
    known += [row for these in chosen.shifts.values() for row in rows_of(these)]
    known += [spec for these in chosen.shifts.values() for row in these.rows for spec in these.settings(row)]
    known += [study.name for study in chosen.studies]
    for row in only:
        if row not in known:
            raise SpecError(f"{chosen.name} has no row `{row}`.{catalog.suggest(row, dict.fromkeys(known))}")


def processes(count: int) -> int:
    """A number of processes; SpecError unless it is allowed."""
    return catalog.whole_number("jobs", count, 1, 4 * (os.cpu_count() or 1))
