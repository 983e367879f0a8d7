"""Specs of the rows and columns of benchmarks: with weights and seeds, and the domains they name."""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Sequence
from typing import Any

from motion_gym import catalog
from motion_gym.online.streams import stream_name


@functools.lru_cache(maxsize=64)
def domain(spec: Any) -> Any:
    """A domain by its spec, made once, so that its windows are kept; a domain is returned as it is."""
    return catalog.domain(spec)


@functools.cache
def name_of_stream(arguments: str) -> str:
    """Name of a stream by the arguments of ``stream`` as JSON."""
    return stream_name(**json.loads(arguments))


def with_parameters(spec: str, **more: Any) -> str:
    """A spec with further parameters, such as its weights and seed."""
    name, parameters = catalog.parse_spec(spec)
    return catalog.format_spec(name, {**parameters, **more})


def of_seed(spec: str, seed: int) -> str:
    """A spec with the seed of its weights, if it names weights."""
    return with_parameters(spec, seed=seed) if "weights" in catalog.parse_spec(spec)[1] else spec


def takes_weights(spec: str) -> bool:
    """Whether a predictor has weights."""
    return "weights" in inspect.signature(type(catalog.predictor(spec))).parameters


def weighted(rows: Sequence[str], weights: str) -> tuple[str, ...]:
    """Specs of rows with weights."""
    return tuple(with_parameters(row, weights=weights) for row in rows)
