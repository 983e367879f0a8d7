"""The identity of a run: everything that determines its numbers. Neither PyTorch nor recordings are read."""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from motion_gym import catalog
from motion_gym.contract import Domain, SpecError
from motion_gym.stepping.harness import name_of
from motion_gym.training.plans import WEIGHTS

SCORING_VERSION = 2
"""Raised by hand when the scores of an unchanged predictor change."""
DRIVING_VERSION = 1
"""Raised by hand when the planner, the episodes or their scores change."""
VERSIONS: Mapping[str, int] = {"hedge": 3, "kalman_velocity": 2, "orca_oracle": 2}
"""Versions of shipped predictors and adapters, raised by hand when their forecasts change; 1 where none is named."""
AROUND: Mapping[str, str] = {"refine": "modular_invariant", "transfer": "modular_invariant"}
"""Default of the parameter ``of`` of predictors that are put around another predictor."""
QUESTION: Mapping[str, tuple[str, ...]] = {
    "windows": ("predictor", "domain", "split", "protocol", "k", "seed", "references", "shots"),
    "stream": ("row", "of", "stream", "options"),
    "study": ("study", "arguments"),
    "drive": ("predictor", "domain", "others", "episodes", "seed", "fitted_to"),
}
"""Keys of an identity that name the run, by kind; the other keys are versions and digests."""
OPTIONS = tuple(key for key in QUESTION["windows"] if key not in ("predictor", "domain"))
"""Options of ``evaluate`` that are keys of the identity of a score of windows."""


def windows_identity(
    predictor: Any,
    domain: Domain,
    *,
    split: str = "test",
    protocol: str = "honest",
    k: int = 1,
    seed: int = 0,
    references: int | None = None,
    shots: int = 0,
    session: str | None = None,
) -> dict[str, Any]:
    """Identity of a score of windows; see ``evaluate`` for the arguments, and ``answered_by`` for the session."""
    return {
        "kind": "windows",
        "predictor": label_of(predictor),
        "domain": facts_of(domain).spec,
        "split": split,
        "protocol": protocol,
        "k": k,
        "seed": seed,
        "references": references,
        "shots": shots,
        **answered_by([predictor], [domain], session),
    }


def stream_identity(
    row: Any,
    predictors: Sequence[Any],
    of: str,
    stream: str,
    domains: Sequence[Domain],
    options: Mapping[str, Any],
    session: str | None = None,
) -> dict[str, Any]:
    """Identity of an online run.

    Args:
        row: The adapter, or another name for the row of a table.
        predictors: All predictors and adapters that take part: specs, classes or objects.
        of: Spec of the predictor that is adapted.
        stream: Name of the stream, with its arguments.
        domains: Domains of the stream.
        options: Options of ``evaluate_online``.
        session: See ``answered_by``.
    """
    return {
        "kind": "stream",
        "row": label_of(row),
        "of": of,
        "stream": stream,
        "options": dict(sorted(options.items())),
        **answered_by(predictors, domains, session),
    }


def drive_identity(
    predictor: Any,
    domain: Domain,
    *,
    others: str,
    episodes: int,
    seed: int,
    fitted_to: Domain,
    session: str | None = None,
) -> dict[str, Any]:
    """Identity of driven episodes; see ``drive`` for the arguments, and ``answered_by`` for the session."""
    used = answered_by([predictor], [domain, fitted_to], session)
    return {
        "kind": "drive",
        "predictor": label_of(predictor),
        "domain": facts_of(domain).spec,
        "others": others,
        "episodes": episodes,
        "seed": seed,
        "fitted_to": facts_of(fitted_to).spec,
        **used,
        "versions": {**used["versions"], "driving": DRIVING_VERSION},
    }


def answered_by(predictors: Sequence[Any], domains: Sequence[Domain], session: str | None) -> dict[str, Any]:
    """Versions and digests of the predictors, domains and data of a run.

    Args:
        predictors: Specs, classes or objects.
        domains: Domains.
        session: Name of the running command. It is a part of the identity of runs with a user's predictor, adapter or
            domain, since their code and files are not known: only the same command reuses them, when it is resumed.
    """
    own = any(map(_is_own, predictors)) or any(facts_of(domain).own for domain in domains)
    names = [_name_of(part) for predictor in predictors for part in _nested(predictor)]
    return {
        "scoring_version": SCORING_VERSION,
        "versions": {
            **{name: VERSIONS.get(name, 1) for name in names},
            **{name: version for domain in domains for name, version in facts_of(domain).versions.items()},
        },
        "weights": {str(spec): digest for spec in predictors if (digest := _weights_digest(spec))},
        "data": {name: digest for domain in domains for name, digest in facts_of(domain).data.items()},
        "session": session if own else None,
    }


def canonical(identity: Mapping[str, Any]) -> dict[str, Any]:
    """The identity as it is read from a file."""
    return json.loads(json.dumps(identity, sort_keys=True, default=str))  # type: ignore[no-any-return]


def question(identity: Mapping[str, Any]) -> str:
    """Key of a run in the store: the part of its identity that names the run."""
    kind = identity["kind"]
    return json.dumps([kind, *(identity[name] for name in QUESTION[kind])], sort_keys=True, default=str)


def digest_of(text: str) -> str:
    """First 12 hexadecimal digits of the sha256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass(frozen=True)
class Facts:
    """The part of a run's identity that a domain determines.

    Attributes:
        spec: The domain with all of its parameters, defaults included, except those that are None: a later version may
            add a parameter that is None by default without making stored runs useless.
        own: Whether its class is a user's.
        versions: Version of the domain, raised by hand when its windows change, by name.
        data: sha256 of the data files of the domain and of its sources; the engine's version of a simulated domain.
    """

    spec: str
    own: bool
    versions: Mapping[str, int]
    data: Mapping[str, str]


def facts_of(domain: Domain) -> Facts:
    """The part of a run's identity that a domain determines; computed once for each object."""
    return domain.kept("facts for the store", functools.partial(_facts_of, domain))  # type: ignore[attr-defined, no-any-return]


def _facts_of(domain: Any) -> Facts:
    card, kind = domain.card, type(domain)
    data: dict[str, str] = {}
    for place in (domain, *domain.sources()):
        data |= place.card.files
        engine = getattr(type(place), "engine", None)
        data |= {f"engine of {place.card.name}": str(engine)} if engine is not None else {}
    shipped = {entry.target for entry in catalog.DOMAINS.values()}
    return Facts(
        catalog.format_spec(card.name, {k: v for k, v in card.parameters.items() if v is not None}),
        f"{kind.__module__}:{kind.__qualname__}" not in shipped,
        {card.name: getattr(kind, "version", 1)},
        data,
    )


def _nested(predictor: Any) -> list[Any]:
    """A predictor, and the predictors that it is put around, from the outside in."""
    if not isinstance(predictor, str):
        return [predictor]
    name, parameters = catalog.parse_spec(predictor)
    inner = parameters.get("of", AROUND.get(name))
    return [predictor, *(_nested(inner) if inner else [])]


def _name_of(predictor: Any) -> str:
    return catalog.parse_spec(predictor)[0] if isinstance(predictor, str) else label_of(predictor)


def label_of(predictor: Any) -> str:
    """Name of a row: the spec, or the name of a class or an object."""
    if isinstance(predictor, str):
        return predictor
    return predictor.__name__ if isinstance(predictor, type) else name_of(predictor)


@functools.lru_cache(maxsize=10_000)
def row_name(spec: str) -> str:
    """Row of a table that a spec belongs to: without its weights and seed."""
    name, parameters = catalog.parse_spec(spec)
    return catalog.format_spec(name, {k: v for k, v in parameters.items() if k not in ("weights", "seed")})


def _is_own(predictor: Any) -> bool:
    """Whether a predictor is a user's: an object, ``module:Class``, or a predictor with weights of a file."""
    if not isinstance(predictor, str):
        return True
    _, parameters = catalog.parse_spec(predictor)
    files = any(isinstance(v, str) and (v.endswith(".safetensors") or os.path.exists(v)) for v in parameters.values())
    shipped = {**catalog.PREDICTORS, **catalog.ADAPTERS, "oracle": None}
    return files or any(_name_of(part) not in shipped for part in _nested(predictor))


def is_of_own_code(identity: Mapping[str, Any]) -> bool:
    """Whether a stored run of windows is of a user's predictor or domain: no code is run because a result names it."""
    try:
        place = catalog.parse_spec(identity["domain"])[0]
        return bool(identity.get("session")) or _is_own(identity["predictor"]) or place not in catalog.DOMAINS
    except SpecError:
        return True  # no shipped predictor or domain is named so


@functools.cache
def shipped_card(weights: str, predictor: str) -> Mapping[str, Any]:
    """Card of the shipped weights of a predictor, or of the innermost predictor that it is put around.

    Raises:
        SpecError: these weights do not ship.
    """
    row = row_name(_nested(predictor)[-1])
    path = WEIGHTS / weights / f"{row.replace(':', '-', 1)}.json"
    try:
        card: Mapping[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError):
        raise SpecError(
            f"The weights `{weights}` have no `{row}`. Train it: motion-gym train {row} --benchmark {weights}."
        ) from None
    return card


def _weights_digest(predictor: Any) -> str | None:
    """sha256 of the weights that a spec names, from their card; None if it names no shipped weights."""
    if not isinstance(predictor, str):
        fingerprint = getattr(predictor, "fingerprint", None)
        return fingerprint if isinstance(fingerprint, str) else None
    weights = catalog.parse_spec(predictor)[1].get("weights")
    if weights is None or _is_own(predictor):
        return None
    return str(shipped_card(str(weights), predictor)["sha256"])
