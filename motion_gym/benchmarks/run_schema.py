"""What a stored run must hold: the keys that tables read, with their types."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SCHEMA = 3
"""Raised when the keys change."""
NUMBER, TEXT, WHOLE = (int, float, type(None)), str, int
_summary = {"mean": NUMBER, "low": NUMBER, "high": NUMBER, "agent_windows": WHOLE, "scenes": WHOLE, "agents": WHOLE}
_difference = {"mean": NUMBER, "low": NUMBER, "high": NUMBER, "p_value": NUMBER}
_every: dict[str, Any] = {
    "schema": WHOLE,
    "identity": {"kind": TEXT, "scoring_version": WHOLE},
    "provenance": {"finished": TEXT, "command": list, "versions": dict},
}
KEYS: Mapping[str, Mapping[str, Any]] = {
    "windows": {
        **_every,
        "predictor": TEXT,
        "spec": TEXT,
        "split": TEXT,
        "protocol": TEXT,
        "k": WHOLE,
        "samples": WHOLE,
        "seed": WHOLE,
        "metrics": {"ADE": _summary, "FDE": _summary},
        "versus_baseline": {"ADE": _difference},
        "oracle": bool,
        "leaks": list,
        "scored": TEXT,
        "selection": TEXT,
        "reference_scenes": WHOLE,
        "shots": WHOLE,
        "identity": {**_every["identity"], "predictor": TEXT, "domain": TEXT, "references": NUMBER, "shots": WHOLE},
    },
    "stream": {
        **_every,
        "row": TEXT,
        "of": TEXT,
        "stream": TEXT,
        "ade": _summary,
        "fde": _summary,
        "censored": WHOLE,
        "segments": [{"domain": TEXT, "ade": _summary, "updates": WHOLE}],
        "curve": list,
        "shifts": [{"segment": WHOLE, "before": NUMBER, "after": list}],
        "updates": WHOLE,
        "leaks": list,
        "identity": {**_every["identity"], "row": TEXT, "of": TEXT, "stream": TEXT, "options": dict},
    },
    "study": {**_every, "study": TEXT, "value": dict},
}
"""Types of what tables read from each kind of run; further keys are kept."""


def problem_of(content: Any) -> str:
    """What keeps something from being a run; empty if nothing does."""
    schema = content.get("schema", SCHEMA) if isinstance(content, dict) else SCHEMA
    if schema != SCHEMA:
        return f"of another version of motion-gym: its schema is {schema!r}, and {SCHEMA} is read"
    if not isinstance(content, dict) or not isinstance(content.get("identity"), dict):
        return "it is not a result of motion-gym"
    kind = content["identity"].get("kind")
    return _mismatch(content, KEYS[kind], "") if kind in KEYS else f"its kind is {kind!r}"


def _mismatch(value: Any, wanted: Any, name: str) -> str:
    """The first key at which a value is not of the wanted types; empty if there is none."""
    if isinstance(wanted, Mapping):
        if not isinstance(value, dict):
            return f"`{name}` must hold an object"
        for key, part in wanted.items():
            inner = f"{name}.{key}".lstrip(".")
            problem = f"it has no `{inner}`" if key not in value else _mismatch(value[key], part, inner)
            if problem:
                return problem
        return ""
    if isinstance(wanted, list):
        items = value if isinstance(value, list) else [None]
        return next((problem for item in items if (problem := _mismatch(item, wanted[0], name))), "")
    wrong = not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool)
    return f"`{name}` is {value!r}" if wrong else ""
