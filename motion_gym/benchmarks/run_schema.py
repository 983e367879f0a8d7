"""The keys that a stored run must have, since tables read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SCHEMA = 3
"""Raised when the keys change."""
_EVERY = "identity.scoring_version provenance.finished provenance.command provenance.versions"
SUMMARY = ("mean", "low", "high", "replicates", "agent_windows", "scenes", "agents")
"""Keys of the summary of a metric."""
_SUMMARIES = " ".join(f"{{0}}.{key}" for key in SUMMARY)
KEYS: Mapping[str, str] = {
    "windows": f"{_EVERY} identity.predictor identity.domain identity.references identity.shots identity.protocol "
    f"identity.k identity.seed predictor spec split "
    f"protocol k samples seed oracle leaks scored selection reference_scenes reference_draws shots domain.unit "
    f"domain.dt versus_baseline.ADE.mean versus_baseline.ADE.low versus_baseline.ADE.high seconds "
    f"{_SUMMARIES.format('metrics.ADE')} {_SUMMARIES.format('metrics.FDE')}",
    "stream": f"{_EVERY} identity.row identity.of identity.stream identity.options row of stream domains segments "
    f"curve shifts censored updates skipped rolled_back realtime labels scope update_seconds tick_seconds leaks "
    f"{_SUMMARIES.format('ade')} {_SUMMARIES.format('fde')}",
    "study": f"{_EVERY} study value",
    "drive": f"{_EVERY} identity.predictor identity.domain predictor spec others seed metrics.score.mean "
    "metrics.score.low metrics.score.high values.score errors seconds oracle selection leaks domain.unit domain.dt",
}
"""Keys of each kind of run, nested keys joined by dots; a run may have more."""

TYPES: Mapping[str, tuple[Any, str]] = {
    "number": ((int, float), "dt seconds"),
    "number, or null": ((int, float, type(None)), "mean low high references"),
    "whole number of 0 or more": (
        int,
        "replicates agent_windows scenes agents k samples seed reference_scenes reference_draws shots censored updates "
        "skipped rolled_back scoring_version episodes",
    ),
    "text": (
        str,
        "finished predictor domain spec split protocol scored selection row of stream labels scope study unit",
    ),
    "list": (list, "leaks command segments curve shifts"),
    "object": (dict, "versions options"),
}
"""Types of values by the last part of their keys, and the names of these types."""
ITEMS: Mapping[str, type] = {"leaks": str, "segments": dict, "versus": dict}
"""Types of the items of lists and objects."""
LARGEST = 2**63
"""Whole numbers beyond this, which no run has, do not fit into an array."""
_TYPE_OF = {key: (name, kind) for name, (kind, keys) in TYPES.items() for key in keys.split()}


def problem_of(content: Any) -> str:
    """The reason why a value is not a run; empty if it is one."""
    schema = content.get("schema", SCHEMA) if isinstance(content, dict) else SCHEMA
    if schema != SCHEMA:
        return f"of another version of motion-gym: its schema is {schema!r}, and {SCHEMA} is read"
    if not isinstance(content, dict) or not isinstance(content.get("identity"), dict):
        return "it is not a result of motion-gym"
    kind = content["identity"].get("kind")
    if kind not in KEYS:
        return f"its kind is {kind!r}"
    paths = [path.split(".") for path in KEYS[kind].split()]
    if kind in ("windows", "drive") and isinstance(content.get("metrics"), dict):
        of_one = SUMMARY if kind == "windows" else ("mean", "low", "high", "episodes")
        paths += [["metrics", name, key] for name in content["metrics"] for key in of_one]
    missing = next((path for path in paths if not _has(content, path)), None)
    if missing:
        return f"it has no `{'.'.join(missing)}`"
    if kind == "drive":  # has seconds of forecasts and of plans, and no errors where nothing was forecast
        paths = [path for path in paths if (path != ["seconds"] and path[0] != "metrics") or path[1:2] == ["score"]]
    wrong = next((path for path in paths if not _is_of_its_type(content, path)), None)
    if wrong:
        return f"its `{'.'.join(wrong)}` is no {_TYPE_OF[wrong[-1]][0]}"
    for key, of_items in ITEMS.items():
        items = content.get(key, ())
        if not all(isinstance(item, of_items) for item in (items.values() if isinstance(items, dict) else items)):
            return f"an item of its `{key}` is not of type {of_items.__name__}"
    return ""


def _is_of_its_type(content: Any, keys: list[str]) -> bool:
    if keys[-1] not in _TYPE_OF:
        return True
    for key in keys[:-1]:
        content = content[key]
    value, (_, kind) = content[keys[-1]], _TYPE_OF[keys[-1]]
    if value is None and keys[-1] == "mean" and keys[-2].upper() in ("ADE", "FDE"):
        return False
    if isinstance(value, int):
        return (
            isinstance(value, kind)
            and not isinstance(value, bool)
            and (0 if kind is int else -LARGEST) <= value < LARGEST
        )
    return isinstance(value, kind)


def _has(content: Any, keys: list[str]) -> bool:
    for key in keys:
        if not isinstance(content, dict) or key not in content:
            return False
        content = content[key]
    return True
