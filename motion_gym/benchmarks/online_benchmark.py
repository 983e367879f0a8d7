"""The benchmark of online adaptation: every adapter on every kind of shift, with settings chosen on another shift."""

from __future__ import annotations

import functools
import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks import online_results
from motion_gym.contract import DataError, Predictor
from motion_gym.online.evaluation import Report
from motion_gym.online.streams import Stream, stream, stream_name
from motion_gym.online.target_oracle import TargetOracle
from motion_gym.stepping.harness import ready

SEEDS = (0, 1, 2, 3, 4)
"""Of the weights, and of the streams."""
BASELINE, NONE, ORACLE = "constant_velocity", "none", "oracle"
"""Rows that are in every table."""
TRIED: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "style": [{"memory": m} for m in (8, 16, 64)],
    "refine": [{"memory": m} for m in (16, 64)],
    "finetune": [{"rate": r, "least": n} for r in (1e-4, 3e-4, 1e-3, 3e-3) for n in (6, 12)],
    "ema_anchor": [{"rate": r, "anchor": a} for r in (1e-4, 3e-4, 1e-3) for a in (0.001, 0.01)],
    "kalman": [{"ridge": r, "forgetting": f} for r in (1.0, 10.0, 100.0) for f in (0.97, 0.99, 1.0)],
    "hedge": [{"ridge": 1.0, "forgetting": f, "rate": r} for f in (0.97, 0.99, 1.0) for r in (3.0, 10.0)],
    "ekf": [{"noise": n, "spread": s} for n in (0.1, 0.3, 1.0) for s in (0.003, 0.01, 0.03)],
}
"""Settings of each adapter to choose from; the others are at their defaults."""


Tried = dict[str, dict[str, float]]
"""Errors by row and its settings."""
Found = dict[tuple[str, str, str], list[dict[str, Any]]]
"""Results of the seeds by name of the shifts, kind and row."""
Whole = tuple[dict[str, Tried], Found]
"""What was tried for each of the shifts, and all results."""
Make = Callable[[str, Callable[[Stream], Predictor], str, Mapping[str, Any]], dict[str, Any]]
"""From the row, what makes its predictor, what it is around, and the arguments of the stream to the result."""


@dataclass(frozen=True)
class Shifts:
    """Streams of one sort of shift.

    Attributes:
        title: Heading.
        source: Name of the predictor that is adapted.
        weights: Of it.
        streams: Arguments of ``stream`` by kind, without the seed.
        oracle: Predictors that were trained on the target, without the seed: by domain, or one for all.
        rows: Adapters.
        chosen_on: Arguments of ``stream`` of another shift, which settings are chosen on; its frames are not scored.
        chosen_with: Weights that are used there.
    """

    title: str
    source: str
    weights: str
    streams: Mapping[str, Mapping[str, Any]]
    oracle: str | Mapping[str, str]
    rows: Sequence[str]
    chosen_on: Mapping[str, Any]
    chosen_with: str

    def of(self, seed: int, weights: str | None = None) -> str:
        """Spec of the predictor that is adapted."""
        return _seeded(f"{self.source}:weights={weights or self.weights}", seed)

    def oracle_of(self, seed: int) -> TargetOracle:
        """The oracle."""
        if isinstance(self.oracle, str):
            return TargetOracle(_seeded(self.oracle, seed))
        return TargetOracle({domain: _seeded(spec, seed) for domain, spec in self.oracle.items()})


STGAT_ROWS = (
    "finetune:parts=all,every=4",
    "finetune:parts=last_layer,every=4",
    "ema_anchor:parts=all,every=4",
    "kalman",
    "hedge",
    "ekf:parts=last_layer,every=4",
)
STYLE_ROWS = (
    "style",
    "refine",
    "finetune:parts=all",
    "finetune:parts=style",
    "finetune:parts=modulator",
    "finetune:parts=last_layer",
    "ema_anchor:parts=all",
    "kalman",
    "hedge",
    "ekf:parts=modulator",
)


def _kinds(domains: Sequence[str], frames: Sequence[int], again: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
    """Arguments of the kinds of stream: frames of a visit by kind; ``again`` is what recurs, else all do, twice."""
    sudden, gradual, recurring = frames
    back: dict[str, Any] = {"domains": list(again or domains), "kind": "sudden" if again else "recurring"}
    return {
        "sudden": {"domains": list(domains), "kind": "sudden", "frames": sudden},
        "gradual": {"domains": list(domains), "kind": "gradual", "frames": gradual},
        "recurring": {**back, "frames": recurring},
    }


SHIFTS: Mapping[str, Shifts] = {
    "style": Shifts(
        "Crowds of another style: d = 0.3, then 0.6",
        "modular_invariant",
        "style",
        _kinds(("orca:d=0.3", "orca:d=0.6"), (3200, 1600, 1200)),
        "modular_invariant:weights=online/orca",
        STYLE_ROWS,
        {"domains": ["orca:d=0.3", "orca:d=0.5"], "frames": 1600, "split": "val"},
        "style/held_out",
    ),
    "alpha": Shifts(
        "Another noise: eth with alpha = 1, then 64",
        "erm",
        "spurious",
        _kinds(("eth:alpha=1", "eth:alpha=64"), (420, 420, 200)),
        {"eth:alpha=1.0": "erm:weights=online/alpha_1", "eth:alpha=64.0": "erm:weights=online/alpha_64"},
        STGAT_ROWS,
        {"domains": ["zara2:alpha=8", "zara2:alpha=32"], "frames": 180, "split": "val"},
        "spurious",
    ),
    "places": Shifts(
        "Other places: hotel, zara1, univ",
        "erm_no_sigma",
        "online/places",
        _kinds(("hotel", "zara1", "univ"), (200, 200, 200), ("hotel", "zara1", "univ", "hotel")),
        "erm_no_sigma:weights=original/zara2",
        STGAT_ROWS,
        {"domains": ["zara2", "eth6"], "frames": 200},
        "online/places",
    ),
}


def settings(row: str) -> list[str]:
    """Specs of a row with all the settings that are tried."""
    name, parameters = catalog.parse_spec(row)
    return [catalog.format_spec(name, {**parameters, **more}) for more in TRIED[name]]


def choices(shifts: Shifts, make: Make, report: Report = lambda done, of, what: None) -> Tried:
    """ADE, metres, of each row by its settings over the shift among sources, the mean over its segments."""
    on = {**shifts.chosen_on, "kind": "sudden", "seed": 0}
    of = shifts.of(0, shifts.chosen_with)
    jobs = [(row, spec) for row in (NONE, *shifts.rows) for spec in ([NONE] if row == NONE else settings(row))]
    found: Tried = {}
    for done, (row, spec) in enumerate(jobs):
        report(done, len(jobs), f"choosing: {spec}")
        result = make(spec, functools.partial(_adapter, spec, of), of, on)
        found.setdefault(row, {})[spec] = float(np.mean([s["ade"]["mean"] for s in result["segments"]]))
    return found


def chosen(values: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    """The best settings of each row."""
    return {row: min(tried, key=lambda spec: tried[spec]) for row, tried in values.items()}


def run(folder: Path, report: Report = lambda done, of, what: None, only: Sequence[str] = tuple(SHIFTS)) -> Whole:
    """Choose settings, and run every row on every stream; a result that is in ``folder`` already is read.

    Args:
        folder: For one JSON file per run; ``choice`` in it is for those that settings are chosen by.
        report: Called before each run with the number of runs done, of all, and what is next.
        only: Names of shifts.
    """

    def make(into: Path) -> Make:
        def made(row: str, who: Callable[[Stream], Predictor], of: str, on: Mapping[str, Any]) -> dict[str, Any]:
            played = _stream(json.dumps(on))
            return online_results.run(row, who(played), of, played, into)

        return made

    return _all(make(folder / "choice"), make(folder), report, only)


def read(folder: Path) -> Whole:
    """What ``run`` left in a folder, made by whatever version of the code.

    Raises:
        DataError: a run is missing.
    """

    def make(into: Path) -> Make:
        there = online_results.read_folder(into)

        def found(row: str, who: Callable[[Stream], Predictor], of: str, on: Mapping[str, Any]) -> dict[str, Any]:
            name = stream_name(**on)
            if (row, of, name) not in there:
                raise DataError(f"{into} has no result of {row} on {name}: motion-gym run online --out {folder.parent}")
            return there[row, of, name]

        return found

    return _all(make(folder / "choice"), make(folder), lambda done, of, what: None, tuple(SHIFTS))


def _all(choose: Make, make: Make, report: Report, only: Sequence[str]) -> Whole:
    tried: dict[str, Tried] = {}
    found: Found = {}
    jobs = list(_jobs(only))
    for done, (name, kind, row, seed) in enumerate(jobs):
        shifts = SHIFTS[name]
        if name not in tried:
            tried[name] = choices(shifts, choose, report)
        spec = chosen(tried[name]).get(row, row)
        report(done, len(jobs), f"{name}, {kind}: {spec}, seed {seed}")
        on, of = {**shifts.streams[kind], "seed": seed}, shifts.of(seed)
        result = make(spec, functools.partial(_who, shifts, spec, seed), of, on)
        found.setdefault((name, kind, row), []).append(result)
    return tried, found


def _who(shifts: Shifts, spec: str, seed: int, on: Stream) -> Predictor:
    if spec == ORACLE:
        return shifts.oracle_of(seed)
    return ready(BASELINE, on.domains[0]) if spec == BASELINE else catalog.adapter(spec, shifts.of(seed))


def _adapter(spec: str, of: str, on: Stream) -> Predictor:
    return catalog.adapter(spec, of)


@functools.lru_cache(maxsize=8)
def _stream(arguments: str) -> Stream:
    return stream(**json.loads(arguments))


def _jobs(only: Sequence[str]) -> Iterator[tuple[str, str, str, int]]:
    for name in only:
        rows = (BASELINE, NONE, ORACLE, *SHIFTS[name].rows)
        yield from ((name, kind, row, seed) for kind, row, seed in itertools.product(SHIFTS[name].streams, rows, SEEDS))


def _seeded(spec: str, seed: int) -> str:
    name, parameters = catalog.parse_spec(spec)
    return catalog.format_spec(name, {**parameters, "seed": seed})
