"""The keys that a stored run must have, since tables read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
_MISSING = object()
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
    values = [(path, _value_at(content, path)) for path in paths]
    missing = next((path for path, value in values if value is _MISSING), None)
    if missing:
        return f"it has no `{'.'.join(missing)}`"
    if kind == "drive":  # has seconds of forecasts and of plans, and no errors where nothing was forecast
        values = [(p, value) for p, value in values if (p != ["seconds"] and p[0] != "metrics") or p[1:2] == ["score"]]
    wrong = next((path for path, value in values if not _is_of_its_type(path, value)), None)
    if wrong:
        return f"its `{'.'.join(wrong)}` is no {_TYPE_OF[wrong[-1]][0]}"
    for key, of_items in ITEMS.items():
        items = content.get(key, ())
        if not all(isinstance(item, of_items) for item in (items.values() if isinstance(items, dict) else items)):
            return f"an item of its `{key}` is not of type {of_items.__name__}"
    return ""


def _is_of_its_type(path: Sequence[str], value: Any) -> bool:
    if path[-1] not in _TYPE_OF:
        return True
    kind = _TYPE_OF[path[-1]][1]
    if value is None and path[-1] == "mean" and path[-2].upper() in ("ADE", "FDE"):
        return False
    if isinstance(value, int):
        return (
            isinstance(value, kind)
            and not isinstance(value, bool)
            and (0 if kind is int else -LARGEST) <= value < LARGEST
        )
    return isinstance(value, kind)


def _value_at(content: Any, keys: Sequence[str]) -> Any:
    for key in keys:
        if not isinstance(content, dict) or key not in content:
            return _MISSING
        content = content[key]
    return content
