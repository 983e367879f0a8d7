"""Checks of results of others: their form, their weights and data, and a sample that is computed again."""

from __future__ import annotations

import lzma
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks.contradictions import TOLERANCE, contradiction_in
from motion_gym.benchmarks.identity import (
    OPTIONS,
    SCORING_VERSION,
    canonical,
    is_of_own_code,
    question,
    windows_identity,
)
from motion_gym.benchmarks.json_schema import json_schema
from motion_gym.benchmarks.store import parse
from motion_gym.contract import DataError, MotionGymError

MISMATCH, UNSURE, FINE = "wrong", "not checked", "fine"
Report = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Finding:
    """The outcome for one run.

    Attributes:
        run: Which run: its predictor and domain, or the number of the line if it is no run.
        verdict: ``fine``, ``wrong`` or ``not checked``.
        reason: What was compared, or what is wrong, or why it could not be checked.
    """

    run: str
    verdict: str
    reason: str


def read(path: Path) -> list[Any]:
    """Contents of a packed file, of a JSON file, or of all JSON files in a folder; damaged ones stay as errors.

    Raises:
        DataError: there is nothing to read.
    """
    if path.is_dir():
        contents = [_parsed(each.read_bytes) for each in sorted(path.rglob("*.json")) if each.is_file()]
        contents += [run for each in sorted(path.rglob("*.jsonl.xz")) for run in read(each)]
        if not contents:
            raise DataError(f"{path} has no results: name a folder that `motion-gym run --out` or `score --out` wrote.")
        return contents
    if path.exists() and not path.is_file():
        raise DataError(f"{path} is no file that holds results. Name a .json, a .jsonl.xz or a folder of results.")
    try:
        data = path.read_bytes()
        if path.name.endswith(".xz"):
            return [_parsed(lambda line=line: line) for line in lzma.decompress(data).splitlines()]  # type: ignore[misc]
    except (OSError, EOFError, lzma.LZMAError) as error:
        raise DataError(f"{path} cannot be read: {error}. Name a .json, a .jsonl.xz or a folder of results.") from None
    content = _parsed(lambda: data)
    return content if isinstance(content, list) else [content]


def _parsed(content: Callable[[], bytes]) -> Any:
    try:
        return parse(content())
    except (OSError, ValueError, RecursionError) as error:
        return error


SCORES = ("metrics", "horizon", "ade", "fde", "value")
"""Keys of scores, which are the same where a run is computed again."""


def validate(
    runs: Sequence[Any], recompute: int = 3, seed: int = 0, report: Report = lambda done, total, label: None
) -> list[Finding]:
    """Check runs, and compute some of them again.

    Args:
        runs: Contents of files, see ``read``.
        recompute: Number of runs of windows that are computed again, drawn at random from those of shipped predictors.
        seed: Seed of that choice.
        report: Called before each run that is computed again.

    Returns:
        A finding for each run that is wrong, for each run that was computed again, and one for all others.
    """
    findings, sound = [], []
    checks = _validators()
    for number, run in enumerate(runs, 1):
        problem = _problem(run, checks)
        if problem:
            findings.append(Finding(_name(run) or f"run {number}", MISMATCH, problem))
        else:
            sound.append(run)
    asked: dict[str, Any] = {}
    for run in sound:
        identity = run["identity"]
        first = asked.setdefault(f"{question(identity)} {identity.get('session')}", run)
        if not all(_same(first.get(key), run.get(key)) for key in SCORES):
            findings.append(Finding(_name(run), MISMATCH, "the same run is there twice, with other values"))
    findings += [finding for run in sound for finding in _compare_identity(run)]
    own = [run for run in sound if _is_own(run)]
    if own:
        findings.append(
            Finding(f"{len(own)} runs", UNSURE, "of predictors, adapters or domains of a user: their code is not known")
        )
    candidates = [run for run in sound if run["identity"]["kind"] == "windows" and not _is_own(run)]
    wrong = {finding.run for finding in findings if finding.verdict == MISMATCH}
    candidates = [run for run in candidates if _name(run) not in wrong]
    chosen = np.random.default_rng(seed).permutation(len(candidates))[:recompute]
    for done, index in enumerate(sorted(chosen.tolist())):
        report(done, len(chosen), _name(candidates[index]))
        findings.append(_compute_again(candidates[index]))
    rest = len(sound) - len(chosen) - len(own) - len(wrong)
    if rest > 0:
        findings.append(Finding(f"{rest} other runs", FINE, "form, versions and digests; not computed again"))
    return findings


def _same(one: Any, other: Any) -> bool:
    """Whether two values of JSON have the same form and text, and the same numbers to ``TOLERANCE``."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, (int, float)) and isinstance(other, (int, float)):
        return abs(one - other) <= TOLERANCE * max(1, abs(one))
    return bool(one == other)


def _is_own(run: Mapping[str, Any]) -> bool:
    identity = run["identity"]
    return bool(identity.get("session")) or (identity["kind"] == "windows" and is_of_own_code(identity))


def _validators() -> Mapping[str, Any]:
    import jsonschema

    schema = json_schema()
    common = {key: value for key, value in schema.items() if key != "oneOf"}
    return {
        part["properties"]["identity"]["properties"]["kind"]["const"]: jsonschema.Draft202012Validator(
            {"allOf": [common, part]}
        )
        for part in schema["oneOf"]
    }


def _problem(run: Any, checks: Mapping[str, Any]) -> str:
    """What is wrong with the form or the numbers of a run; empty if nothing is."""
    if isinstance(run, Exception):
        return f"it cannot be read: {run}"
    identity: Any = run.get("identity") if isinstance(run, dict) else None
    kind = identity.get("kind") if isinstance(identity, dict) else None
    if not isinstance(kind, str) or kind not in checks:
        return "it is not a result of motion-gym"
    error = next(checks[kind].iter_errors(run), None)
    if error is not None:
        place = ".".join(map(str, error.absolute_path))
        return f"`{place}`: {error.message[:200]}" if place else error.message[:200]
    if identity["scoring_version"] != SCORING_VERSION:
        return f"scoring version {identity['scoring_version']}, and this is {SCORING_VERSION}: score it again"
    return contradiction_in(run)


def _compare_identity(run: Mapping[str, Any]) -> Iterator[Finding]:
    """Versions and digests of shipped predictors, domains and weights that differ from those here."""
    stored = run["identity"]
    if stored["kind"] != "windows" or _is_own(run):
        return
    options = {key: stored[key] for key in OPTIONS}
    try:
        domain: Any = catalog.domain(stored["domain"])
        here = canonical(windows_identity(stored["predictor"], domain, **options))
    except MotionGymError as error:
        yield Finding(_name(run), UNSURE, str(error))
        return
    known = canonical(domain.parameters)
    if any(known.get(key) != value for key, value in run["domain"]["parameters"].items() if value is not None):
        yield Finding(_name(run), MISMATCH, "its domain has other parameters than its identity")
        return
    for part, name in (("versions", "version"), ("weights", "digest of the weights"), ("data", "digest of the data")):
        for key, value in stored.get(part, {}).items():
            if key in here[part] and here[part][key] != value:
                yield Finding(_name(run), MISMATCH, f"{name} of {key}: {value} there, {here[part][key]} here")
                return


def _compute_again(run: Mapping[str, Any]) -> Finding:
    from motion_gym.scoring.evaluation import evaluate

    identity = run["identity"]
    options = {key: identity[key] for key in OPTIONS}
    try:
        card = evaluate(identity["predictor"], identity["domain"], reference_draws=run["reference_draws"], **options)
    except MotionGymError as error:
        return Finding(_name(run), UNSURE, f"it could not be computed again: {error}")
    said = canonical(card.as_dict())
    for name in ("spec", "oracle", "leaks", "selection", "scored"):
        if run[name] != said[name]:
            return Finding(_name(run), MISMATCH, f"its {name} is {said[name]!r} here, and {run[name]!r} there")
    for name in ("ADE", "FDE"):
        stored, computed = run["metrics"][name]["mean"], card.metrics[name].mean
        if stored is None or abs(stored - computed) > TOLERANCE:
            return Finding(_name(run), MISMATCH, f"{name} is {computed:.4f} {card.domain.unit} here, {stored} there")
    return Finding(_name(run), FINE, f"computed again: ADE and FDE equal to {TOLERANCE:g} {card.domain.unit}")


def _name(run: Any) -> str:
    """Which run it is, for people."""
    identity = run.get("identity") if isinstance(run, dict) else None
    if not isinstance(identity, dict):
        return ""
    row = identity.get("predictor") or identity.get("row") or identity.get("study")
    place = identity.get("domain") or identity.get("stream") or ""
    return f"{row} on {place}" if place else str(row)
