"""What the scorecards of windows and of streams share: what they declare, and how they become JSON."""

from __future__ import annotations

import resource
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import Card


def declared_leaks(card: Card, leaking: bool, selected: bool, trained_on: Sequence[str], kind: type) -> tuple[str, ...]:
    """What reads the future on purpose, as sentences."""
    leaks = []
    if card.name in (catalog.parse_spec(spec)[0] for spec in trained_on) and getattr(kind, "tests_on_train", False):
        leaks.append(f"the weights were trained on windows of {card.name} that are scored here")
    if card.side_channels:
        leaks.append(f"oracle side channel: {', '.join(card.side_channels)} reads the future")
    if selected:
        leaks.append("leak of the paper protocol: tuned as long as is best on validation scenes of the domain")
    if leaking:
        leaks.append("leak of the paper protocol: the style is read from the scored scenes' own future")
    return tuple(leaks)


def peak_memory() -> int:
    """Bytes, of the whole process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def in_json(value: Any) -> Any:
    """The value in JSON types; what is not finite becomes None."""
    if isinstance(value, Mapping):
        return {str(key): in_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [in_json(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
