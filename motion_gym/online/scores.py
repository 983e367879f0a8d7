"""Scores of a predictor on a stream: over time, by segment, after a shift, and on return to a domain."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from motion_gym.metrics.bootstrap import Summary, clustered_interval, replicates_for
from motion_gym.scoring.cards import in_json

TRAIL = 50
"""Number of matured forecasts in a trailing mean."""
EVERY = 10
"""Number of matured forecasts between two points after a shift."""
BLOCK = 100
"""Number of matured forecasts in a block, the unit of recovery from a shift."""
PHASE = 600
"""Least number of matured forecasts of a phase in which recovery is computed."""
WITHIN = 1.1
"""A block is recovered if its error is at most this multiple of the error of the oracle's block."""
POINTS = 200
"""Most points of a curve."""


@dataclass(frozen=True)
class SegmentScore:
    """Scores of a predictor on one segment of a stream.

    Attributes:
        domain: Spec.
        start: Seconds from the start of the stream.
        stop: Seconds from the start of the stream.
        ade: ADE of the forecasts made here that matured.
        fde: FDE of the same forecasts.
        censored: Forecasts whose agent left before their last step, or before the segment's end.
        updates: Updates in this segment.
    """

    domain: str
    start: float
    stop: float
    ade: Summary
    fde: Summary
    censored: int
    updates: int


@dataclass(frozen=True)
class Shift:
    """A change from one domain to another.

    Attributes:
        segment: Number of the segment that begins.
        at: Seconds from the start of the stream.
        before: ADE over the segment before, metres.
        after: Rows of: matured forecasts since the shift, seconds since the shift until the last of them matured, and
            ADE over the last 50 of them, metres.
        blocks: The same for consecutive blocks of 100: matured forecasts and seconds until the end of the block, and
            ADE over the block. Forecasts after the last whole block are left out.
    """

    segment: int
    at: float
    before: float
    after: list[tuple[int, float, float]]
    blocks: list[tuple[int, float, float]]


class Recovery(NamedTuple):
    """Time of the recovery from a shift: matured forecasts and seconds after the shift."""

    forecasts: int
    seconds: float


@dataclass(frozen=True, eq=False)
class OnlineCard:
    """The scores of a predictor on a stream, and how they were computed.

    Attributes:
        predictor: Name or spec.
        stream: Name.
        domains: Cards of the domains, by spec.
        labels: ``matured`` or ``stepwise``.
        scope: Scope of learned state: ``stream``, ``place`` or ``agent``.
        realtime: Whether the stream did not wait for updates.
        cost: Declared seconds of an update, None where they were measured.
        protocol: Always ``honest``.
        k: Samples.
        seed: Of a stochastic predictor's samples.
        ade: ADE over all matured forecasts.
        fde: FDE over all matured forecasts.
        censored: Forecasts whose agent left before their last step.
        segments: The same by segment.
        curve: Rows of seconds from the start, and the trailing mean ADE over the last 50 forecasts by when they were
            made.
        shifts: Changes of the domain after which at least 50 forecasts matured.
        returns: Rows of domain, ADE of its first visit, and of a later one, where at least 50 forecasts matured.
        experts: ADE of each expert on the matured forecasts, by name, for a predictor that combines experts.
        updates: Number of updates.
        rolled_back: Number of updates that were rolled back because of weights that are not finite.
        skipped: Number of steps at which ground truth was revealed during an update (realtime).
        update_seconds: Median and 95th percentile of a call of ``observe``, with or without an update.
        tick_seconds: Median and 95th percentile of a step: the update, if there is one, and the forecasts.
        peak_memory: Bytes, of the whole process.
        oracle: Whether the predictor is an oracle.
        leaks: Declared leaks of the future.
        selection: How weights were selected.
        values: ADE of each matured forecast, in the order of the forecasts; not written to files.
        made: Listed frame of each forecast; not written to files.
        person: Agent of each forecast, numbered over the stream; not written to files.
    """

    predictor: str
    stream: str
    domains: Mapping[str, Any]
    labels: str
    scope: str
    realtime: bool
    cost: float | None
    protocol: str
    k: int
    seed: int
    ade: Summary
    fde: Summary
    censored: int
    segments: list[SegmentScore]
    curve: list[tuple[float, float]]
    shifts: list[Shift]
    returns: list[tuple[str, float, float]]
    experts: Mapping[str, float]
    updates: int
    rolled_back: int
    skipped: int
    update_seconds: tuple[float, float]
    tick_seconds: tuple[float, float]
    peak_memory: int
    oracle: bool
    leaks: tuple[str, ...]
    selection: str
    values: np.ndarray
    made: np.ndarray
    person: np.ndarray

    def as_dict(self) -> dict[str, Any]:
        """All attributes in JSON types, except the values of each forecast."""
        fields = (f.name for f in dataclasses.fields(self) if f.name not in ("values", "made", "person"))
        plain: dict[str, Any] = {name: getattr(self, name) for name in fields}
        plain["aggregation"] = (
            "each forecast was stored before its truth was told, and scored before it was learned from; means over "
            "matured agent-forecasts, most likely sample; 95 % intervals by bootstrap of whole agents"
        )
        return in_json(plain)  # type: ignore[no-any-return]

    def __str__(self) -> str:
        ms = 1000 * self.tick_seconds[1]
        return (
            f"{self.predictor} on {self.stream}: ADE {self.ade.mean:.3f} [{self.ade.low:.3f}, {self.ade.high:.3f}] m, "
            f"FDE {self.fde.mean:.3f} m over {self.ade.agent_windows} matured forecasts ({self.censored} censored); "
            f"{self.updates} updates, {ms:.1f} ms per step (95th percentile)"
        )


def summary_of(values: np.ndarray, person: np.ndarray, made: np.ndarray) -> Summary:
    """Mean of matured forecasts with its interval and counts."""
    mean, low, high = clustered_interval(values, person)
    people = len(np.unique(person))
    return Summary(mean, low, high, len(values), len(np.unique(made)), people, replicates_for(people))


def trailing(values: np.ndarray, width: int = TRAIL) -> np.ndarray:
    """[N] mean of each value and the values before it, ``width`` values or all."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - width, 0)
    return (total[last] - total[first]) / (last - first)


def curve_of(values: np.ndarray, seconds: np.ndarray) -> list[tuple[float, float]]:
    """The trailing mean over time, at most ``POINTS`` points of it, from the tenth forecast on."""
    mean = trailing(values)
    chosen = np.unique(np.linspace(min(EVERY, len(mean)) - 1, len(mean) - 1, POINTS).astype(int))
    return [(round(float(seconds[i]), 2), round(float(mean[i]), 4)) for i in chosen]


def shifts_of(
    values: np.ndarray, segment: np.ndarray, seconds: np.ndarray, labels: Sequence[str], starts
) -> list[Shift]:
    """The shifts of a stream.

    Args:
        values: [N] errors of matured forecasts, in the order of the forecasts.
        segment: [N] segment of each forecast.
        seconds: [N] time at which each forecast matured, from the start of the stream.
        labels: Domain of each segment.
        starts: Seconds at which each segment begins.
    """
    shifts = []
    for number in range(1, len(labels)):
        own = np.flatnonzero(segment == number)
        before = values[segment == number - 1]
        if labels[number] == labels[number - 1] or len(own) < TRAIL or not len(before):
            continue
        since, start = seconds[own] - starts[number], float(starts[number])
        after = _means_before(values[own], since, range(TRAIL, len(own) + 1, EVERY), TRAIL)
        blocks = _means_before(values[own], since, range(BLOCK, len(own) + 1, BLOCK), BLOCK)
        shifts.append(Shift(number, start, float(before.mean()), after, blocks))
    return shifts


def _means_before(
    values: np.ndarray, seconds: np.ndarray, counts: Sequence[int], width: int
) -> list[tuple[int, float, float]]:
    """Rows of a count n, the time of the n-th value, and the mean of the ``width`` values up to it."""
    mean = trailing(values, width)
    return [(n, round(float(seconds[n - 1]), 2), round(float(mean[n - 1]), 4)) for n in counts]


def returns_of(visits: Sequence[tuple[str, float | None, int]]) -> list[tuple[str, float, float]]:
    """Domain, error of the first visit, and of each later one.

    Args:
        visits: Domain, error, and number of matured forecasts, one by one; those of fewer than 50 do not count.
    """
    first: dict[str, float] = {}
    found = []
    for domain, error, count in visits:
        if error is None or count < TRAIL:
            continue
        if domain in first:
            found.append((domain, first[domain], error))
        first.setdefault(domain, error)
    return found


def recovery(shift: Mapping[str, Any], oracle: Mapping[str, Any]) -> Recovery | None:
    """Time from which a predictor is within 10 % of the oracle in every block of the phase; None if censored.

    The recovery must last until the phase ends: a low block does not count if a later block is high.

    Args:
        shift: A shift of a result, as ``as_dict`` gives it.
        oracle: The same shift in the result of the oracle on the same stream.

    Returns:
        Matured forecasts and seconds from the shift to the beginning of the first block from which on all blocks are
        recovered: 0 if all blocks are. None (censored) if the last block is not recovered, or if fewer than 600
        forecasts matured in the phase.
    """
    blocks = list(zip(shift["blocks"], oracle["blocks"], strict=True))
    if len(blocks) * BLOCK < PHASE:
        return None
    above = [number for number, ((*_, ade), (*_, level)) in enumerate(blocks) if ade > WITHIN * level]
    if not above:
        return Recovery(0, 0.0)
    forecasts, seconds, _ = blocks[above[-1]][0]
    return None if above[-1] == len(blocks) - 1 else Recovery(int(forecasts), float(seconds))


def after_first(result: Mapping[str, Any]) -> float:
    """Mean ADE, metres, over the segments after the first one, or over the only one."""
    parts = result["segments"][1:] or result["segments"]
    counted = [(s["ade"]["mean"], s["ade"]["agent_windows"]) for s in parts if s["ade"]["agent_windows"]]
    return sum(mean * n for mean, n in counted) / sum(n for _, n in counted) if counted else float("nan")


def gain(none: float, adapted: float, oracle: float) -> float:
    """(none - adapted) / (none - oracle): 0 without adaptation, 1 as the oracle; NaN if the oracle is no better."""
    return (none - adapted) / (none - oracle) if none > oracle else float("nan")
