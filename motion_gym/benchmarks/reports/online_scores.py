"""Scores of several runs on one stream: gain, recovery, and growth of the error on return."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_gym.benchmarks.reports.conditions import Result
from motion_gym.benchmarks.reports.table import number
from motion_gym.online.scores import BLOCK, PHASE, TRAIL, after_first, gain, recovery, returns_of

LEAST = 0.01
"""Share by which the error of an oracle must be lower for a gain to be given."""


def gain_of(results: Sequence[Result], none: Sequence[Result], oracle: Sequence[Result] | None) -> float | None:
    """Adaptation gain over the segments after the first one, of means over seeds; None without a better oracle.

    An oracle whose error is less than 1 % lower than that of ``none`` counts as no better.
    """
    if oracle is None:
        return None
    unadapted, adapted, best = (float(np.mean([after_first(r) for r in rows])) for rows in (none, results, oracle))
    share = gain(unadapted, adapted, best)
    return share if best < (1 - LEAST) * unadapted else None


def first_shift(result: Result) -> dict[str, Any] | None:
    """The first change of domain, if at least 50 forecasts matured right before it and right after it."""
    segments = result["segments"]
    first = next((n for n, s in enumerate(segments) if s["domain"] != segments[0]["domain"]), None)
    shift = next((s for s in result["shifts"] if s["segment"] == first), None)
    return None if shift is None or segments[shift["segment"] - 1]["ade"]["agent_windows"] < TRAIL else shift


def recovered(results: Sequence[Result], oracle: Sequence[Result] | None) -> str:
    """When the runs recovered from the first change of domain, as text for a cell.

    The median counts a censored run as infinitely late. The text is ``-`` without an oracle, and without a change of
    domain.
    """
    shifts = [first_shift(result) for result in results]
    levels = [first_shift(result) for result in oracle or ()]
    pairs = [(mine, theirs) for mine, theirs in zip(shifts, levels, strict=False) if mine and theirs]
    if not pairs or len(pairs) < len(results):
        return "-"
    if any(len(mine["blocks"]) * BLOCK < PHASE for mine, _ in pairs):
        return f"censored (phase below {PHASE})"
    recoveries = [recovery(mine, theirs) for mine, theirs in pairs]
    count = f"{sum(r is not None for r in recoveries)} of {len(recoveries)}"
    forecasts, seconds = np.median([r or (np.inf, np.inf) for r in recoveries], axis=0)
    return f"{forecasts:.0f} ({seconds:.0f} s; {count})" if np.isfinite(forecasts) else f"censored ({count})"


def growth_on_return(results: Sequence[Result], none: Sequence[Result]) -> list[float]:
    """Growth of the error of the first domain until its return, relative to the growth of ``none``.

    Returns:
        One value for each seed and return; 0.1 where the error has grown by 10 % more than that of ``none``.
    """

    def growth(result: Result) -> list[float]:
        visits = [(s["domain"], s["ade"]["mean"], s["ade"]["agent_windows"]) for s in result["segments"]]
        own = result["segments"][0]["domain"]
        return [later / first for domain, first, later in returns_of(visits) if domain == own and first]

    pairs = on_the_same_stream(results, none)
    return [mine / theirs - 1 for r, n in pairs for mine, theirs in zip(growth(r), growth(n), strict=False) if theirs]


def on_the_same_stream(results: Sequence[Result], none: Sequence[Result]) -> list[tuple[Result, Result]]:
    """Each result with that of ``none`` on the same stream; a result of a user may lack some seeds."""
    by_stream = {result["stream"]: result for result in none}
    return [(result, by_stream[result["stream"]]) for result in results if result["stream"] in by_stream]


def on_domain(result: Result, domain: str) -> str:
    """ADE over all segments of a domain, as text for a cell."""
    own = [s["ade"] for s in result["segments"] if s["domain"] == domain and s["ade"]["agent_windows"]]
    total = sum(ade["agent_windows"] for ade in own)
    return number(sum(ade["mean"] * ade["agent_windows"] for ade in own) / total if total else None)
