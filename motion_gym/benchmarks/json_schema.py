"""JSON Schema of stored runs, generated from the scorecards, so that other programs can write and check results."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any, Union

import numpy as np

from motion_gym.benchmarks.run_schema import KEYS, SCHEMA
from motion_gym.contract import Truth
from motion_gym.online.scores import OnlineCard
from motion_gym.scoring.scorecard import Scorecard

CARDS: Mapping[str, type] = {"windows": Scorecard, "stream": OnlineCard}
"""What the runs of a kind consist of, beside identity and provenance."""
_PLAIN = {str: "string", bool: "boolean", int: "integer"}


def json_schema() -> dict[str, Any]:
    """The schema of one run: of windows, of a stream, of driven episodes, or a study."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"A run of motion-gym, schema {SCHEMA}",
        "type": "object",
        "required": ["schema", "identity", "provenance"],
        "properties": {"schema": {"const": SCHEMA}, "identity": {"type": "object", "required": ["kind"]}},
        "oneOf": [_of_kind(kind) for kind in KEYS],
    }


def _of_kind(kind: str) -> dict[str, Any]:
    """Nested keys that tables read, and all fields of the scorecard."""
    schema: dict[str, Any] = {"properties": {}, "required": []}
    for path in KEYS[kind].split():
        _require(schema, path.split("."))
    schema["properties"]["identity"]["properties"]["kind"] = {"const": kind}
    if kind in CARDS:
        _merge(schema, _of_type(CARDS[kind]))
    if kind == "windows":
        schema["properties"]["versus_baseline"]["properties"]["baseline"] = {"type": "string"}
    return schema


def _require(schema: dict[str, Any], keys: list[str]) -> None:
    first, *others = keys
    if first not in schema["required"]:
        schema["required"].append(first)
    inner = schema["properties"].setdefault(first, {})
    if others:
        inner |= {"type": "object"}
        inner.setdefault("properties", {})
        inner.setdefault("required", [])
        _require(inner, others)


def _merge(into: dict[str, Any], schema: Mapping[str, Any]) -> None:
    """Add a schema to another one. What holds for all values of a mapping holds for its named values too."""
    for name, value in schema.get("properties", {}).items():
        _merge(into.setdefault("properties", {}).setdefault(name, {}), value)
    if isinstance(value := schema.get("additionalProperties"), dict):
        for named in into.get("properties", {}).values():
            _merge(named, value)
    into |= {key: value for key, value in schema.items() if key != "properties"}


def _of_type(kind: Any) -> dict[str, Any]:
    """Schema of the JSON form of a type; floats may be null, where they are not defined."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        left_out = [name for name, hint in hints.items() if hint is Truth or _is_array(hint)]
        fields = [field.name for field in dataclasses.fields(kind) if field.name not in left_out]
        return {"type": "object", "properties": {name: _of_type(hints[name]) for name in fields}}
    if kind in _PLAIN:
        return {"type": _PLAIN[kind]}
    if kind is float:
        return {"type": ["number", "null"]}
    if origin in (Union, types.UnionType):
        return {"anyOf": [_of_type(part) if part is not type(None) else {"type": "null"} for part in arguments]}
    if origin is tuple and arguments and arguments[-1] is not Ellipsis:
        return {"type": "array", "prefixItems": [_of_type(part) for part in arguments]}
    if origin in (list, tuple):
        return {"type": "array", "items": _of_type(arguments[0])} if arguments else {"type": "array"}
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _of_type(arguments[1])}
    return {}


def _is_array(kind: Any) -> bool:
    """Whether a field holds values per agent, which are not stored."""
    return kind is np.ndarray or any(_is_array(part) for part in typing.get_args(kind))
