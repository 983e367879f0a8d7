"""The rules of the predictor contract for ``predict`` and attributes; each takes a PredictorTrial and raises."""

from __future__ import annotations

import copy
import dataclasses
import inspect
from typing import Any

import numpy as np

from motion_gym.checks.predictor_trials import FAR, INVALID, SAMPLES, PredictorTrial, distances, gap, partly_known, same
from motion_gym.checks.report import CheckError, NotChecked, broken_if
from motion_gym.contract import Forecast, MotionGymError
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import SIGNATURES, guarded, signature_of
from motion_gym.stepping.snapshot import changed, global_randomness, snapshot

TOLERANCE = 1e-4
"""Metres between the forecasts of a scene alone and in a batch, beyond the rounding of float32."""
ALIKE = 0.999
"""Correlation of the deviations of samples from their mean, from which on noise is the same."""
FROM_SEED = "numpy.random.default_rng([seed, zlib.crc32(xy_of_the_scene.tobytes())]), one generator for each scene"
"""What to draw from: other noise for each seed and for each scene, whatever the other scenes."""


def attributes(trial: PredictorTrial) -> None:
    """Attribute fitted is a bool; name and selection are text."""
    predictor = trial.make()
    for attribute, kind in (("fitted", bool), ("name", str), ("selection", str)):
        value = getattr(predictor, attribute, None)
        broken_if(
            value is not None and not isinstance(value, kind),
            f"{attribute} is {value!r}: make it of type {kind.__name__}.",
        )


def predict(trial: PredictorTrial) -> None:
    """Method predict takes observation, samples and seed, and answers for every observation."""
    predictor = trial.make()
    check_signature(predictor, "predict")
    check_signature(predictor, "know")
    predictor = trial.ready()
    for samples in (1, 5, SAMPLES):
        try:
            trial.answer(predictor, trial.scenes.truth.observation, samples)
        except MotionGymError as error:
            synthetic = trial.scenes.synthetic
            where = "synthetic scenes of 1, 2 and 5 agents" if synthetic else "the windows of the domain"
            refused = synthetic and error.__cause__ is None
            hint = " If the predictor is made for particular scenes, give a domain that has them." if refused else ""
            raise CheckError(f"with samples={samples}, on {where}: {str(error).rstrip('.')}.{hint}") from error


def forecast(trial: PredictorTrial) -> None:
    """The answer is a Forecast or an array [A, K, 12, 2] of finite floats, with K = samples or 1."""
    predictor = trial.ready()
    try:
        trial.answer(predictor, trial.scenes.truth.observation)
    except MotionGymError as error:
        raise NotChecked(INVALID) from error
    for samples in (1, 5, SAMPLES):
        try:
            trial.ask(predictor, samples=samples)
        except MotionGymError as error:
            raise CheckError(f"with samples={samples}: {error}") from error


def pure(trial: PredictorTrial) -> None:
    """The same state, input and seed give the bit-identical answer, whatever was forecast in between."""
    predictor = trial.ready()
    remedy = f"draw from {FROM_SEED} alone, and learn in observe or fit alone."
    before = snapshot(predictor)
    try:
        first, again = trial.ask(predictor), trial.ask(predictor)
        _ask_others(trial, predictor)
        later = trial.ask(predictor)
    except MotionGymError as error:
        raise NotChecked(INVALID) from error
    for answer, when in ((again, "asked twice"), (later, "asked again after a forecast of other scenes")):
        if not same(first, answer):
            touched = ", ".join(changed(before, snapshot(predictor))[:3])
            cause = f" ({touched} changed)" if touched else ""
            raise CheckError(
                f"{when}, with the same input and seed, predict answered {gap(first, answer)} away{cause}: {remedy}"
            )
    if hasattr(predictor, "observe"):
        trial.observe(predictor)
        broken_if(
            not same(trial.ask(predictor), trial.ask(predictor)),
            f"after observe, predict gave two answers to the same question: {remedy}",
        )


def state(trial: PredictorTrial) -> None:
    """Method predict changes no attribute; a cache may grow while the answers stay the same."""
    predictor = trial.comparable()
    for samples in (1, 5, SAMPLES):
        trial.ask(predictor, samples=samples)  # fills caches before the snapshot
    before = snapshot(predictor)
    trial.ask(predictor)
    _ask_others(trial, predictor)
    trial.ask(predictor)
    touched = changed(before, snapshot(predictor))
    broken_if(touched, f"predict changed {', '.join(touched[:3])}: leave it as it is, or change it in observe.")


def input_(trial: PredictorTrial) -> None:
    """The methods do not change their arguments."""
    predictor = trial.ready()
    truth = trial.scenes.truth
    calls: list[tuple[str, tuple[Any, ...]]] = [
        ("predict", (truth.observation, SAMPLES, 3)),
        ("observe", (partly_known(truth),)),
    ]
    if trial.trainable:
        calls.insert(0, ("fit", (*trial.scenes.training(), 0)))
    for method, arguments in calls:
        if not hasattr(predictor, method):
            continue
        before = snapshot(arguments := copy.deepcopy(arguments))
        try:
            with global_randomness():
                guarded(predictor, method, *arguments)
        except MotionGymError:
            continue  # reported by the rule of that method
        broken_if(
            snapshot(arguments) != before, f"{method} changed its input: work on a copy, as observation.history.copy()."
        )


def buffer(trial: PredictorTrial) -> None:
    """A returned forecast does not change later."""
    predictor = trial.comparable()
    answer = trial.answer(predictor, trial.scenes.truth.observation)
    positions = answer.positions if isinstance(answer, Forecast) else answer
    before = positions.copy()
    trial.ask(predictor, seed=4)
    _ask_others(trial, predictor)
    broken_if(
        not np.array_equal(positions, before),
        "predict wrote into an array that it had returned before: return a new one each time.",
    )


def randomness(trial: PredictorTrial) -> None:
    """Method predict does not use the global generators of random, numpy and torch."""
    predictor, observation = trial.comparable(), copy.deepcopy(trial.scenes.truth.observation)
    with global_randomness() as used:
        guarded(predictor, "predict", observation, samples=SAMPLES, seed=3)
    broken_if(
        used,
        f"predict drew from, or seeded, the global generator of {' and '.join(used)}: use "
        "numpy.random.default_rng or torch.Generator, from the seed and the scene.",
    )


def seed(trial: PredictorTrial) -> None:
    """If samples differ, they depend on the seed; fixed modes have weights."""
    predictor = trial.comparable()
    first = trial.ask(predictor)
    broken_if(
        _drawn(first) and same(first, trial.ask(predictor, seed=5)),
        f"samples differ, but seeds 3 and 5 give the same ones: draw from {FROM_SEED}, or, if they are fixed modes, "
        "return a Forecast with weights.",
    )


def noise(trial: PredictorTrial) -> None:
    """Scenes that are asked one by one with the same seed do not get the same offsets, scaled or not."""
    predictor, truth = trial.comparable(), trial.scenes.truth
    sizes = np.diff(truth.observation.scene).tolist()
    pair = next(((a, b) for b, size in enumerate(sizes) for a in range(b) if sizes[a] == size), None)
    if pair is None:
        raise NotChecked("no two scenes have the same number of agents")
    seen = [pick_scenes(truth, [scene]).observation for scene in pair]
    first, second = (trial.ask(predictor, observation) for observation in seen)
    if not (_drawn(first) and _drawn(second)) or same(first, trial.ask(predictor, seen[0], seed=5)):
        return
    with global_randomness() as used:
        guarded(predictor, "predict", copy.deepcopy(seen[0]), samples=SAMPLES, seed=3)
    if used:
        return  # reported by rule `randomness`
    one, other = (f.positions.astype(np.float64) - f.positions.mean(axis=1, keepdims=True) for f in (first, second))
    pairs = [(a.ravel(), b.ravel()) for a, b in zip(one, other, strict=True) if a.any() and b.any()]
    broken_if(
        bool(pairs) and all(np.corrcoef(pair)[0, 1] > ALIKE for pair in pairs),
        f"two scenes that were asked with the same seed got the same noise, so that their errors would not be "
        f"independent, and intervals too narrow: draw from {FROM_SEED}.",
    )


def place(trial: PredictorTrial) -> None:
    """Forecasts begin where the agents are, also far from the origin."""
    predictor, observation = trial.comparable(), trial.scenes.truth.observation
    if hasattr(predictor, "know") or observation.images is not None:
        raise NotChecked("the scenes of an oracle and of a video cannot be moved")
    history = observation.history.copy()
    history[..., :2] += np.float32(FAR)
    try:
        first = trial.ask(predictor, dataclasses.replace(observation, history=history)).most_likely()[:, 0]
    except MotionGymError as error:
        raise NotChecked("predict gives no valid forecast of scenes far from the origin") from error
    off = np.linalg.norm(first - history[:, -1, :2], axis=-1)
    broken_if(
        (off > FAR / 10).any(),
        f"for agents at x = y = {FAR:,.0f} m, the first predicted position is {off.max():,.0f} m from the last "
        "observed one: if the network takes and gives offsets, add observation.xy[:, -1] (or the centre that was "
        "subtracted) to its outputs. A predictor that is made for one place alone: skip this rule, and say so.",
    )


def scenes(trial: PredictorTrial) -> None:
    """The forecasts of a scene do not depend on the other scenes of the observation."""
    predictor, observation = trial.comparable(), trial.scenes.truth.observation
    whole = trial.ask(predictor)
    remedy = "normalise, pool and attend within each scene (observation.scene, observation.scene_index)."
    limit = TOLERANCE + 4 * np.finfo(np.float32).eps * np.abs(observation.xy).max(axis=(1, 2))
    for parity in (0, 1) if trial.scenes.synthetic else ():
        rows = observation.scene_index % 2 == parity
        history = np.where(rows[:, None, None], observation.history, trial.scenes.other.observation.history)
        mixed = trial.ask(predictor, dataclasses.replace(observation, history=history))
        off = distances(whole, mixed)[rows]
        broken_if(
            (off > limit[rows]).any(),
            f"other positions in some scenes moved forecasts of other scenes by {off.max():.2g} m: {remedy}",
        )
    if _drawn(whole) or not same(whole, trial.ask(predictor, seed=5)):
        return  # one seed draws different noise for a batch of another size
    for scene in range(observation.scenes):
        rows = np.arange(*observation.scene[scene : scene + 2])
        alone = trial.ask(predictor, pick_scenes(trial.scenes.truth, [scene]).observation)
        off = distances(whole.take(rows), alone)
        broken_if(
            (off > limit[rows]).any(),
            f"alone, a scene is forecast {off.max():.2g} m from its forecast among {observation.scenes} scenes: "
            f"{remedy}",
        )


def check_signature(predictor: Any, method: str) -> None:
    """Raise CheckError if the predictor has a method that the library cannot call."""
    bound = getattr(predictor, method, None)
    if bound is None:
        return
    (arguments, keywords), expected = SIGNATURES[method], signature_of(method)
    broken_if(not callable(bound), f"{method} is a {type(bound).__name__}: make it a method {expected}.")
    try:
        signature = inspect.signature(bound)
    except ValueError:
        return  # a builtin without a signature
    try:
        signature.bind(*arguments)
        signature.bind(*arguments, **keywords)
    except TypeError:
        raise CheckError(f"{method}{signature} must be {expected}.") from None


def _ask_others(trial: PredictorTrial, predictor: Any) -> None:
    """Ask for other scenes, and for no scene; the library never asks for no scene, so predict may raise there."""
    trial.ask(predictor, trial.scenes.other.observation, seed=4)
    with np.errstate(all="ignore"):
        try:
            trial.answer(predictor, pick_scenes(trial.scenes.truth, slice(0, 0)).observation)
        except MotionGymError:
            return


def _drawn(forecast: Forecast) -> bool:
    """Whether samples differ and have no weights."""
    return forecast.weights is None and not (forecast.positions == forecast.positions[:, :1]).all()
