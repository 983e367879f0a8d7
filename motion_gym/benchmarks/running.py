"""How a benchmark is run: what the store has is shown, what is missing is computed."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.jobs import (
    CHOICE,
    STUDY,
    Tried,
    choice_jobs,
    compute_missing,
    rows_of,
    stream_jobs,
    study_jobs,
    window_jobs,
)
from motion_gym.benchmarks.objects import Benchmark, Part, Report
from motion_gym.benchmarks.store import Run, Store
from motion_gym.contract import SpecError

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
    streams: dict[tuple[str, ...], list[Run]] = field(default_factory=dict)
    studies: dict[str, dict[str, Any]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    unwritten: list[str] = field(default_factory=list)
    compared: list[tuple[str, str, str, dict[str, Any]]] = field(default_factory=list)

    def __str__(self) -> str:
        """The tables that ``motion-gym run`` prints, as Markdown."""
        from motion_gym.benchmarks.reports import pages  # which needs what is defined here

        missing = [f"Not shown: {row}: {reason}" for row, reason in self.missing.items()]
        return "\n\n".join([*(table.markdown() for table in pages.short(self)), *missing])


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

    Returns:
        The runs; rows that could not be computed are named in ``missing``, with the reason.

    Raises:
        SpecError: a name is not known.
    """
    chosen = benchmark(name)
    for wanted in shifts:
        if wanted not in chosen.shifts:
            raise SpecError(f"{chosen.name} has no shift `{wanted}`.{catalog.suggest(wanted, chosen.shifts)}")
    _check_rows(chosen, only)
    count = catalog.whole_number("jobs", jobs, 1, 4 * (os.cpu_count() or 1))
    session = session or secrets.token_hex(8)
    kept = Store(chosen.name, folder)
    results = Results(chosen, kept)
    reasons: dict[str, str] = {}
    how: dict[str, Any] = {"fresh": fresh, "only": only, "count": count, "report": report}
    how |= {"reasons": reasons, "missing": results.missing}
    names = shifts or list(chosen.shifts)
    first = [*window_jobs(chosen, session), *study_jobs(chosen, session), *choice_jobs(chosen, names, session)]
    rows = compute_missing(kept, first, **how)
    results.parts = [
        (p, [run for key, runs in rows.items() if key[0] == p.title for run in runs]) for p in chosen.parts
    ]
    results.studies = {name: runs[0]["value"] for (where, *_, name), runs in rows.items() if where == STUDY}
    results.tried = {
        name: {key[2]: _ade_by_setting(runs) for key, runs in rows.items() if key[:2] == (name, CHOICE)}
        for name in names
    }
    results.streams = compute_missing(kept, list(stream_jobs(chosen, names, results.tried, session)), **how)
    if predictors or adapters:
        from motion_gym.benchmarks import own_rows  # which needs what is defined here

        own_rows.add(results, predictors, adapters, of, session, how)
    results.unwritten = list(dict.fromkeys(reason for key, reason in reasons.items() if key in kept.runs))
    return results


def _ade_by_setting(runs: Sequence[Run]) -> dict[str, float]:
    """ADE by settings on the shift that they are chosen on, the mean over its segments."""
    return {run["row"]: float(np.mean([segment["ade"]["mean"] for segment in run["segments"]])) for run in runs}


def _check_rows(chosen: Benchmark, only: Sequence[str]) -> None:
    known = [row_name(row) for part in chosen.parts for row in (*part.plain, *part.trained)]
    known += [row for these in chosen.shifts.values() for row in rows_of(these)]
    known += [spec for these in chosen.shifts.values() for row in these.rows for spec in these.settings(row)]
    known += [study.name for study in chosen.studies]
    for row in only:
        if row not in known:
            raise SpecError(f"{chosen.name} has no row `{row}`.{catalog.suggest(row, dict.fromkeys(known))}")
