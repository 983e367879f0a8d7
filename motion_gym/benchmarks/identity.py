"""What determines the numbers of a run, found without importing PyTorch and without reading recordings."""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.contract import Domain, SpecError
from motion_gym.stepping.harness import name_of

SCORING_VERSION = 2
"""Raised by hand when the scores of a predictor that did not change become other ones."""
WEIGHTS = Path(__file__).parent.parent / "weights"
"""Folder of the weights that ship with the package."""
VERSIONS: Mapping[str, int] = {}
"""Versions of shipped predictors and adapters, raised by hand when their forecasts change; 1 where none is named."""
AROUND: Mapping[str, str] = {"refine": "modular_invariant", "transfer": "modular_invariant"}
"""Predictors that are put around another one, and which one that is by default."""
QUESTION: Mapping[str, tuple[str, ...]] = {
    "windows": ("predictor", "domain", "split", "protocol", "k", "seed", "references", "shots"),
    "stream": ("row", "of", "stream", "options"),
    "study": ("study", "arguments"),
}
"""What is asked for by each kind of run; the rest of its identity says with what it was answered."""


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
    """Identity of a score of windows; arguments as of ``evaluate``, the session that of ``answered_by``."""
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
        domains: Domains that are played.
        options: Options of ``evaluate_online``.
        session: As for ``answered_by``.
    """
    asked = {"row": label_of(row), "of": of, "stream": stream, "options": dict(sorted(options.items()))}
    return {"kind": "stream", **asked, **answered_by(predictors, domains, session)}


def answered_by(predictors: Sequence[Any], domains: Sequence[Domain], session: str | None) -> dict[str, Any]:
    """Versions and digests of all that takes part in a run.

    Args:
        predictors: Specs, classes or objects.
        domains: Domains.
        session: Name of the command that is running. It is a part of the identity of runs with a predictor, an adapter
            or a domain of a user, since their code and files cannot be known: such runs are reused by the same command
            alone, when it is resumed.
    """
    own = any(map(is_own, predictors)) or any(facts_of(domain).own for domain in domains)
    return {
        "scoring_version": SCORING_VERSION,
        "versions": {
            **{name: VERSIONS.get(name, 1) for predictor in predictors for name in names_in(predictor)},
            **{name: version for domain in domains for name, version in facts_of(domain).versions.items()},
        },
        "weights": {str(spec): digest for spec in predictors if (digest := weights_digest(spec))},
        "data": {name: digest for domain in domains for name, digest in facts_of(domain).data.items()},
        "session": session if own else None,
    }


def canonical(identity: Mapping[str, Any]) -> dict[str, Any]:
    """The identity as it comes back from a file."""
    return json.loads(json.dumps(identity, sort_keys=True, default=str))  # type: ignore[no-any-return]


def question(identity: Mapping[str, Any]) -> str:
    """What a run was asked, as a key."""
    kind = identity["kind"]
    return json.dumps([kind, *(identity[name] for name in QUESTION[kind])], sort_keys=True, default=str)


def digest_of(text: str) -> str:
    """First 12 hexadecimal digits of the sha256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass(frozen=True)
class Facts:
    """What the identity of a run holds of a domain.

    Attributes:
        spec: The domain with all of its parameters, defaults included.
        own: Whether its class is not one of those that ship.
        versions: Version of the domain, raised by hand when its windows change, by name.
        data: sha256 of the data files of the domain and of its sources; the engine's version of a simulated domain.
    """

    spec: str
    own: bool
    versions: Mapping[str, int]
    data: Mapping[str, str]


def facts_of(domain: Domain) -> Facts:
    """What the identity of a run holds of a domain; found once for each object."""
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
        catalog.format_spec(card.name, dict(card.parameters)),
        f"{kind.__module__}:{kind.__qualname__}" not in shipped,
        {card.name: getattr(kind, "version", 1)},
        data,
    )


def names_in(predictor: Any) -> list[str]:
    """Name of a predictor, and of those that it is put around."""
    if not isinstance(predictor, str):
        return [label_of(predictor)]
    name, parameters = catalog.parse_spec(predictor)
    inner = parameters.get("of", AROUND.get(name))
    return [name, *(names_in(inner) if inner else [])]


def label_of(predictor: Any) -> str:
    """Name of a row: the spec, or the name of a class or an object."""
    if isinstance(predictor, str):
        return predictor
    return predictor.__name__ if isinstance(predictor, type) else name_of(predictor)


def row_name(spec: str) -> str:
    """Row of a table that a spec belongs to: without its weights and seed."""
    name, parameters = catalog.parse_spec(spec)
    return catalog.format_spec(name, {k: v for k, v in parameters.items() if k not in ("weights", "seed")})


def is_own(predictor: Any) -> bool:
    """Whether a predictor is not one of those that ship: an object, ``module:Class``, or one with weights of a file."""
    if not isinstance(predictor, str):
        return True
    _, parameters = catalog.parse_spec(predictor)
    files = any(isinstance(v, str) and (v.endswith(".safetensors") or os.path.exists(v)) for v in parameters.values())
    known = {**catalog.PREDICTORS, **catalog.ADAPTERS, "oracle": None}
    return files or any(name not in known for name in names_in(predictor))


def weights_row(row: str) -> str:
    """Row whose weights a row uses: that of the innermost predictor, as ``modular`` of ``refine:of=modular``."""
    name, parameters = catalog.parse_spec(row)
    inner = parameters.get("of", AROUND.get(name))
    return weights_row(inner) if inner else row_name(row)


@functools.cache
def shipped_card(weights: str, row: str) -> Mapping[str, Any]:
    """Card of shipped weights.

    Raises:
        SpecError: these weights do not ship.
    """
    path = WEIGHTS / weights / f"{weights_row(row).replace(':', '-', 1)}.json"
    try:
        card: Mapping[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError):
        raise SpecError(
            f"The weights `{weights}` have no `{weights_row(row)}`. Train it: motion-gym train {weights_row(row)} "
            f"--benchmark {weights}."
        ) from None
    return card


def weights_digest(predictor: Any) -> str | None:
    """sha256 of the weights that a spec names, as their card has it; None where it names no shipped weights."""
    if not isinstance(predictor, str):
        fingerprint = getattr(predictor, "fingerprint", None)
        return fingerprint if isinstance(fingerprint, str) else None
    weights = catalog.parse_spec(predictor)[1].get("weights")
    if weights is None or str(weights).endswith(".safetensors"):
        return None
    return str(shipped_card(str(weights), predictor)["sha256"])
