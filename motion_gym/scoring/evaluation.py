"""Scores of a predictor on a domain, with everything that a reader needs to know about them."""

from __future__ import annotations

import copy
import dataclasses
import functools
import time
from collections.abc import Mapping, Sequence
from typing import Any, overload

import numpy as np

from motion_gym import catalog
from motion_gym.contract import MOST_SAMPLES, Domain, Forecast, Predictor, SpecError, Truth
from motion_gym.data.domains import spec_of
from motion_gym.data.windows import counts, pick_scenes
from motion_gym.metrics.bootstrap import paired_difference, summarise
from motion_gym.metrics.errors import error_by_horizon, score
from motion_gym.scoring.cards import declared_leaks, is_shipped, origin_of_weights, peak_memory, shows_own_data
from motion_gym.scoring.scorecard import BASELINE, SHIPPED, Scorecard, SeedsCard, compare, who_was_scored
from motion_gym.scoring.shown import show_references, show_shots
from motion_gym.scoring.verification import keep, verify_order
from motion_gym.specs import one_of
from motion_gym.stepping.dicts import forecast_to_dict, observation_from_dict
from motion_gym.stepping.harness import ask, copied, name_of, ready, selection_of, tell, windows_of_domain
from motion_gym.stepping.pettingzoo_env import ForecastEnv

__all__ = ["BASELINE", "PROTOCOLS", "Scorecard", "SeedsCard", "compare", "default_k", "evaluate"]

PROTOCOLS: Mapping[str, str] = {
    "honest": "style read from reference scenes disjoint from those scored; k = 1 unless stated",
    "paper": "as published: style read from the 20 frames of the scored batches (a leak); best of 20 unless stated",
}
PAPER_BATCH = 64
"""Number of scenes of a test batch of the released program; ``paper`` reads the style from their future."""


@overload
def evaluate(predictor: str | Predictor, domain: str | Domain, *, seeds: None = None, **options: Any) -> Scorecard: ...


@overload
def evaluate(
    predictor: str | Predictor, domain: str | Domain, *, seeds: str | Sequence[int], **options: Any
) -> SeedsCard: ...


def evaluate(
    predictor: str | Predictor,
    domain: str | Domain,
    *,
    split: str = "test",
    k: int | None = None,
    protocol: str = "honest",
    seed: int = 0,
    references: int | None = None,
    shots: int = 0,
    through: str = "arrays",
    verify: bool = True,
    reference_draws: int = 5,
    seeds: str | Sequence[int] | None = None,
    **parameters: Any,
) -> Scorecard | SeedsCard:
    """Score a predictor on every window of a split.

    Args:
        predictor: A name, a spec, ``"module:Class"`` or a predictor; a copy of it is scored. A predictor given by name
            is fitted to the domain's sources if it must be fitted.
        domain: A name, a spec, ``"module:Class"`` or a domain.
        split: Split that is scored.
        k: Number of samples; by default 1 (``honest``) or 20 (``paper``).
        protocol: ``honest`` or ``paper``, see ``PROTOCOLS``.
        seed: Seed of the samples, and of the fit.
        references: Number of reference scenes that a predictor with ``observe`` observes under ``honest``; None for
            all.
        shots: Number of first scenes of the domain's training split. A predictor with ``tune`` is tuned on them, and a
            predictor with ``observe`` observes them under ``honest``. Under ``paper``, ``tune`` also gets the
            validation split, to select by.
        through: ``arrays`` asks for all windows at once; ``environment`` steps the PettingZoo environment. The scores
            are equal for every predictor whose forecasts do not depend on the batch.
        verify: Ask a predictor that does not ship with motion-gym again, in a fresh process, one scene at a time, in
            the order of time; see ``motion_gym.scoring.verification``. Every card states whether this was done.
        reference_draws: Number of draws of reference scenes if the domain has more than ``references``: the first
            scenes, and random ones. Means and intervals are over the draws.
        seeds: ``"all"`` scores the weights of every seed that the predictor's weights hold; numbers choose seeds of the
            weights or of the fit. None scores the weights of one seed, which the card names.
        **parameters: Parameters of the domain.

    Returns:
        Scorecard; with ``seeds``, a SeedsCard.

    Raises:
        SpecError: A name, parameter or option is not known.
        PredictorError: The predictor broke its contract.
        DataError: Data is missing or damaged.
    """
    samples = default_k(protocol) if k is None else k
    one_of("protocol", protocol, PROTOCOLS)
    one_of("through", through, ("arrays", "environment"))
    for name, value, least, most in (
        ("k", samples, 1, MOST_SAMPLES),
        ("seed", seed, 0, 2**63 - 1),
        ("references", references, 0, 10**9),
        ("shots", shots, 0, 10**9),
        ("reference_draws", reference_draws, 1, 1000),
    ):
        if value is not None:
            catalog.whole_number(name, value, least, most)
    score_one = functools.partial(
        _scored,
        place=catalog.domain(domain, **parameters),
        split=split,
        samples=samples,
        protocol=protocol,
        references=references,
        shots=shots,
        through=through,
        verify=verify,
        reference_draws=reference_draws,
    )
    if seeds is None:
        return score_one(predictor, seed=seed)
    cards = [score_one(spec, seed=s) for s, spec in _by_seed(predictor, seeds, seed)]
    return SeedsCard({card.seed if card.weights_seed is None else card.weights_seed: card for card in cards})


def default_k(protocol: str) -> int:
    """Default number of samples of a protocol: 20 as in publications, or 1."""
    return 20 if protocol == "paper" else 1


def _scored(
    predictor: str | Predictor,
    *,
    place: Domain,
    split: str,
    samples: int,
    protocol: str,
    seed: int,
    references: int | None,
    shots: int,
    through: str,
    verify: bool,
    reference_draws: int,
) -> Scorecard:
    """Show the predictor its shots and reference scenes, ask it, and score its forecasts."""
    truth = windows_of_domain(place, split)
    if not len(truth.future):
        raise SpecError(f"Split `{split}` of {place!r} has no agent to score.")
    instance = ready(copied(predictor), place, seed)
    observes, tunes, honest = hasattr(instance, "observe"), hasattr(instance, "tune"), protocol == "honest"
    if observes and not honest and through == "environment":
        raise SpecError("The paper protocol shows a predictor the batch it forecasts: use through='arrays'.")
    shots = shots if tunes or (observes and honest) else 0
    if shots:
        show_shots(instance, place, split, shots, protocol)
    predictors, shown = [instance], 0
    if observes and honest:
        predictors, shown = show_references(instance, place, split, references, reference_draws)
    forecasts: list[Forecast] = []
    leaking, seconds = observes and not honest, 0.0
    verified = _exemption(instance, verify, leaking)
    verifying = not verified
    for each in predictors:
        state = keep(each) if verifying else None
        began = time.perf_counter()
        if leaking:
            forecast = _by_leaking_batches(each, truth, samples, seed)
        elif through == "environment":
            forecast, truth = _by_stepping(each, place, split, truth, samples, seed)
        else:
            forecast = ask(each, truth.observation, samples, seed)
        seconds += time.perf_counter() - began
        if state is not None:
            forecast, method = verify_order(each, state, truth.observation, forecast, samples, seed)
            verified = verified or method
        forecasts.append(forecast)
    unit = place.card.unit
    draws = [score(forecast, truth, samples, unit) for forecast in forecasts]
    values = {name: np.stack([draw[name] for draw in draws]) for name in draws[0]}
    if len(predictors) == 1:
        values = {name: value[0] for name, value in values.items()}
    baseline = score(ask(ready(BASELINE, place), truth.observation), truth, 1, unit)
    counted = place.card.counts.get(split, counts(truth))
    chosen = getattr(instance, "weights", "") is None
    saw = origin_of_weights(instance) if chosen or shows_own_data(place) else ""
    agents = truth.observation.agent
    return Scorecard(
        predictor=predictor if isinstance(predictor, str) else name_of(instance),
        domain=dataclasses.replace(place.card, counts={split: counted}),
        spec=spec_of(place),
        split=split,
        protocol=protocol,
        k=samples,
        samples=forecasts[0].positions.shape[1],
        seed=seed,
        metrics=summarise(values, truth.observation),
        horizon=np.nanmean([error_by_horizon(forecast, truth) for forecast in forecasts], axis=(0, 1)).tolist(),
        versus_baseline={name: paired_difference(values[name], baseline[name], agents) for name in ("ADE", "FDE")},
        oracle=hasattr(instance, "know"),
        leaks=declared_leaks(place, instance, split, leaking=leaking, selected=tunes and shots > 0 and not honest),
        scored=who_was_scored(truth, counted),
        selection="; ".join(filter(None, (selection_of(instance), saw))),
        reference_scenes=shown,
        reference_draws=len(predictors),
        shots=shots,
        weights_seed=_weights_seed(instance),
        verified=verified,
        seconds=seconds,
        peak_memory=peak_memory(),
        values={name: value if value.ndim == 1 else value.mean(axis=0) for name, value in values.items()},
        truth=truth,
    )


def _exemption(predictor: Any, verify: bool, leaking: bool) -> str:
    """Why a predictor is not asked again; empty if it is asked again."""
    if hasattr(predictor, "know"):
        return "not verified: an oracle"
    if leaking:
        return "not verified: the paper protocol shows the predictor the scenes that are scored"
    if not verify:
        return "not verified: verify=False"
    return f"{SHIPPED}, which the tests verify" if is_shipped(predictor) else ""


def _by_stepping(
    predictor: Predictor, domain: Domain, split: str, truth: Truth, samples: int, seed: int
) -> tuple[Forecast, Truth]:
    first = pick_scenes(truth, [0]).observation
    samples = ask(copy.deepcopy(predictor), first, samples, seed).positions.shape[1]
    env = ForecastEnv(domain, split=split, samples=samples)
    observations, _ = env.reset()
    forecasts = []
    while env.agents:
        observation = observation_from_dict(observations, domain.card.dt, env.agents)
        forecasts.append(ask(predictor, observation, samples, seed))
        observations, *_ = env.step(forecast_to_dict(forecasts[-1], env.agents))
    stored, truth = env.ledger.read()
    # Actions have no weights.
    return Forecast(stored.positions, Forecast.join(forecasts).weights), truth


def _by_leaking_batches(predictor: Predictor, truth: Truth, samples: int, seed: int) -> Forecast:
    parts = []
    for first in range(0, truth.observation.scenes, PAPER_BATCH):
        batch = pick_scenes(truth, slice(first, first + PAPER_BATCH))
        if hasattr(predictor, "reset"):
            predictor.reset()
        tell(predictor, batch)
        parts.append(ask(predictor, batch.observation, samples, seed))
    return Forecast.join(parts)


def _weights_seed(predictor: Any) -> int | None:
    """Seed of the weights of a predictor, if its card names the seeds of its weights."""
    seeds = _seeds_of(predictor)
    chosen = getattr(predictor, "seed", None)
    return seeds[0] if seeds and chosen is None else chosen if seeds else None


def _seeds_of(predictor: Any) -> list[int]:
    getattr(predictor, "trained_on", None)  # loads weights that are loaded when first needed
    card = getattr(predictor, "card", None)
    return list(card.get("seeds", ())) if isinstance(card, Mapping) else []


def _by_seed(predictor: Any, seeds: str | Sequence[int], seed: int) -> list[tuple[int, str]]:
    """Seed of the fit and spec of the predictor, for each requested seed."""
    if not isinstance(predictor, str):
        raise SpecError("`seeds` needs a predictor given by name or spec, since each seed has weights of its own.")
    name, parameters = catalog.parse_spec(predictor)
    available = _seeds_of(catalog.predictor(predictor))
    if isinstance(seeds, str):
        if seeds != "all":
            raise SpecError(f"`seeds={seeds}` is not known: write 'all' or a list of numbers.")
        if not available:
            raise SpecError(f"`seeds=all`: {predictor} has no weights; name the seeds of its fit, as seeds=[0, 1, 2].")
        seeds = available
    if not seeds:
        raise SpecError("`seeds` is empty: name at least one seed, or 'all'.")
    if not available:
        return [(catalog.whole_number("seeds", s, 0, 2**31), predictor) for s in seeds]
    return [(seed, catalog.format_spec(name, {**parameters, "seed": s})) for s in seeds]
