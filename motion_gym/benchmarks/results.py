"""Results as files: one JSON per run, written whole, found again, never run twice."""

from __future__ import annotations

import datetime
import functools
import hashlib
import inspect
import json
import os
import platform
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import DataError, Domain, Predictor, Truth
from motion_gym.data.domains import spec_of
from motion_gym.data.storage import write_atomic
from motion_gym.scoring.evaluation import default_k, evaluate
from motion_gym.stepping.harness import windows_of_domain
from motion_gym.training.provenance import commit, versions

SCHEMA = 2
IDENTIFIED = ("predictor", "domain", "split", "protocol", "k", "seed", "references", "shots")
"""Names of what ``key_of`` gives."""


def run(
    predictor: str,
    domain: Domain,
    folder: Path | None = None,
    *,
    split: str = "test",
    k: int | None = None,
    protocol: str = "honest",
    seed: int = 0,
    references: int | None = None,
    shots: int = 0,
) -> dict[str, Any]:
    """Evaluate, or read the result of the same run from ``folder`` if it is there.

    A run is the same if predictor, domain, parameters, options, data and source code are: that of motion-gym, and that
    of the modules of predictor and domain.

    Returns:
        The result as in the file: a scorecard (``Scorecard.as_dict``) and where it comes from.
    """
    k = default_k(protocol) if k is None else k
    made = catalog.predictor(predictor)
    identity = _identity(made, predictor, domain, split, k, protocol, seed, references, shots)
    options: dict[str, Any] = {"split": split, "protocol": protocol, "seed": seed, "references": references}

    def score(_: Path | None) -> dict[str, Any]:
        return evaluate(predictor, domain, k=k, shots=shots, **options).as_dict()

    return found_or_made(folder, f"{predictor}--{spec_of(domain)}", identity, SCHEMA, score)


def found_or_made(
    folder: Path | None,
    title: str,
    identity: Mapping[str, Any],
    schema: int | str,
    make: Callable[[Path | None], dict[str, Any]],
) -> dict[str, Any]:
    """The result of a run from its file, or made and written now.

    Args:
        folder: Where results are; None to make it and write nothing.
        title: Begins the name of the file.
        identity: All that the result depends on.
        schema: Version of what is in the file.
        make: Given the path of the file, makes the result in JSON types.

    Raises:
        DataError: the file is the result of another run, or damaged.
    """
    canonical = json.dumps(identity, sort_keys=True, default=str)
    identity = json.loads(canonical)
    digest = hashlib.sha256(canonical.encode()).hexdigest()[:12]
    slug = re.sub(r"[^A-Za-z0-9.=-]+", "_", title).strip("_")[:120]
    path = None if folder is None else folder / f"{slug}--{digest}.json"
    if path is not None and path.exists():
        found = read(path, schema)
        if found["identity"] != identity:
            raise DataError(f"{path} is the result of another run. Delete or move it, and run the command again.")
        return found
    result = {
        "schema": schema,
        **make(path),
        "identity": identity,
        "versions": versions(),
        "commit": commit(),
        "machine": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "finished": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="milliseconds"),
        "command": sys.argv[1:],
    }
    if path is not None:
        write_atomic(path, (json.dumps(result, indent=1, allow_nan=False) + "\n").encode())
    return result


def read(path: Path, schema: int | str = SCHEMA) -> dict[str, Any]:
    """One result.

    Raises:
        DataError: the file is not a result of this version of motion-gym.
    """
    try:
        result = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{path} is not a result: {error}. Delete it, and run the command again.") from None
    kind = result.get("schema") if isinstance(result, dict) else None
    if kind != schema or (schema == SCHEMA and not _complete(result)):
        raise DataError(f"{path} is not a result of this version of motion-gym. Delete it, and run the command again.")
    return result


def _complete(result: dict[str, Any]) -> bool:
    """Whether a result has all that tables need."""
    try:
        parts = [result["metrics"][name] for name in ("ADE", "FDE")] + [result["versus_baseline"]["ADE"]]
        numbers = all(
            isinstance(part[key], (int, float, type(None))) for part in parts for key in ("mean", "low", "high")
        )
        plain = all(
            isinstance(result[key], str) for key in ("predictor", "spec", "split", "protocol", "scored", "finished")
        )
        return (
            numbers
            and plain
            and isinstance(result["samples"], int)
            and isinstance(result["leaks"], list)
            and isinstance(result["identity"]["domain"], str)
            and isinstance(result["identity"]["shots"], int)
        )
    except (KeyError, TypeError, IndexError):
        return False


def read_folder(folder: Path) -> list[dict[str, Any]]:
    """Results of a folder, by file name; of runs that differ only in code, data or version, the one made last.

    Raises:
        DataError: there is none, or one cannot be read.
    """
    paths = sorted(folder.glob("*.json"))
    if not paths:
        raise DataError(f"There is no result in {folder}. Make some: motion-gym score ... --out {folder}")
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for result in map(read, paths):
        key = key_of(result)
        if key not in found or found[key]["finished"] <= result["finished"]:
            found[key] = result
    return list(found.values())


def key_of(result: Mapping[str, Any]) -> tuple[Any, ...]:
    """What tells a run from others, besides code, data and versions."""
    return tuple(result["identity"].get(name) for name in IDENTIFIED)


@functools.cache
def package_code() -> str:
    """sha256 of all source files of motion-gym, its domains and its predictors."""
    here = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for path in sorted([*here.rglob("*.py")]):
        digest.update(path.relative_to(here).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def domain_key(domain: Domain) -> str:
    """A domain with all of its parameters, as results name it."""
    return catalog.format_spec(domain.card.name, dict(domain.card.parameters))


def _identity(
    made: Predictor,
    predictor: str,
    domain: Domain,
    split: str,
    k: int,
    protocol: str,
    seed: int,
    references: int | None,
    shots: int,
) -> Mapping[str, Any]:
    card = domain.card
    return {
        "predictor": predictor,
        "predictor_code": code_of(made),
        "weights": getattr(made, "fingerprint", None),
        "domain": domain_key(domain),
        "domain_code": code_of(domain),
        "files": {**card.files, **_files(card.parameters)},
        "data": _digest(windows_of_domain(domain, split)),
        "reference": _digest(domain.reference()) if hasattr(made, "observe") and protocol == "honest" else None,
        "split": split,
        "k": k,
        "protocol": protocol,
        "seed": seed,
        "references": references,
        "shots": shots,
        "motion_gym": versions()["motion-gym"],
        "motion_gym_code": package_code(),
    }


def code_of(thing: Any) -> str:
    """sha256 of the modules that define a class and its bases, so that a changed predictor is a new run."""
    digest = hashlib.sha256()
    for module in sorted({kind.__module__ for kind in type(thing).__mro__} - {"builtins", "typing"}):
        try:
            digest.update(inspect.getsource(sys.modules[module]).encode())
        except (OSError, TypeError, KeyError):
            digest.update(b"unknown")
    return digest.hexdigest()


def _files(parameters: Mapping[str, Any]) -> dict[str, str]:
    """sha256 of each file that a parameter names."""
    texts = [str(value) for value in parameters.values() if isinstance(value, (str, os.PathLike))]
    return {text: hashlib.sha256(Path(text).read_bytes()).hexdigest() for text in texts if os.path.isfile(text)}


def _digest(truth: Truth) -> str:
    """sha256 of what is scored."""
    seen, digest = truth.observation, hashlib.sha256()
    for array in (seen.history, seen.scene, seen.agent, truth.future, truth.known):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
