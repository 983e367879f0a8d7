"""Studies: values other than scores. Each function takes JSON values and returns a dict of JSON values.

A study is computed once and stored; ``study_tables`` and ``figures`` show the stored values. Lengths are in the unit of
the domain, positions [agents, steps, 2] in world coordinates.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks.identity import shipped_card
from motion_gym.benchmarks.row_specs import takes_weights, with_parameters
from motion_gym.contract import FUTURE, Domain, SpecError, Truth
from motion_gym.data.domains import spec_of, training_set
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import score
from motion_gym.stepping.harness import ask, ready, tell

COUNTS = (0, 1, 4, 16, 64, 256)
"""Numbers of reference scenes from which a style is read."""
STEPS = (0, 3, 10, 30)
"""Numbers of refinement steps."""
REFERENCES = 64
"""Number of reference scenes towards whose style a forecast is refined."""
DRAWN_AGENTS = (3, 6)
"""Smallest and largest number of agents in a scene that is drawn."""

Study = dict[str, Any]
"""A stored study."""


def by_references(rows: Sequence[str], weights: str, domains: Mapping[str, str]) -> Study:
    """Errors by the number of reference scenes that the style is read from.

    Args:
        rows: Predictors with ``observe``.
        weights: Name of their weights.
        domains: Specs of the domains by their names in the table.

    Returns:
        ``counts``: numbers of reference scenes; ``seeds``: seeds of the weights, each with its own reference scenes;
        ``ade``: name of the domain -> row -> [counts][seeds] mean ADE at k = 1; ``unit`` and ``dt``.
    """
    ade: dict[str, dict[str, list[list[float]]]] = {}
    seeds: list[int] = []
    for name, spec in domains.items():
        domain = catalog.domain(spec)
        truth, reference = domain.windows("test"), domain.reference()
        for row in rows:
            seeds = list(shipped_card(weights, row)["seeds"])
            predictors: list[Any] = [ready(with_parameters(row, weights=weights, seed=seed), domain) for seed in seeds]
            ade.setdefault(name, {})[row] = [
                [_error_after(p, reference, count, seed, truth) for p, seed in zip(predictors, seeds, strict=True)]
                for count in COUNTS
            ]
    return {"counts": list(COUNTS), "seeds": seeds, "ade": ade, **_measure(domain.card)}


def _error_after(predictor: Any, reference: Truth, count: int, seed: int, truth: Truth) -> float:
    """Mean ADE of a predictor that has observed some reference scenes, drawn with a seed."""
    drawn = np.random.default_rng(seed).permutation(reference.observation.scenes)[:count]
    predictor.reset()
    tell(predictor, pick_scenes(reference, drawn))
    return _ade(predictor, truth)


def left_out(rows: Sequence[str], domain: str | Domain) -> Study:
    """Leave-one-source-out: fit to the train windows of all sources but one, score on the source that is left out.

    The windows of the domain itself are not used.

    Args:
        rows: Specs of predictors that are fitted in closed form.
        domain: The domain whose sources are used.

    Returns:
        ``ade``: row -> source -> mean ADE at k = 1 on the validation windows of that source, and ``mean`` over the
        sources; ``chosen``: the row with the lowest mean; ``unit`` and ``dt``.
    """
    place = catalog.domain(domain)
    sources = place.sources()  # type: ignore[attr-defined]
    train, validation = training_set(place)
    ade: dict[str, dict[str, float]] = {}
    for row in rows:
        errors = {}
        for out, source in enumerate(sources):
            predictor: Any = catalog.predictor(row)
            others = [[truth for i, truth in enumerate(part) if i != out] for part in (train, validation)]
            predictor.fit(*others, 0)
            errors[spec_of(source)] = _ade(predictor, validation[out])
        ade[row] = {**errors, "mean": float(np.mean(list(errors.values())))}
    return {"ade": ade, "chosen": min(ade, key=lambda row: ade[row]["mean"]), **_measure(place.card)}


def one_scene(place: str, alphas: Sequence[float], rows: Sequence[str], weights: str) -> Study:
    """Forecasts of one scene by several predictors at several alphas.

    The scene has three to six agents, and the largest mean final error of constant velocity of all such scenes.

    Args:
        place: Domain with the parameter alpha.
        alphas: Values of alpha.
        rows: Predictors.
        weights: Name of the weights, for rows with weights.

    Returns:
        ``history`` and ``future`` of the scene; ``panels``: heading -> row -> most likely forecast; ``unit`` and
        ``dt``.
    """
    truth = catalog.domain(place, alpha=alphas[0]).windows("test")
    number = _scene_with_turns(truth)
    panels: dict[str, dict[str, Any]] = {}
    for alpha in alphas:
        domain = catalog.domain(place, alpha=alpha)
        scene = pick_scenes(domain.windows("test"), [number])
        for row in rows:
            predictor = ready(with_parameters(row, weights=weights) if takes_weights(row) else row, domain)
            forecast = ask(predictor, scene.observation).most_likely()
            panels.setdefault(f"alpha = {alpha:g}", {})[row] = _positions(forecast)
    return {**_scene(pick_scenes(truth, [number])), "panels": panels, **_measure(domain.card)}


def two_agents(row: str, weights: str, right: str, wrong: str) -> Study:
    """Forecasts of one scene, refined towards reference scenes of its own style and of another style.

    Refinement starts from the mean style of training. The scene is the median by the smallest distance between its
    agents in the unrefined forecast.

    Args:
        row: Predictor that is refined.
        weights: Name of its weights; the first seed is used.
        right: Domain of the scene, with two agents.
        wrong: Domain of another style.

    Returns:
        ``history`` and ``future`` of the scene; ``panels``: heading -> number of steps -> forecast; ``unit`` and
        ``dt``.
    """
    domain = catalog.domain(right)
    truth = domain.windows("test")
    of = with_parameters(row, weights=weights, seed=shipped_card(weights, row)["seeds"][0])

    def forecast(style: str, steps: int, scenes: Truth) -> np.ndarray:
        predictor: Any = catalog.predictor("refine", of=of, steps=steps)
        predictor.observe(pick_scenes(catalog.domain(style).reference(), slice(0, REFERENCES)))
        predictor.inner.reset()
        return ask(predictor, scenes.observation).most_likely()

    unrefined = forecast(right, 0, truth).reshape(-1, 2, FUTURE, 2)
    closest = np.linalg.norm(unrefined[:, 1] - unrefined[:, 0], axis=-1).min(axis=1)
    scene = pick_scenes(truth, [int(np.argsort(closest)[len(closest) // 2])])
    panels = {
        f"towards scenes of {style} (the scene is of {right})": {
            f"{steps} steps": _positions(forecast(style, steps, scene)) for steps in STEPS
        }
        for style in (right, wrong)
    }
    return {**_scene(scene), "panels": panels, **_measure(domain.card)}


def _ade(predictor: Any, truth: Truth) -> float:
    return float(np.mean(score(ask(predictor, truth.observation), truth)["ADE"]))


def _measure(card: Any) -> Study:
    return {"unit": card.unit, "dt": card.dt}


def _scene(scene: Truth) -> Study:
    return {"history": _positions(scene.observation.xy), "future": _positions(scene.future)}


def _positions(positions: np.ndarray) -> list[Any]:
    """Positions, rounded to 0.1 mm."""
    return np.round(positions.astype(float), 4).tolist()  # type: ignore[no-any-return]


def _scene_with_turns(truth: Truth) -> int:
    """Number of the scene of three to six agents with the largest mean final error of constant velocity."""
    xy, scene = truth.observation.xy, truth.observation.scene
    straight = xy[:, -1] + FUTURE * (xy[:, -1] - xy[:, -2])
    errors = np.linalg.norm(truth.future[:, -1] - straight, axis=-1)
    means = np.array([errors[a:b].mean() for a, b in itertools.pairwise(scene)])
    sizes, fewest, most = np.diff(scene), *DRAWN_AGENTS
    fits = (sizes >= fewest) & (sizes <= most)
    if not fits.any():
        raise SpecError(f"No scene of {fewest} to {most} agents to draw: choose another domain.")
    return int(np.where(fits, means, -1).argmax())
