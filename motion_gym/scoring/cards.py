"""Common parts of the scorecards of windows and streams: declared leaks, and JSON."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import resource
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import DataError, Domain, MotionGymError, PredictorError
from motion_gym.data.domains import spec_of
from motion_gym.data.overlap import trained_on_scored


def declared_leaks(
    domain: Domain, predictor: Any, split: str = "test", *, leaking: bool = False, selected: bool = False
) -> tuple[str, ...]:
    """Declared leaks of the future, as sentences.

    Args:
        domain: The domain that is scored.
        predictor: The predictor; ``trained_on`` and ``chosen_on`` name the domains on whose windows its weights were
            trained and its settings were chosen.
        split: The split that is scored.
        leaking: Whether the style is read from the scored scenes.
        selected: Whether the predictor was tuned on validation scenes of the domain.
    """
    leaks = []
    for attribute, action in (("trained_on", "weights were trained"), ("chosen_on", "settings were chosen")):
        names = getattr(predictor, attribute, ())
        if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
            owner = type(predictor).__name__
            raise PredictorError(f"`{attribute}` of {owner} is {names!r}: give specs of domains, as a tuple of texts.")
        for name in _domains_of_same_people(names, domain, split):
            leaks.append(f"the {action} on windows of {name} that are scored here")
    if domain.card.side_channels:
        leaks.append(f"oracle side channel: {', '.join(domain.card.side_channels)} reads the future")
    if selected:
        leaks.append("leak of the paper protocol: tuned as long as is best on validation scenes of the domain")
    if leaking:
        leaks.append("leak of the paper protocol: the style is read from the scored scenes' own future")
    return tuple(leaks)


def is_shipped(thing: Any) -> bool:
    """Whether a domain or predictor, and every predictor that it adapts, ships with motion-gym."""
    inner = [value for value in getattr(thing, "__dict__", {}).values() if callable(getattr(value, "predict", None))]
    kind = type(thing)
    module = sys.modules.get(kind.__module__)  # a user's class may give itself the name of another module
    own = getattr(module, kind.__qualname__, None) is kind
    return own and kind.__module__.startswith("motion_gym.") and all(map(is_shipped, inner))


def shows_own_data(domain: Domain) -> bool:
    """Whether a domain shows data of the user's: a class of their own, or a shipped class that reads their files."""
    return not is_shipped(domain) or "path" in domain.card.parameters


def origin_of_weights(predictor: Any) -> str:
    """What the weights of a predictor saw, from their card: places, step and measurement noise; empty without a card.

    Args:
        predictor: A predictor, ready for the domain.
    """
    card = getattr(predictor, "card", None)
    if not isinstance(card, Mapping) or "trained_on" not in card:
        return ""
    name = getattr(predictor, "weights", None) or getattr(predictor, "chosen", "of this session")
    noise = [source["noise"] for source in card.get("sources", ()) if source.get("noise") is not None]
    return (
        f"weights {name}: trained on {', '.join(card['trained_on']) or 'places that their card does not name'}, with "
        f"steps of {float(card.get('dt', 0.4)):g} s and a measurement noise of "
        + (f"up to {max(noise):.2g} (unit of the place)" if noise else "an amount that their card does not state")
    )


def _domains_of_same_people(names: Sequence[str], domain: Domain, split: str) -> list[str]:
    """Names of the domains whose training windows show people of a split of ``domain`` at the same time."""
    if not names:
        return []
    sources = [domain, *(domain.sources() if hasattr(domain, "sources") else [])]
    own = {spec_of(source): source for source in sources}
    same = []
    for name in names:
        source = own.get(name)
        if source is None:
            with contextlib.suppress(MotionGymError):  # an unknown domain
                source = catalog.domain(name)
        if source is None or not _may_show_same_people(source, domain):
            continue
        compare = functools.partial(trained_on_scored, source, domain, split)
        # Shipped weights are scored on a user's file although the data that they were trained on is not there.
        missing = contextlib.suppress(DataError) if not shows_own_data(source) else contextlib.nullcontext()
        with missing:
            if domain.kept(f"{name} shows people of {split}", compare):  # type: ignore[attr-defined]
                same.append(name if shows_own_data(source) else source.card.name)
    return list(dict.fromkeys(same))


def _may_show_same_people(source: Any, domain: Any) -> bool:
    """Whether two domains must be compared: they show one world, or recordings of which one is the user's."""
    if source.world == domain.world:
        return True
    if getattr(type(source), "draws_each_split", False) and is_shipped(source):
        return False  # simulated people are in no other domain
    return shows_own_data(source) or shows_own_data(domain)


def peak_memory() -> int:
    """Peak memory of the process so far, bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def in_json(value: Any) -> Any:
    """The value in JSON types; dataclasses become dicts, and NaN and infinities become None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return {str(key): in_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [in_json(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
