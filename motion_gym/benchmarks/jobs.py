"""The runs of a benchmark: how each run is computed, and how missing runs are computed together."""

from __future__ import annotations

import concurrent.futures
import functools
import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks import executors
from motion_gym.benchmarks import store as stores
from motion_gym.benchmarks.executors import Opener
from motion_gym.benchmarks.identity import answered_by, label_of, question, row_name
from motion_gym.benchmarks.objects import FILTERS, FURTHER_SEEDS, NONE, ORACLE, SEEDS, Benchmark, Report, Shifts, Study
from motion_gym.benchmarks.row_specs import domain
from motion_gym.benchmarks.store import Run, Store
from motion_gym.contract import MotionGymError, SpecError

NOT_REQUESTED = "not requested"
"""Reason for a missing row that ``only`` does not name."""
NAMED = 8
"""Most rows that are named for one reason, and most reasons that are named."""
STUDY, CHOICE, FURTHER = "study", "choice of settings", "further seeds"
"""Where studies are shown, runs from which settings are chosen, and runs with further seeds."""
Errors = dict[str, dict[str, float]]
"""ADE in metres by row and by its settings."""


@dataclass(frozen=True)
class Job:
    """Runs that are computed together.

    Attributes:
        label: Description for people.
        where: Where the runs are shown: title of a table, perhaps with a column, or name of the shifts with the kind of
            stream.
        row: Row of the table.
        domain: Domains that are read; jobs with the same domains follow each other.
        identities: Identity of each run.
        compute: Returns the results, in JSON types; must be picklable to be called in another process.
    """

    label: str
    where: tuple[str, ...]
    row: str
    domain: str
    identities: Sequence[Mapping[str, Any]]
    compute: Callable[[], Sequence[Mapping[str, Any]]]

    @property
    def questions(self) -> tuple[str, ...]:
        """Keys of the runs in the store."""
        return tuple(map(question, self.identities))


@dataclass
class Runner:
    """Computes the runs that a store lacks.

    Attributes:
        store: The store.
        fresh: Whether runs in the store are computed again.
        only: Rows that are computed; None for all, and an empty sequence for none.
        executor: Opens the executor that computes a number of jobs.
        report: Called before each run with the number of finished runs, the number of all runs, and a label.
        missing: Reason for each row with a missing run, by where the row is shown and the row.
        unwritten: Reasons why runs that are shown could not be computed again or written.
        computed: Runs that were computed.
    """

    store: Store
    fresh: bool = False
    only: Sequence[str] | None = None
    executor: Opener = executors.here
    report: Report = lambda done, total, label: None
    missing: dict[tuple[str, ...], str] = field(default_factory=dict)
    unwritten: dict[str, None] = field(default_factory=dict)
    computed: list[Run] = field(default_factory=list)

    def rows(self, jobs: Sequence[Job]) -> dict[tuple[str, ...], list[Run]]:
        """Compute the missing runs of some jobs, and write each run as soon as it is computed.

        Returns:
            Runs of the complete rows by where the row is shown and the row, in the order of the jobs.
        """
        wanted = {
            job.questions: job
            for job in jobs
            if (self.only is None or job.row in self.only)
            and (self.fresh or not all(map(self.store.find, job.identities)))
        }
        # One domain after the other, since the windows of a domain are kept.
        order = sorted(wanted.values(), key=lambda job: job.domain)
        reasons: dict[tuple[str, ...], str] = {}
        for done, (job, result) in enumerate(self._results(order)):
            try:
                runs = result()
                self.store.take(runs)
                self.computed += runs
                for computed in runs:
                    stores.write(self.store.folder, computed)
            except MotionGymError as error:
                reasons[job.questions] = str(error)
            self.report(done + 1, len(order), job.label)
        rows: dict[tuple[str, ...], list[Run]] = {}
        for job in jobs:
            key, reason = (*job.where, job.row), reasons.get(job.questions)
            runs = [run for identity in job.identities if (run := self.store.find(identity))]
            rows.setdefault(key, []).extend(runs)
            if len(runs) < len(job.identities):
                self.missing.setdefault(key, reason or NOT_REQUESTED)
            elif reason:
                self.unwritten[reason] = None
        return {key: runs for key, runs in rows.items() if key not in self.missing}

    def not_shown(self) -> str:
        """The rows that are not shown, a line for each reason; rows that were not requested are left out.

        What to do is said with the first of the reasons that end with the same sentences.
        """
        reasons: dict[str, dict[str, list[str]]] = {}
        for (*where, row), reason in self.missing.items():
            if reason != NOT_REQUESTED:
                reasons.setdefault(reason, {}).setdefault(row, []).append(", ".join(where))
        lines: list[str] = []
        said: set[str] = set()
        for reason, by_row in reasons.items():
            what, _, remedy = reason.partition(". ")
            if remedy in said:
                reason = f"{what}."
            elif remedy:
                said.add(remedy)
            rows = [_with_columns(row, columns) for row, columns in by_row.items()]
            lines.append(f"Not shown: {', '.join(_first(rows, 'rows'))}: {reason}")
        return "\n".join(_first(lines, "messages"))

    def _results(self, order: Sequence[Job]) -> Iterator[tuple[Job, Callable[[], list[Run]]]]:
        """Each job, in the order in which they finish, with a function that returns its runs."""
        executor = self.executor(len(order))
        if executor is None:
            for done, job in enumerate(order):
                self.report(done, len(order), job.label)
                yield job, functools.partial(_compute, job)
            return
        with executor:
            futures = {executor.submit(_compute, job): job for job in order}
            for future in concurrent.futures.as_completed(futures):
                yield futures[future], future.result


def _with_columns(row: str, columns: Sequence[str]) -> str:
    if len(columns) > 2:
        return f"{row} ({len(columns)} columns)"
    return f"{row} ({'; '.join(columns)})" if any(columns) else row


def _first(texts: list[str], name: str) -> list[str]:
    """The first texts, and the number of further ones."""
    return texts if len(texts) <= NAMED else [*texts[:NAMED], f"and {len(texts) - NAMED} more {name}"]


def _compute(job: Job) -> list[Run]:
    """Runs of a job."""
    return [stores.run_of(identity, result) for identity, result in zip(job.identities, job.compute(), strict=True)]


def window_jobs(benchmark: Benchmark, session: str) -> Iterator[Job]:
    """Every predictor on every column."""
    for part in benchmark.parts:
        for predictor, column in part.runs():
            spec, identity = part.domains[column], part.identity(predictor, column, session)
            compute = functools.partial(score_windows, predictor, spec, part.options(column))
            if external := part.fingerprints.get(predictor):
                compute = functools.partial(_score_external, predictor, spec, part.options(column), external)
            yield Job(f"{predictor} on {spec}", (part.title,), row_name(predictor), spec, [identity], compute)


def score_windows(predictor: str, place: Any, options: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Scores of a predictor on a domain or its spec, in JSON types."""
    from motion_gym.scoring.evaluation import evaluate

    return [evaluate(predictor, domain(place), **options).as_dict()]


def _score_external(predictor: str, place: str, options: Mapping[str, Any], fingerprint: str) -> list[dict[str, Any]]:
    """Scores of an external program, which is asked one window at a time, so that every window is asked once.

    Raises:
        SpecError: there is no checkout of it, or the checkout has other weights.
    """
    present = getattr(catalog.predictor(predictor), "fingerprint", None)
    if present != fingerprint:
        raise SpecError(
            f"The weights of {predictor} have the fingerprint {present}, and those of the stored row {fingerprint}: "
            "check out the commit that examples/published/README.md names."
        )
    return score_windows(predictor, place, {**options, "through": "environment", "verify": False})


def study_jobs(benchmark: Benchmark, session: str) -> Iterator[Job]:
    """Every study."""
    for study in benchmark.studies:
        used = answered_by(study.uses, [domain(spec) for spec in study.reads], session)
        used["versions"] |= {"study": study.version}
        if not study.compute.startswith("motion_gym."):
            used["session"] = session  # the code of a user's study is not known
        identity = {"kind": "study", "study": study.name, "arguments": dict(study.arguments), **used}
        yield Job(study.name, (STUDY,), study.name, "", [identity], functools.partial(_compute_study, study))


def _compute_study(study: Study) -> list[dict[str, Any]]:
    compute: Any = catalog.load_class(study.compute, "study")
    return [{"study": study.name, "value": json.loads(json.dumps(compute(**study.arguments), allow_nan=False))}]


def choice_jobs(benchmark: Benchmark, names: Sequence[str], session: str) -> Iterator[Job]:
    """Every setting of every adapter on the stream that settings are chosen on."""
    for name in names:
        shifts = benchmark.shifts[name]
        if shifts.chosen_on:
            of, arguments = shifts.of(0, shifts.chosen_with), {**shifts.chosen_on, "kind": "sudden", "seed": 0}
            settings = {NONE: [NONE], **{row: shifts.settings(row) for row in shifts.rows}}
            for row, spec in ((row, spec) for row, specs in settings.items() for spec in specs):
                yield stream_job(shifts, (name, CHOICE), row, spec, of, arguments, session)


def stream_jobs(benchmark: Benchmark, errors: Mapping[str, Errors], session: str) -> Iterator[Job]:
    """Every adapter, with its best settings, on every stream with every seed.

    Args:
        benchmark: The benchmark.
        errors: Errors of the settings by the name of the shifts that are run.
        session: Name of the command.
    """
    for name, errors_of_rows in errors.items():
        shifts, best = benchmark.shifts[name], best_settings(errors_of_rows)
        for kind, row, seed in itertools.product(shifts.streams, shifts.all_rows(), SEEDS):
            arguments = {**shifts.streams[kind], "seed": seed}
            yield stream_job(shifts, (name, kind), row, best.get(row, row), shifts.of(seed), arguments, session)
        experts = [row for row in shifts.rows if catalog.parse_spec(row)[0] == "hedge"]
        for kind, row, seed in itertools.product(shifts.streams, experts, FURTHER_SEEDS):
            arguments = {**shifts.streams[kind], "seed": seed}
            where = name, f"{kind}, {FURTHER}"
            yield stream_job(shifts, where, row, best.get(row, row), shifts.of(seed), arguments, session)


def stream_job(
    shifts: Shifts, where: tuple[str, ...], row: str, adapter: Any, of: str, arguments: Mapping[str, Any], session: str
) -> Job:
    """An adapter, a spec or a class, around a predictor on a stream, with the arguments of ``stream``."""
    text = json.dumps(arguments, sort_keys=True)
    oracle, fitted_to = shifts.oracle_of(arguments["seed"]), tuple(shifts.fitted_to)
    compute = functools.partial(_stream_result, adapter, of, oracle, text, fitted_to)
    label = f"{', '.join(where)}: {label_of(adapter)}, seed {arguments['seed']}"
    return Job(label, where, row, text, [shifts.identity(adapter, of, arguments, session)], compute)


def _stream_result(
    row: Any, of: str, oracle: str | Mapping[str, str], arguments: str, fitted_to: tuple[str, ...]
) -> list[dict[str, Any]]:
    return [score_stream(row, of, oracle, arguments, fitted_to)[1]]


def score_stream(
    row: Any, of: str, oracle: Any, arguments: str, fitted_to: tuple[str, ...] = ()
) -> tuple[Any, dict[str, Any]]:
    """Card of a row around a predictor on a stream, and the result in JSON types.

    Args:
        row: Spec of an adapter, a class of adapters, one of ``FILTERS`` or ``oracle``.
        of: Predictor that is adapted.
        oracle: Specs of the oracle's predictors.
        arguments: Arguments of ``stream``, as JSON.
        fitted_to: Domains on whose training windows the adapted predictor is fitted; empty if it has weights.
    """
    from motion_gym.online.evaluation import evaluate_online
    from motion_gym.online.target_oracle import TargetOracle

    if row == ORACLE:
        predictor: Any = TargetOracle(oracle)
    else:
        source = _fitted(of, fitted_to) if fitted_to else of
        predictor = catalog.predictor(row) if row in FILTERS else catalog.adapter(row, source)
    card = evaluate_online(predictor, _stream(arguments))
    return card, {"row": label_of(row), "of": of, **card.as_dict()}


@functools.lru_cache(maxsize=4)
def _fitted(spec: str, domains: tuple[str, ...]) -> Any:
    """A predictor that is fitted to the training windows of some domains."""
    predictor: Any = catalog.predictor(spec)
    places = [domain(name) for name in domains]
    predictor.fit([place.windows("train") for place in places], [place.windows("val") for place in places], 0)
    predictor.trained_on = domains
    return predictor


@functools.lru_cache(maxsize=8)
def _stream(arguments: str) -> Any:
    from motion_gym.online.streams import stream

    options = json.loads(arguments)
    # Domains are kept from one stream to the next, with their recordings and what they share with other domains.
    return stream(**{**options, "domains": [domain(spec) for spec in options["domains"]]})


def best_settings(errors: Errors) -> dict[str, str]:
    """Spec of the settings with the lowest error, by row."""
    return {row: min(by_spec, key=lambda spec: by_spec[spec]) for row, by_spec in errors.items()}
