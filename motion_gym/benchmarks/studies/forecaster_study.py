"""A forecaster at places that it was not trained on, against filters, and with parts of it left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.data.domains import training_set
from motion_gym.metrics.bootstrap import clustered_interval, paired_difference
from motion_gym.metrics.calibration import inside
from motion_gym.metrics.errors import score
from motion_gym.stepping.harness import ask, ready
from motion_gym.training.plans import training

CHOSEN = "filter chosen on the sources"
FILTERS = ("kalman_velocity", *(f"constant_velocity:velocity={steps}" for steps in ("last", 2, 3, 4, 5, 6, 7)))
"""Training-free forecasters to choose from."""
STEPS = (4, 8, 12)
"""Future steps whose coverage is measured."""


def against_filters(
    row: str, places: Mapping[str, str], filters: Sequence[str], seeds: Sequence[int]
) -> dict[str, Any]:
    """Errors of a forecaster and of filters at each place, and their paired differences.

    ``filter chosen on the sources`` is, of ``FILTERS``, the one with the lowest mean, over the other places, of its ADE
    on the train windows divided by that of constant velocity.

    Args:
        row: The forecaster.
        places: Training plan by place.
        filters: Forecasters without training.
        seeds: Seeds of the forecaster's weights.

    Returns:
        ``places``: place -> row -> ``ade`` of each seed and ``difference``: mean, low and high of the paired 95 %
        interval of the forecaster's ADE minus the row's; ``chosen``: place -> filter; ``unit`` and ``dt``.
    """
    result: dict[str, Any] = {}
    chosen: dict[str, str] = {}
    for place, plan in places.items():
        domain = catalog.domain(place)
        truth = domain.windows("test")
        errors = {
            row: np.array([_errors(ready(f"{row}:weights={plan},seed={s}", domain), truth) for s in seeds]),
            **{name: _errors(ready(name, domain), truth)[None] for name in filters},
        }
        chosen[place] = _best_filter(training_set(domain)[0])
        errors[CHOSEN] = _errors(ready(chosen[place], domain), truth)[None]
        agent = truth.observation.agent
        result[place] = {name: _entry(values, errors[row] - values, agent) for name, values in errors.items()}
    card = catalog.domain(next(iter(places))).card
    return {"row": row, "places": result, "chosen": chosen, "unit": card.unit, "dt": card.dt}


def coverage(
    rows: Sequence[str], trained: Sequence[str], places: Mapping[str, str], samples: int, shares: Sequence[float]
) -> dict[str, Any]:
    """Share of the ground truth that lies in the regions which samples span, by row, place and future step.

    Args:
        rows: Forecasters without weights.
        trained: Forecasters with the weights of the plan of each place, seed 0.
        places: Training plan by place.
        samples: Number of samples.
        shares: Shares of the samples that a region holds.

    Returns:
        ``coverage``: row -> place -> share -> step -> mean, low and high of the 95 % interval over agents; ``shares``,
        ``steps`` and ``samples``.
    """
    result: dict[str, Any] = {row: {} for row in (*rows, *trained)}
    for place, plan in places.items():
        domain = catalog.domain(place)
        truth = domain.windows("test")
        for row in result:
            spec = f"{row}:weights={plan},seed=0" if row in trained else row
            forecast = ask(ready(spec, domain), truth.observation, samples, 0)
            result[row][place] = {
                str(share): {
                    str(step): clustered_interval(inside(forecast, truth, step, share), truth.observation.agent)[:3]
                    for step in STEPS
                }
                for share in shares
            }
    return {"coverage": result, "shares": list(shares), "steps": list(STEPS), "samples": samples}


def ablations(
    row: str, places: Mapping[str, str], variants: Mapping[str, Mapping[str, Any]], seeds: Sequence[int]
) -> dict[str, Any]:
    """Errors of variants of a forecaster, each trained anew, and their paired differences from the forecaster.

    Args:
        row: The forecaster.
        places: Training plan by place.
        variants: ``settings`` of the predictor and ``options`` of ``fit`` by variant; the first one is the forecaster.
        seeds: Seeds to train.

    Returns:
        As ``against_filters``, without ``chosen``; differences are the variant's ADE minus the forecaster's.
    """
    fitted: dict[tuple[str, str], Any] = {}
    result: dict[str, Any] = {}
    for place, plan in places.items():
        truth = catalog.domain(place).windows("test")
        errors: dict[str, np.ndarray] = {}
        for name, variant in variants.items():
            if (plan, name) not in fitted:
                fitted[plan, name] = _fitted(row, plan, variant, seeds)
            errors[name] = np.array([_errors(one, truth) for one in fitted[plan, name]])
        full, agent = next(iter(errors.values())), truth.observation.agent
        result[place] = {name: _entry(values, values - full, agent) for name, values in errors.items()}
    card = catalog.domain(next(iter(places))).card
    return {"row": row, "places": result, "unit": card.unit, "dt": card.dt}


def _fitted(row: str, plan: str, variant: Mapping[str, Any], seeds: Sequence[int]) -> list[Any]:
    """A variant of a forecaster for each seed, trained on a plan."""
    settings, data = variant.get("settings", {}), training(plan)
    together: Any = catalog.predictor(row, **settings)
    together.fit(*data.data(), list(seeds), names=data.names(), **variant.get("options", {}))
    each: list[Any] = [catalog.predictor(row, **settings, seed=seed) for seed in seeds]
    for one in each:
        one.use(together.stacked, together.card)
    return each


def _errors(predictor: Any, truth: Any) -> np.ndarray:
    """ADE [A] of each agent-window."""
    return score(ask(predictor, truth.observation), truth)["ADE"]


def _entry(errors: np.ndarray, difference: np.ndarray, agent: np.ndarray) -> dict[str, Any]:
    """ADE of each seed from errors [D, A], and mean, low and high of differences [D, A], clustered by agent."""
    off = paired_difference(difference, np.zeros(len(agent)), agent)
    return {"ade": errors.mean(axis=1).tolist(), "difference": [off.mean, off.low, off.high]}


def _best_filter(sources: Sequence[Any]) -> str:
    """The filter with the lowest mean ratio of its ADE to that of constant velocity, over the sources."""
    plain = [_errors(catalog.predictor("constant_velocity"), truth).mean() for truth in sources]
    ratios = {
        name: np.mean([_errors(catalog.predictor(name), t).mean() / p for t, p in zip(sources, plain, strict=True)])
        for name in FILTERS
    }
    return min(ratios, key=lambda name: ratios[name])
