"""A study of style codes: whether the codes of scenes of different styles separate, trained styles or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ready, tell

SCENES = 60
"""Most scenes of each style."""


def style_codes(row: str, domains: Mapping[str, str], trained: Sequence[str]) -> dict[str, Any]:
    """Codes of single test scenes by style, on the two axes along which all codes vary most.

    Args:
        row: Spec of a predictor whose style is a mean of codes over the observed scenes, with its weights.
        domains: Specs of domains by the name of the style.
        trained: Names of the styles that the weights were trained on.

    Returns:
        ``codes``: style -> [scenes][2] on the two principal axes; ``share`` of the variance on them; ``recognised``:
        style -> share of scenes that are nearest to the mean code of their own style, of which they are left out;
        ``trained``; ``unit`` and ``dt``.
    """
    by_style = {name: _codes(row, catalog.domain(spec)) for name, spec in domains.items()}
    everything = np.concatenate(list(by_style.values()))
    center = everything.mean(axis=0)
    _, strengths, axes = np.linalg.svd(everything - center, full_matrices=False)
    card = catalog.domain(next(iter(domains.values()))).card
    return {
        "codes": {name: np.round((codes - center) @ axes[:2].T, 4).tolist() for name, codes in by_style.items()},
        "share": float((strengths[:2] ** 2).sum() / (strengths**2).sum()),
        "recognised": {name: recognised(by_style, name) for name in by_style},
        "trained": list(trained),
        "unit": card.unit,
        "dt": card.dt,
    }


def recognised(by_style: Mapping[str, np.ndarray], name: str) -> float:
    """Share of the codes [S, C] of a style that are nearest to the mean of their own style without them."""
    own = by_style[name]
    away = {other: np.linalg.norm(own - codes.mean(axis=0), axis=1) for other, codes in by_style.items()}
    without = (own.sum(axis=0) - own) / max(len(own) - 1, 1)
    away[name] = np.linalg.norm(own - without, axis=1)
    nearest = np.argmin(np.stack(list(away.values())), axis=0)
    return float(np.mean(nearest == list(away).index(name)))


def _codes(row: str, domain: Any) -> np.ndarray:
    """[S, C] codes of scenes spread evenly over the test split."""
    predictor: Any = ready(row, domain)
    truth = domain.windows("test")
    chosen = np.unique(np.linspace(0, truth.observation.scenes - 1, SCENES).astype(int))
    codes = []
    for scene in chosen.tolist():
        predictor.reset()
        before, count = np.array(predictor.observed, dtype=float), predictor.scenes
        tell(predictor, pick_scenes(truth, [scene]))
        if predictor.scenes > count:
            codes.append(np.array(predictor.observed, dtype=float) - before)
    return np.array(codes)
