"""Running a benchmark: stored runs are shown, and missing runs are computed."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks import executors
from motion_gym.benchmarks.drives import Drives, drive_jobs
from motion_gym.benchmarks.executors import Opener
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.jobs import (
    CHOICE,
    FURTHER,
    STUDY,
    Errors,
    Runner,
    choice_jobs,
    stream_jobs,
    study_jobs,
    window_jobs,
)
from motion_gym.benchmarks.objects import BASELINE, NONE, ORACLE, Benchmark, Part, Report
from motion_gym.benchmarks.store import Run, Store
from motion_gym.contract import SpecError
from motion_gym.own_classes import class_hint

BENCHMARKS: Mapping[str, str] = {
    "spurious": "motion_gym.benchmarks.definitions.places:SPURIOUS",
    "places": "motion_gym.benchmarks.definitions.places:UNSEEN",
    "elsewhere": "motion_gym.benchmarks.definitions.places:ELSEWHERE",
    "original": "motion_gym.benchmarks.definitions.places:ORIGINAL",
    "style": "motion_gym.benchmarks.definitions.styles:STYLE",
    "factors": "motion_gym.benchmarks.definitions.factors:FACTORS",
    "crowd": "motion_gym.benchmarks.definitions.styles:CROWD",
    "transfer": "motion_gym.benchmarks.definitions.styles:TRANSFER",
    "refinement": "motion_gym.benchmarks.definitions.styles:REFINEMENT",
    "pretraining": "motion_gym.benchmarks.definitions.styles:PRETRAINING",
    "online": "motion_gym.benchmarks.definitions.streams:ONLINE",
    "vehicles": "motion_gym.benchmarks.definitions.traffic:VEHICLES",
    "vehicles_spurious": "motion_gym.benchmarks.definitions.traffic:VEHICLES_SPURIOUS",
    "planning": "motion_gym.benchmarks.definitions.driving:PLANNING",
    "baselines": "motion_gym.benchmarks.definitions.places:BASELINES",
    "sdd": "motion_gym.benchmarks.definitions.drone:SDD",
    "sdd_style": "motion_gym.benchmarks.definitions.drone:SDD_STYLE",
    "published": "motion_gym.benchmarks.definitions.published_forecasters:PUBLISHED",
}
"""Where each shipped benchmark is defined, by its name."""


@dataclass
class Results:
    """Runs of a benchmark, as tables read them.

    Attributes:
        benchmark: The benchmark.
        runner: The store with the runs, the reasons for missing rows, and the reasons for runs that were not written.
        parts: Each part with its runs.
        errors: ADE by row and settings on the shift that settings are chosen on, by name of the shifts.
        streams: Runs of all seeds by name of the shifts, kind and row.
        studies: Stored values by name of the study.
        drives: Tables of driven episodes, each with its runs.
    """

    benchmark: Benchmark
    runner: Runner
    parts: list[tuple[Part, list[Run]]] = field(default_factory=list)
    errors: dict[str, Errors] = field(default_factory=dict)
    streams: dict[tuple[str, ...], list[Run]] = field(default_factory=dict)
    studies: dict[str, dict[str, Any]] = field(default_factory=dict)
    drives: list[tuple[Drives, list[Run]]] = field(default_factory=list)

    def __str__(self) -> str:
        """The tables that ``motion-gym run`` prints, as Markdown."""
        from motion_gym.benchmarks.reports import pages  # imports this module

        return "\n\n".join([*(table.markdown() for table in pages.short(self)), self.runner.not_shown()]).rstrip()

    def stream_rows(self, name: str, kind: str) -> dict[str, list[Run]]:
        """Runs of all seeds by row, for one kind of stream; empty if a row that others are compared with is missing."""
        rows = {key[2]: runs for key, runs in self.streams.items() if key[:2] == (name, kind)}
        return rows if {BASELINE, NONE, ORACLE} <= rows.keys() else {}

    def with_experts(self) -> dict[tuple[str, str, str], list[Run]]:
        """Runs of all seeds of rows that combine experts, by name of the shifts, kind and row."""
        found: dict[tuple[str, str, str], list[Run]] = {}
        for (name, kind, row), runs in self.streams.items():
            if all(run.get("experts") for run in runs):
                found.setdefault((name, kind.removesuffix(f", {FURTHER}"), row), []).extend(runs)
        return found


def benchmark(name: str | Benchmark) -> Benchmark:
    """A benchmark by its name, by ``"module:OBJECT"``, or as it is.

    Raises:
        SpecError: no benchmark has that name.
    """
    value = name if isinstance(name, Benchmark) else _named(name)
    if value.name in BENCHMARKS and name != value.name and value != benchmark(value.name):
        raise SpecError(f"Your benchmark has the name `{value.name}` of a shipped one: give it another name.")
    return value


def _named(name: str) -> Benchmark:
    if name not in BENCHMARKS and ":" not in name:
        hint = class_hint(name, Benchmark.__name__, classes=False)
        hint = hint or f"{catalog.suggest(name, BENCHMARKS)} Your own: `module:OBJECT`."
        raise SpecError(f"There is no benchmark `{name}`.{hint}")
    value = catalog.load_object(BENCHMARKS.get(name, name), "benchmark", (Benchmark,))
    if callable(value):
        value = value()
    if not isinstance(value, Benchmark):
        raise SpecError(f"`{name}` is a {type(value).__name__}: make it a motion_gym.benchmarks.objects.Benchmark.")
    return value


def run(
    name: str | Benchmark,
    predictors: Sequence[Any] = (),
    folder: Path | None = None,
    *,
    adapters: Sequence[Any] = (),
    of: str | None = None,
    shifts: Sequence[str] = (),
    fresh: bool = False,
    only: Sequence[str] | None = None,
    executor: Opener = executors.here,
    session: str | None = None,
    report: Report = lambda done, total, label: None,
) -> Results:
    """Read the stored runs of a benchmark, and compute the missing ones.

    Args:
        name: The benchmark.
        predictors: Further rows: a user's predictors, which are scored on every column.
        folder: Folder for one small file per run; None to write none.
        adapters: Further rows on streams: a user's adapters.
        of: Predictor that these adapters are put around; by default the one of each of the shifts.
        shifts: Names of the shifts that are run; all by default.
        fresh: Whether stored runs are computed again.
        only: Rows that are computed; all by default, and none if it is empty.
        executor: Where the runs are computed: ``executors.here``, ``executors.processes(4)`` or
            ``executors.ray()``.
        session: Name of the command, see ``identity.answered_by``; a new one by default.
        report: Called before each run with the number of finished runs, the number of all runs, and a label.

    Returns:
        The runs; ``runner.missing`` has the reason for each row that is not shown.

    Raises:
        SpecError: a name is not known.
    """
    chosen = benchmark(name)
    for shift in shifts:
        if shift not in chosen.shifts:
            raise SpecError(f"{chosen.name} has no shift `{shift}`.{catalog.suggest(shift, chosen.shifts)}")
    _check_rows(chosen, only or ())
    if predictors or adapters:
        from motion_gym.benchmarks import own_rows  # imports this module

        own_rows.check(chosen, predictors, adapters, of)
    session = session or secrets.token_hex(8)
    runner = Runner(Store(chosen.name, folder), fresh, only, executor, report)
    results = Results(chosen, runner)
    names = shifts or list(chosen.shifts)
    rows = runner.rows(
        [*window_jobs(chosen, session), *study_jobs(chosen, session), *choice_jobs(chosen, names, session)]
    )
    results.parts = [
        (part, [run for key, runs in rows.items() if key[0] == part.title for run in runs]) for part in chosen.parts
    ]
    results.studies = {study: runs[0]["value"] for (where, *_, study), runs in rows.items() if where == STUDY}
    results.errors = {
        shift: {row: _error_by_setting(runs) for (*where, row), runs in rows.items() if where == [shift, CHOICE]}
        for shift in names
    }
    driven = runner.rows(list(drive_jobs(chosen, session)))
    results.drives = [
        (drives, [run for key, runs in driven.items() if key[0] == drives.title for run in runs])
        for drives in chosen.drives
    ]
    results.streams = runner.rows(list(stream_jobs(chosen, results.errors, session)))
    if predictors or adapters:
        own_rows.add(results, predictors, adapters, of, session)
    return results


def _error_by_setting(runs: Sequence[Run]) -> dict[str, float]:
    """ADE by settings, the mean over the segments of the stream."""
    return {run["row"]: float(np.mean([segment["ade"]["mean"] for segment in run["segments"]])) for run in runs}


def _check_rows(chosen: Benchmark, only: Sequence[str]) -> None:
    known = [row_name(row) for part in chosen.parts for row in (*part.plain, *part.trained, *part.fingerprints)]
    for shifts in chosen.shifts.values():
        known += [*shifts.all_rows(), *(spec for row in shifts.rows for spec in shifts.settings(row))]
    known += [study.name for study in chosen.studies]
    known += [row_name(row) for drives in chosen.drives for row in drives.rows()]
    for row in only:
        if row not in known:
            raise SpecError(f"{chosen.name} has no row `{row}`.{catalog.suggest(row, dict.fromkeys(known))}")
