"""What must be said of the results in a table: unit, time, versions, agents, leaks, and how weights were selected.

A result is a run in JSON types, as ``Scorecard.as_dict`` and ``OnlineCard.as_dict`` give it, with its identity.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.reports.table import span
from motion_gym.contract import FUTURE, DataError

Result = Mapping[str, Any]
UNIT, DT, REPLICATES = "m", 0.4, 1000
"""What cards that do not say otherwise were made with."""


def unit_of(results: Iterable[Result]) -> str:
    """The unit of length of all results.

    Raises:
        DataError: the results have several units, so that they cannot stand in one table.
    """
    units = {card.get("unit", UNIT) for result in results for card in _cards(result)} or {UNIT}
    if len(units) > 1:
        raise DataError(f"A table cannot mix results in {' and '.join(sorted(units))}: make one table for each unit.")
    return units.pop()


def steps_of(results: Iterable[Result]) -> str:
    """Step and horizon in seconds."""
    steps = sorted({float(card.get("dt", DT)) for result in results for card in _cards(result)} or {DT})
    return " and ".join(f"dt {dt:g} s, horizon {FUTURE * dt:g} s" for dt in steps)


def version_of(results: Iterable[Result]) -> int:
    """The scoring version of all results.

    Raises:
        DataError: the results are of several versions, so that their numbers cannot be compared.
    """
    names: dict[int, str] = {}
    for result in results:
        version = result.get("identity", {}).get("scoring_version", 1)
        names.setdefault(version, str(result.get("row", result["predictor"])))
    if len(names) > 1:
        examples = " and ".join(f"{version} (as {name})" for version, name in sorted(names.items()))
        raise DataError(
            f"A table cannot mix results of the scoring versions {examples}: their numbers mean different things. Make "
            "the results of one version again (`motion-gym run NAME` does it), or keep them in a folder of their own."
        )
    return next(iter(names), 1)


def measured(results: Sequence[Result]) -> str:
    """Unit, step, horizon and scoring version; refuses to mix units or versions."""
    return f"unit {unit_of(results)}, {steps_of(results)}, scoring version {version_of(results)}"


def intervals(results: Sequence[Result]) -> str:
    """How intervals were made."""
    summaries = [result["metrics"]["ADE"] if "metrics" in result else result["ade"] for result in results]
    counts = sorted({summary.get("replicates") or REPLICATES for summary in summaries})
    rule = " (10,000 below 1,000 agents)" if len(counts) > 1 else ""
    draws = {result.get("reference_draws", 1) for result in results if result.get("reference_scenes")}
    drawn = f", and of {span(draws)} draws of the reference scenes" if draws and max(draws) > 1 else ""
    return f"95 % intervals: bootstrap of whole agents{drawn}, {span(counts)} replicates{rule}"


def scored(results: Sequence[Result]) -> str:
    """How many agent-windows, agents and scenes stand behind the scores, and which agents these are."""
    windows, agents, scenes = (
        span(result["metrics"]["ADE"][name] for result in results) for name in ("agent_windows", "agents", "scenes")
    )
    return f"means over {windows} agent-windows of {agents} agents in {scenes} scenes; {results[0]['scored']}"


def not_computed(results: Sequence[Result]) -> list[str]:
    """How many agent-windows a metric leaves out, as KDE_NLL does where it has no density."""
    missing: dict[str, list[int]] = {}
    for result in results:
        total = result["metrics"]["ADE"]["agent_windows"]
        for name, summary in result["metrics"].items():
            if name.startswith("KDE_NLL") and 0 < summary["agent_windows"] < total:
                missing.setdefault(f"{name} (k = {result['k']})", []).append(total - summary["agent_windows"])
    return [f"{name} could not be computed for {span(counts)} agent-windows" for name, counts in missing.items()]


def leaks(results: Iterable[Result]) -> list[str]:
    """What reads the future on purpose, each once."""
    return list(dict.fromkeys(leak for result in results for leak in result["leaks"]))


def selections(results: Iterable[Result]) -> list[str]:
    """How the weights of the rows were selected."""
    rows: dict[str, dict[str, None]] = {}
    for result in results:
        rows.setdefault(result["selection"], {})[row_name(result["predictor"])] = None
    return [f"selection, {', '.join(names)}: {text}" for text, names in rows.items()]


def in_order(results: Sequence[Result]) -> list[Result]:
    """Results in the order of rows: constant velocity, training-free, fitted, trained, oracle; else as they are."""

    def rank(result: Result) -> int:
        if result["oracle"]:
            return 4
        name, parameters = catalog.parse_spec(result["predictor"])
        if "weights" in parameters or result.get("identity", {}).get("weights"):
            return 3
        if result["selection"].startswith("fitted"):
            return 2
        return 0 if (name, parameters) == ("constant_velocity", {}) else 1

    return sorted(results, key=rank)


def _cards(result: Result) -> list[Mapping[str, Any]]:
    """Cards of the domains of a run on windows, or on a stream."""
    return [result["domain"]] if "domain" in result else list(result.get("domains", {}).values())
