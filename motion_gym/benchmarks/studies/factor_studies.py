"""Studies of style factors: forecasts with swapped codes of factors, and the side on which real people pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks.row_specs import with_parameters
from motion_gym.contract import FUTURE, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.bootstrap import clustered_interval, paired_difference
from motion_gym.metrics.errors import score
from motion_gym.metrics.passing import encounters, passed
from motion_gym.stepping.harness import ask, ready, tell

OWN, BOTH, WRONG_SIDE, WRONG_D = "own scenes", "both right", "wrong side", "wrong d"
"""The scenes that codes are read from: of the scored style itself; or each factor from scenes of another style, which
have only this factor of the scored style, or not even this one."""
AGENTS = 2


def swaps(
    title: str,
    rows: Sequence[str],
    weights: str,
    targets: Mapping[str, Mapping[str, str]],
    seeds: Sequence[int],
    references: int,
) -> dict[str, Any]:
    """Forecasts with the code of each factor from reference scenes that show only this factor right, or wrong.

    A predictor with one code reads it from the scenes of both factors together.

    Args:
        title: Heading of the table.
        rows: Predictors with a style.
        weights: Name of their weights.
        targets: By name: ``scored``, the domain that is scored, and the domains that codes are read from: ``side`` and
            ``d``, which have only this parameter in common with it, ``wrong side`` and ``wrong d``.
        seeds: Seeds of the weights.
        references: Number of reference scenes of each domain.

    Returns:
        ``title``; ``rows``: row -> target -> ``values``: codes -> measure -> mean of each seed, and ``changes``: factor
        -> measure -> mean, low and high of the paired 95 % interval, over scenes and seeds, of the values with both
        codes right minus those with the wrong code of the factor. Measures: ``ADE``; ``distance``, the smallest one
        between the forecasts of a scene; and ``right``, the share of scenes whose forecasts pass on the right.
    """
    result: dict[str, Any] = {}
    for row in rows:
        for target, domains in targets.items():
            domain = catalog.domain(domains["scored"])
            truth = domain.windows("test")
            shown = {
                name: pick_scenes(catalog.domain(spec).reference(), slice(0, references))
                for name, spec in domains.items()
            }
            cases = {
                OWN: (shown["scored"], shown["scored"]),
                BOTH: (shown["side"], shown["d"]),
                WRONG_SIDE: (shown[WRONG_SIDE], shown["d"]),
                WRONG_D: (shown["side"], shown[WRONG_D]),
            }
            predictors: list[Any] = [ready(with_parameters(row, weights=weights, seed=s), domain) for s in seeds]
            by_seed = {
                case: [_measures(_reading(p, *scenes), truth) for p in predictors] for case, scenes in cases.items()
            }
            values = {case: {m: np.array([each[m] for each in by]) for m in by[0]} for case, by in by_seed.items()}
            result.setdefault(row, {})[target] = {
                "values": {c: {m: v.mean(axis=1).tolist() for m, v in by.items()} for c, by in values.items()},
                "changes": {
                    factor: {m: _interval(values[BOTH][m] - values[wrong][m]) for m in values[BOTH]}
                    for factor, wrong in (("side", WRONG_SIDE), ("d", WRONG_D))
                },
            }
    card = catalog.domain(next(iter(targets.values()))["scored"]).card
    return {"title": title, "rows": result, "references": references, "unit": card.unit, "dt": card.dt}


def passing_sides(domains: Mapping[str, str]) -> dict[str, Any]:
    """The share of encounters in which people pass each other on the right; see ``metrics.passing.encounters``.

    The y axis must be to the left of the x axis, seen from above: in ETH-UCY it is, by the published homographies from
    images to the ground. Images of ``sdd`` have it downwards, and are mirrored.

    Args:
        domains: Specs of domains in metres, by name; all recordings of their split ``test`` are read.

    Returns:
        ``places``: name -> ``right``: mean, low and high of the 95 % interval, which resamples half-minutes of the
        recordings; ``encounters``; ``people``; ``distance``: the median of the smallest distances, metres.
    """
    result: dict[str, Any] = {}
    for name, spec in domains.items():
        domain: Any = catalog.domain(spec)
        downwards = domain.card.name == "sdd"
        found = [encounters(recording, downwards) for recording in domain.recordings("test")]
        right = np.concatenate([each.right for each in found]).astype(float)
        cluster = np.concatenate([each.period + number * 10**6 for number, each in enumerate(found)])
        result[name] = {
            "right": list(clustered_interval(right, cluster)),
            "encounters": len(right),
            "people": sum(len(np.unique(each.agents)) for each in found),
            "distance": float(np.median(np.concatenate([each.distance for each in found]))),
        }
    return {"places": result}


def _reading(predictor: Any, side: Truth, d: Truth) -> Any:
    """The predictor after it has read the code of each factor, or one code from all scenes."""
    predictor.reset()
    if getattr(predictor, "factors", ()):
        predictor.observe(side, factors=["side"])
        predictor.observe(d, factors=["d"])
    else:
        for scenes in [side] if side is d else [side, d]:
            tell(predictor, scenes)
    return predictor


def _measures(predictor: Any, truth: Truth) -> dict[str, np.ndarray]:
    """Measures [S] of each scene."""
    forecast = ask(predictor, truth.observation)
    right, distance = passed(forecast.positions[:, 0].reshape(-1, AGENTS, FUTURE, 2).astype(np.float64))
    ade = score(forecast, truth)["ADE"].reshape(-1, AGENTS).mean(axis=1)
    return {"ADE": ade, "distance": distance, "right": right.astype(float)}


def _interval(difference: np.ndarray) -> list[float]:
    """Mean, low and high of differences [D, S] by seed and scene."""
    scenes = np.arange(difference.shape[1])
    off = paired_difference(difference, np.zeros(len(scenes)), scenes)
    return [off.mean, off.low, off.high]
