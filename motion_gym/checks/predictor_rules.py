"""The rules of the predictor contract about ``predict`` and attributes; each takes a PredictorTrial and raises."""

from __future__ import annotations

import copy
import inspect
from typing import Any

import numpy as np

from motion_gym.checks.predictor_trials import (
    SAMPLES,
    PredictorTrial,
    distances,
    gap,
    partly_known,
    same,
    swapped,
    writable,
)
from motion_gym.checks.report import CheckError, NotChecked, broken_if
from motion_gym.contract import Forecast, MotionGymError
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import guarded
from motion_gym.stepping.snapshot import changed, global_randomness, snapshot

TOLERANCE = 1e-4
"""Metres between the forecasts of a scene alone and in a batch, beyond the rounding of float32."""


def attributes(trial: PredictorTrial) -> None:
    """Fitted is a bool; name and selection are text."""
    predictor = trial.make()
    for attribute, kind in (("fitted", bool), ("name", str), ("selection", str)):
        value = getattr(predictor, attribute, None)
        broken_if(
            value is not None and not isinstance(value, kind),
            f"{attribute} is {value!r}: make it of type {kind.__name__}.",
        )


def predict(trial: PredictorTrial) -> None:
    """Predict takes observation, samples and seed, and answers for every observation."""
    predictor = trial.make()
    check_signature(predictor, "predict", "observation", samples=1, seed=0)
    check_signature(predictor, "know", "domain")
    predictor = _fitted(trial)
    for samples in (1, 5, SAMPLES):
        try:
            trial.answer(predictor, trial.scenes.truth.observation, samples)
        except MotionGymError as error:
            synthetic = trial.scenes.synthetic
            where = "synthetic scenes of 1, 2 and 5 agents" if synthetic else "the windows of the domain"
            refused = synthetic and error.__cause__ is None
            hint = " If it is made for particular scenes, give a domain that has them." if refused else ""
            raise CheckError(f"with samples={samples}, on {where}: {str(error).rstrip('.')}.{hint}") from error


def forecast(trial: PredictorTrial) -> None:
    """The answer is a Forecast or array [A, K, 12, 2], K = samples or 1, of finite floats."""
    predictor = _fitted(trial)
    try:
        trial.answer(predictor, trial.scenes.truth.observation)
    except MotionGymError as error:
        raise NotChecked("predict raises") from error
    for samples in (1, 5, SAMPLES):
        try:
            trial.ask(predictor, samples=samples)
        except MotionGymError as error:
            raise CheckError(f"with samples={samples}: {error}") from error


def pure(trial: PredictorTrial) -> None:
    """The same state, input and seed give the bit-identical answer, whatever was asked in between."""
    predictor = _fitted(trial)
    remedy = "draw from numpy.random.default_rng(seed) alone, and learn in observe or fit alone."
    before = snapshot(predictor)
    try:
        first, again = trial.ask(predictor), trial.ask(predictor)
        _ask_others(trial, predictor)
        later = trial.ask(predictor)
    except MotionGymError as error:
        raise NotChecked("predict gives no valid forecast") from error
    for answer, when in ((again, "asked twice"), (later, "asked again after a forecast of other scenes")):
        if not same(first, answer):
            touched = ", ".join(changed(before, snapshot(predictor))[:3])
            cause = f" ({touched} changed)" if touched else ""
            raise CheckError(
                f"{when}, with the same input and seed, predict answered {gap(first, answer)} away{cause}: {remedy}"
            )
    if hasattr(predictor, "observe"):
        try:
            trial.observe(predictor)
        except MotionGymError:
            return  # rule `observe` says so
        broken_if(
            not same(trial.ask(predictor), trial.ask(predictor)),
            f"after observe, predict asked twice gave two answers: {remedy}",
        )


def state(trial: PredictorTrial) -> None:
    """Predict changes nothing that the predictor holds; a cache may grow while the answers stay the same."""
    trial.comparable()
    predictor = trial.ready()
    for samples in (1, 5, SAMPLES):
        trial.ask(predictor, samples=samples)  # what is kept for later calls is kept now
    before = snapshot(predictor)
    trial.ask(predictor)
    _ask_others(trial, predictor)
    trial.ask(predictor)
    touched = changed(before, snapshot(predictor))
    broken_if(touched, f"predict changed {', '.join(touched[:3])}: leave it as it is, or change it in observe.")


def input_(trial: PredictorTrial) -> None:
    """What a predictor is given stays as it was."""
    predictor = _fitted(trial)
    seen, truth, sets = trial.scenes.truth.observation, partly_known(trial.scenes.truth), trial.scenes.training()
    calls: list[tuple[str, tuple[Any, ...]]] = [("predict", (seen, SAMPLES, 3)), ("observe", (truth,))]
    if trial.trainable:
        calls.insert(0, ("fit", (*sets, 0)))
    for method, arguments in calls:
        if not hasattr(predictor, method):
            continue
        before = snapshot(arguments := copy.deepcopy(arguments))
        try:
            with global_randomness():
                guarded(predictor, method, *arguments)
        except MotionGymError:
            continue  # the rule of that method says so
        broken_if(
            snapshot(arguments) != before, f"{method} changed its input: work on a copy, as observation.history.copy()."
        )


def buffer(trial: PredictorTrial) -> None:
    """An answer that was given does not change later."""
    trial.comparable()
    predictor = trial.ready()
    answer = trial.answer(predictor, trial.scenes.truth.observation)
    positions = answer.positions if isinstance(answer, Forecast) else answer
    kept = positions.copy()
    trial.ask(predictor, seed=4)
    _ask_others(trial, predictor)
    broken_if(
        not np.array_equal(positions, kept),
        "predict wrote into an array that it had returned before: return a new one each time.",
    )


def randomness(trial: PredictorTrial) -> None:
    """The global generators of random, numpy and torch are left alone by predict."""
    trial.comparable()
    predictor, observation = trial.ready(), writable(trial.scenes.truth.observation)
    with global_randomness() as used:
        guarded(predictor, "predict", observation, samples=SAMPLES, seed=3)
    broken_if(
        used,
        f"predict drew from, or seeded, the global generator of {' and '.join(used)}: use "
        "numpy.random.default_rng(seed), or torch.Generator().manual_seed(seed).",
    )


def seed(trial: PredictorTrial) -> None:
    """Where samples differ, another seed gives other ones; fixed modes come with weights."""
    trial.comparable()
    predictor = trial.ready()
    first = trial.ask(predictor)
    broken_if(
        _drawn(first) and same(first, trial.ask(predictor, seed=5)),
        "samples differ, but seeds 3 and 5 give the same ones: draw from numpy.random.default_rng(seed), or, if "
        "they are fixed modes, return a Forecast with weights.",
    )


def scenes(trial: PredictorTrial) -> None:
    """The forecasts of a scene do not depend on the other scenes of the observation."""
    trial.comparable()
    predictor, here = trial.ready(), trial.scenes.truth.observation
    whole = trial.ask(predictor)
    remedy = "normalise, pool and attend within each scene (observation.scene, observation.scene_index)."
    limit = TOLERANCE + 4 * np.finfo(np.float32).eps * np.abs(here.xy).max(axis=(1, 2))
    for parity in (0, 1) if trial.scenes.synthetic else ():
        kept = here.scene_index % 2 == parity
        off = distances(whole, trial.ask(predictor, swapped(here, trial.scenes.other.observation, ~kept)))[kept]
        broken_if(
            (off > limit[kept]).any(),
            f"other positions in some scenes moved forecasts of others by {off.max():.2g} m: {remedy}",
        )
    if _drawn(whole) or not same(whole, trial.ask(predictor, seed=5)):
        return  # one seed draws other noise for another batch
    for scene in range(here.scenes):
        rows = slice(here.scene[scene], here.scene[scene + 1])
        alone = trial.ask(predictor, pick_scenes(trial.scenes.truth, [scene]).observation)
        off = distances(whole.take(np.arange(rows.start, rows.stop)), alone)
        broken_if(
            (off > limit[rows]).any(),
            f"alone, a scene is forecast {off.max():.2g} m from where it is among {here.scenes}: {remedy}",
        )


def check_signature(predictor: Any, method: str, *arguments: str, **keywords: Any) -> None:
    """Raise CheckError if the predictor has a method that cannot be called as the library calls it."""
    bound = getattr(predictor, method, None)
    if bound is None:
        return
    expected = ", ".join(("self", *arguments, *(f"{key}={value}" for key, value in keywords.items())))
    broken_if(not callable(bound), f"{method} is a {type(bound).__name__}: make it a method {method}({expected}).")
    try:
        signature = inspect.signature(bound)
    except ValueError:
        return  # a builtin that has no signature
    try:
        signature.bind(*arguments)
        signature.bind(*arguments, **keywords)
    except TypeError:
        raise CheckError(f"{method}{signature} must be {method}({expected}).") from None


def _fitted(trial: PredictorTrial) -> Any:
    try:
        return trial.ready()
    except NotChecked:
        raise
    except MotionGymError as error:
        raise NotChecked("the predictor cannot be fitted") from error


def _ask_others(trial: PredictorTrial, predictor: Any) -> None:
    """Ask about other scenes, and about none; the library never asks about none, so that predict may raise there."""
    trial.ask(predictor, trial.scenes.other.observation, seed=4)
    with np.errstate(all="ignore"):
        try:
            trial.answer(predictor, pick_scenes(trial.scenes.truth, slice(0, 0)).observation)
        except MotionGymError:
            return


def _drawn(forecast: Forecast) -> bool:
    """Whether samples differ and are not modes with weights."""
    return forecast.weights is None and not (forecast.positions == forecast.positions[:, :1]).all()
