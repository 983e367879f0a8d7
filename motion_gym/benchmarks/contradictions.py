"""Numbers of a stored run that no computation gives, since they contradict each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from motion_gym.benchmarks.identity import OPTIONS
from motion_gym.contract import FUTURE
from motion_gym.metrics.bootstrap import FEWER_REPLICATES, REPLICATES

TOLERANCE = 1e-3
"""Largest difference of a score, in the unit of the domain, that is computed twice: processors add up differently."""
STATED_TWICE = {
    "unit": "domain",
    "dt": "domain",
    "predictor": "identity",
    **{option: "identity" for option in OPTIONS if option not in ("references", "shots")},
}
"""Keys of a run of windows, and the object in it that has the same key with the same value."""


def contradiction_in(run: Mapping[str, Any]) -> str:
    """The first contradiction between numbers of a run; empty if there is none."""
    summaries = dict(run.get("metrics", {})) or {key: run[key] for key in ("ade", "fde") if key in run}
    found = [_of_summary(name, summary) for name, summary in summaries.items()]
    if run["identity"]["kind"] == "windows":
        found += _of_windows(run)
    return next(filter(None, found), "")


def _of_summary(name: str, value: Mapping[str, Any]) -> str:
    mean, low, high = (value.get(key) for key in ("mean", "low", "high"))
    if mean is not None and low is not None and high is not None and not low - 1e-9 <= mean <= high + 1e-9:
        return f"{name} {mean:.4g} lies outside its interval [{low:.4g}, {high:.4g}]"
    if mean is not None and mean < 0 and name.lower() in ("ade", "fde"):
        return f"{name} {mean:.4g} is negative, and an error is a distance"
    if value.get("agent_windows", 1) < value.get("agents", 0):
        return f"{name} has {value['agents']} agents in {value['agent_windows']} agent-windows"
    return ""


def _of_windows(run: Mapping[str, Any]) -> Iterator[str]:
    for key, place in STATED_TWICE.items():
        if run.get(key) != run[place].get(key):
            yield f"its {key} is {run.get(key)!r}, and {run[place].get(key)!r} in `{place}.{key}`"
    if abs(run["horizon_seconds"] - FUTURE * run["dt"]) > TOLERANCE:
        yield f"its horizon is {run['horizon_seconds']} s, not {FUTURE} steps of {run['dt']} s"
    if run["seconds"] < 0:
        yield f"it took {run['seconds']} s"
    counts = run["domain"]["counts"].get(run["split"], {})
    for name, summary in run["metrics"].items():
        for key in ("agent_windows", "scenes", "agents"):
            if summary[key] > counts.get(key, summary[key]):
                yield f"{name} counts {summary[key]} {key}, and its domain has {counts[key]}"
        if summary["replicates"] not in (0, FEWER_REPLICATES, REPLICATES):
            yield f"{name} has {summary['replicates']} replicates; {FEWER_REPLICATES} or {REPLICATES} are drawn"
    yield from _of_differences(run)
    yield from _of_horizon(run)


def _of_differences(run: Mapping[str, Any]) -> Iterator[str]:
    for name in ("ADE", "FDE"):
        difference = run["versus_baseline"].get(name, {})
        if difference.get("low") is None:
            continue
        if not difference["low"] - 1e-9 <= difference["mean"] <= difference["high"] + 1e-9:
            yield f"the difference of {name} {difference['mean']:.4g} lies outside its interval"
        if not 0 <= difference["p_value"] <= 1:
            yield f"the p-value of {name} is {difference['p_value']}"


def _of_horizon(run: Mapping[str, Any]) -> Iterator[str]:
    """Its mean is ADE and its last value FDE, where errors are not means over several draws of reference scenes."""
    if not run["horizon"] or None in run["horizon"] or run["reference_draws"] != 1:
        return
    for name, value in (("ADE", float(np.mean(run["horizon"]))), ("FDE", run["horizon"][-1])):
        stored = run["metrics"][name]["mean"]
        if stored is not None and abs(value - stored) > TOLERANCE:
            yield f"{name} is {value:.4f} by its errors by horizon, and stored as {stored:.4f}"
