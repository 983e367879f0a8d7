"""Snapshots of the state of objects and of the global random generators, to detect changes."""

from __future__ import annotations

import contextlib
import random
import sys
import types
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

LONGEST_KEY = 60
"""Characters of the key of a mapping in a path."""
_NO_STATE = (type, types.ModuleType, types.FunctionType, types.BuiltinFunctionType, types.MethodType)
_PLAIN = (type(None), bool, int, float, complex, str, bytes, np.generic)


def leaves(value: Any, path: str = "", seen: set[int] | None = None) -> Iterator[tuple[str, Any]]:
    """Walk through attributes, mappings and sequences to their leaves.

    Args:
        value: The object.
        path: Path of the object.
        seen: Ids of visited objects, which are left out.

    Yields:
        Path in Python syntax, and an array, a plain value or the state of a random generator. Tensors become arrays.
        Functions, modules, classes and hidden attributes are left out.
    """
    seen = set() if seen is None else seen
    if isinstance(value, (*_PLAIN, np.ndarray)):
        yield path, value
        return
    if isinstance(value, _NO_STATE) or id(value) in seen:
        return
    seen.add(id(value))
    if callable(getattr(value, "detach", None)) and callable(getattr(value, "cpu", None)):
        yield path, value.detach().cpu().numpy()
    elif isinstance(value, np.random.Generator):
        yield path, repr(value.bit_generator.state)
    elif isinstance(value, (np.random.RandomState, random.Random)):
        state = value.get_state() if isinstance(value, np.random.RandomState) else value.getstate()
        yield path, repr([part.tobytes() if isinstance(part, np.ndarray) else part for part in state])
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from leaves(item, f"{path}[{_short(key)}]", seen)
    elif isinstance(value, (set, frozenset)):
        for item in value:
            yield f"{path}{{{_short(item)}}}", True
    elif isinstance(value, (list, tuple)) or type(value).__name__ == "deque":
        for index, item in enumerate(value):
            yield from leaves(item, f"{path}[{index}]", seen)
    else:
        slots = [name for kind in type(value).__mro__ for name in _slots(kind) if hasattr(value, name)]
        for name in (*getattr(value, "__dict__", ()), *slots):
            yield from leaves(getattr(value, name), f"{path}.{name}" if path else name, seen)


def _short(key: Any) -> str:
    """The key in Python syntax; the end of a long one is replaced by a checksum, for messages."""
    text = repr(key)
    return text if len(text) <= LONGEST_KEY else f"{text[: LONGEST_KEY - 12]}...{zlib.crc32(text.encode()):08x}"


def snapshot(thing: Any) -> dict[str, Any]:
    """Content of an object by path, in a comparable form that is independent of the object."""
    return {path: _content(leaf) for path, leaf in leaves(thing)}


def changed(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Paths whose content differs between two snapshots or is missing in the second one.

    New paths, and paths that were None before, count as caches and are left out.
    """
    nothing = _content(None)
    return [path for path, content in before.items() if content != nothing and after.get(path) != content]


def shared_arrays(a: Any, b: Any) -> list[str]:
    """Paths at which two objects share writable memory."""
    others = {path: leaf for path, leaf in leaves(b) if isinstance(leaf, np.ndarray)}
    return [
        path
        for path, leaf in leaves(a)
        if isinstance(leaf, np.ndarray) and leaf.flags.writeable and np.may_share_memory(leaf, others.get(path, ()))
    ]


@contextlib.contextmanager
def global_randomness(seed: int = 0) -> Iterator[list[str]]:
    """Seed the global generators of random, numpy and, if imported, torch; restore them afterwards.

    Yields:
        A list that names, after the block, the generators that the block used or seeded.
    """
    torch: Any = sys.modules.get("torch")
    kept = random.getstate(), np.random.get_state(), torch.get_rng_state() if torch else None  # noqa: NPY002
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    if torch:
        torch.default_generator.manual_seed(seed)
    begun = _global_states(torch)
    used: list[str] = []
    try:
        yield used
    finally:
        ended = _global_states(torch)
        used += [name for name in begun if begun[name] != ended[name]]
        random.setstate(kept[0])
        np.random.set_state(kept[1])  # noqa: NPY002
        if torch:
            torch.set_rng_state(kept[2])


def _global_states(torch: Any) -> dict[str, Any]:
    states: dict[str, Any] = {"random": random.getstate()}
    legacy: Any = np.random.get_state(legacy=False)  # noqa: NPY002
    states["numpy.random"] = (legacy["state"]["key"].tobytes(), legacy["state"]["pos"], legacy["has_gauss"])
    if torch:
        states["torch"] = torch.get_rng_state().numpy().tobytes()
    return states


def _slots(kind: type) -> tuple[str, ...]:
    slots = kind.__dict__.get("__slots__", ())
    return tuple(n for n in ((slots,) if isinstance(slots, str) else slots) if not n.startswith("__"))


def _content(leaf: Any) -> Any:
    if isinstance(leaf, np.ndarray):
        return leaf.dtype.str, leaf.shape, repr(leaf.tolist()) if leaf.dtype.hasobject else leaf.tobytes()
    return repr(leaf)
