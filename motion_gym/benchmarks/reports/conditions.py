"""Notes on the results in a table: unit, time, versions, agents, leaks, and how weights were selected.

A result is a run in JSON types: the value of ``Scorecard.as_dict`` or ``OnlineCard.as_dict``, with its identity.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.reports.table import span
from motion_gym.contract import FUTURE, DataError

Result = Mapping[str, Any]
SHARE = re.compile(r": (\d+) of the (\d+) agent-windows")
LEAST = re.compile(r", at least (\d+) in every window")
"""The counts in ``Scorecard.scored``: scored agent-windows, and those of the recordings; smallest number of agents."""


def unit_of(results: Iterable[Result]) -> str:
    """The unit of length of all results.

    Raises:
        DataError: the results have several units, so that they cannot stand in one table.
    """
    units = {card["unit"] for result in results for card in _cards(result)}
    if len(units) > 1:
        raise DataError(f"A table cannot mix results in {' and '.join(sorted(units))}: make one table for each unit.")
    return units.pop()


def measured(results: Sequence[Result]) -> str:
    """Unit, step, horizon and scoring version.

    Raises:
        DataError: the results have several units or scoring versions, so that their numbers cannot be compared.
    """
    steps = sorted({float(card["dt"]) for result in results for card in _cards(result)})
    times = " and ".join(f"dt {dt:g} s, horizon {FUTURE * dt:g} s" for dt in steps)
    names = {r["identity"]["scoring_version"]: r.get("row") or r["predictor"] for r in reversed(results)}
    if len(names) > 1:
        examples = " and ".join(f"{version} (as {name})" for version, name in sorted(names.items()))
        raise DataError(
            f"A table cannot mix results of the scoring versions {examples}: their numbers mean different things. Make "
            "the results of one version again (`motion-gym run NAME` does it), or keep them in a folder of their own."
        )
    return f"unit {unit_of(results)}, {times}, scoring version {next(iter(names))}"


def intervals(results: Sequence[Result]) -> str:
    """How intervals are computed."""
    summaries = [result["metrics"]["ADE"] if "metrics" in result else result["ade"] for result in results]
    counts = {summary["replicates"] for summary in summaries}
    rule = " (10,000 below 1,000 agents)" if len(counts) > 1 else ""
    draws = {result["reference_draws"] for result in results if result.get("reference_scenes")}
    drawn = f", and of {span(draws)} draws of the reference scenes" if draws and max(draws) > 1 else ""
    return f"95 % intervals: bootstrap of whole agents{drawn}, {span(counts)} replicates{rule}"


def scored(results: Sequence[Result]) -> str:
    """The number of agent-windows, agents and scenes that are scored, and which agents are scored."""
    windows, agents, scenes = (
        span(result["metrics"]["ADE"][name] for result in results) for name in ("agent_windows", "agents", "scenes")
    )
    return f"means over {windows} agent-windows of {agents} agents in {scenes} scenes; {_who(results)}"


def _who(results: Sequence[Result]) -> str:
    """Which agents are scored; the shares of the recordings' agent-windows in place of counts that differ."""
    texts = list(dict.fromkeys(result["scored"] for result in results))
    if len(texts) == 1:
        return texts[0]
    kinds = dict.fromkeys(re.split("[,:]", text)[0] for text in texts)
    fewest = {int(found[1]) if (found := LEAST.search(text)) else 1 for text in texts}
    counts = [SHARE.search(text) for text in texts]
    shares = [100 * int(count[1]) / int(count[2]) for count in counts if count]
    least, most = f"{min(shares, default=0):.0f}", f"{max(shares, default=0):.0f}"
    span_of = "all" if least == "100" else f"{least} %" if least == most else f"{least} to {most} %"
    windows = f", at least {span(fewest)} in every window" if fewest != {1} else ""
    return " or ".join(kinds) + windows + (f": {span_of} of the agent-windows of the recordings" if shares else "")


def not_computed(results: Sequence[Result]) -> list[str]:
    """The number of agent-windows that KDE_NLL leaves out, since their density cannot be estimated."""
    missing: dict[str, list[int]] = {}
    for result in results:
        total = result["metrics"]["ADE"]["agent_windows"]
        for name, summary in result["metrics"].items():
            if name.startswith("KDE_NLL") and 0 < summary["agent_windows"] < total:
                missing.setdefault(f"{name} (k = {result['k']})", []).append(total - summary["agent_windows"])
    return [f"{name} could not be computed for {span(counts)} agent-windows" for name, counts in missing.items()]


def leaks(results: Iterable[Result]) -> list[str]:
    """The declared leaks of all results, each once."""
    return list(dict.fromkeys(leak for result in results for leak in result["leaks"]))


def selections(results: Iterable[Result]) -> list[str]:
    """How the weights of each row were selected.

    Rows that differ only in their epochs share a sentence. A row that some columns tune further is named with that.
    """
    whole: dict[str, dict[str, None]] = {}
    for result in results:
        whole.setdefault(row_name(result["predictor"]), {})[result["selection"]] = None
    rows: dict[str, dict[str, dict[str, None]]] = {}
    for name, texts in whole.items():
        for each in texts:
            if any(other != each and other.startswith(each) for other in texts):  # a column without scenes to tune on
                continue
            text, _, epochs = each.partition("; trained for ")
            rows.setdefault(text, {}).setdefault(epochs, {})[name] = None
    return [f"selection, {_names(groups)}: {text}" for text, groups in rows.items()]


def _names(groups: Mapping[str, Iterable[str]]) -> str:
    """Names of rows, each group with its epochs, as ``a, b (100 epochs), c (30 epochs)``."""
    return ", ".join(", ".join(names) + (f" ({epochs})" if epochs else "") for epochs, names in groups.items())


def in_order(results: Sequence[Result]) -> list[Result]:
    """Results in the order of rows: constant velocity, training-free, fitted, trained, oracle. The sort is stable."""

    def rank(result: Result) -> int:
        if result["oracle"]:
            return 4
        name, parameters = catalog.parse_spec(result["predictor"])
        if "weights" in parameters or result["identity"].get("weights"):
            return 3
        if result["selection"].startswith("fitted"):
            return 2
        return 0 if (name, parameters) == ("constant_velocity", {}) else 1

    return sorted(results, key=rank)


def _cards(result: Result) -> list[Mapping[str, Any]]:
    """Cards of the domains of a run on windows, or on a stream."""
    return [result["domain"]] if "domain" in result else list(result["domains"].values())
