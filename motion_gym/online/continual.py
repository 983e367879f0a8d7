"""Scores of continual learning: regret against experts, backward and forward transfer between domains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from motion_gym.online.scores import TRAIL


def regret(result: Mapping[str, Any]) -> float | None:
    """Regret against the best fixed expert in hindsight: ADE over the lowest ADE of an expert, minus 1.

    Returns:
        0.02 if the ADE is 2 % above that of the best expert on the same forecasts; None if there are no experts.
    """
    experts = result.get("experts") or {}
    best = min(experts.values(), default=0.0)
    return float(result["ade"]["mean"] / best - 1) if best else None


def backward_transfer(result: Mapping[str, Any], none: Mapping[str, Any]) -> float | None:
    """Backward transfer (BWT): change of the relative error of a domain between two visits; negative if forgotten.

    After Lopez-Paz and Ranzato, "Gradient episodic memory for continual learning", NIPS 2017, section 2, where R[i, j]
    is the accuracy in task j after learning task i, and BWT is the mean of R[T, i] - R[i, i]. A stream has no test set
    to score a domain at any time. Therefore R is minus the error relative to that of the source model on the same
    forecasts: on the last 50 of the previous visit (after learning the domain) and on the first 50 of the return (after
    learning other domains). BWT = mean over returns of (error / error of none) at the end of the previous visit minus
    (error / error of none) at the beginning of the return.

    Args:
        result: A result, as ``as_dict`` gives it.
        none: The result of the source model on the same stream.

    Returns:
        A share of the error of the source model; None if no domain returns with 50 matured forecasts in each visit.
    """
    first, last, reference_first, reference_last = *_edges(result), *_edges(none)
    changes, visited = [], dict[str, int]()
    for number, segment in enumerate(result["segments"]):
        before = visited.get(segment["domain"], number)
        returned = before < number - 1 and number in first
        if returned and reference_first.get(number) and reference_last[before]:
            changes.append(last[before] / reference_last[before] - first[number] / reference_first[number])
        if number in last and number in reference_last:
            visited[segment["domain"]] = number
    return float(np.mean(changes)) if changes else None


def forward_transfer(result: Mapping[str, Any], none: Mapping[str, Any]) -> float | None:
    """Forward transfer (FWT): by how much the error in a domain is lower at its beginning, due to earlier domains.

    After Lopez-Paz and Ranzato, see ``backward_transfer``: FWT is the mean over tasks i > 1 of R[i - 1, i] - b[i],
    where b[i] is the accuracy before any learning. Here b[i] is the source model. FWT = mean over the first visits of
    all domains but the first one of 1 - (error / error of none) on the first 50 matured forecasts. Ground truth of the
    domain itself arrives while the later ones of them are made.

    Args:
        result: A result, as ``as_dict`` gives it.
        none: The result of the source model on the same stream.

    Returns:
        A share of the error of the source model, negative if earlier domains did harm; None without a second domain.
    """
    first, reference = _edges(result)[0], _edges(none)[0]
    domains = [segment["domain"] for segment in result["segments"]]
    visits = [n for n in first if domains.index(domains[n]) == n and reference.get(n)]
    return float(np.mean([1 - first[n] / reference[n] for n in visits])) if visits else None


def _edges(result: Mapping[str, Any]) -> tuple[dict[int, float], dict[int, float]]:
    """Mean of the first and of the last 50 matured forecasts of segments that have as many, by segment number.

    The first 50 are known after a change of domain. The last 50 are read from the curve, whose points are at most 1 in
    200 of the forecasts before the end of the segment.
    """
    first = {int(shift["segment"]): float(shift["after"][0][2]) for shift in result["shifts"]}
    last = {}
    for number, segment in enumerate(result["segments"]):
        trail = [ade for seconds, ade in result["curve"] if segment["start"] <= seconds < segment["stop"]]
        if trail and segment["ade"]["agent_windows"] >= TRAIL:
            last[number] = float(trail[-1])
    return first, last
