"""The rules of the adapter contract; each takes an AdapterTrial and raises."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_gym.checks.adapter_trials import LESSONS, AdapterTrial, known_up_to, moved_on
from motion_gym.checks.predictor_method_rules import pickled_copy
from motion_gym.checks.predictor_trials import partly_known
from motion_gym.checks.report import CheckError, NotChecked, Rules, broken_if
from motion_gym.contract import FUTURE, MotionGymError, Truth
from motion_gym.online.evaluation import evaluate_online
from motion_gym.stepping.harness import ask, guarded, tell
from motion_gym.stepping.snapshot import changed, leaves, shared_arrays, snapshot

MEASURED = (16, 32, 64, 128)
"""Numbers of observations after which memory is measured; it must have stopped growing by the last one."""
BATCH = 8
"""Scenes of an observation while memory is measured."""
COST = 0.5
"""Declared seconds of an update in realtime."""


def adapter(trial: AdapterTrial) -> None:
    """An adapter has predict, observe and reset, and no know."""
    instance = trial.make()
    missing = [method for method in ("predict", "observe", "reset") if not hasattr(instance, method)]
    broken_if(missing, f"it has no {', '.join(missing)}: define what motion_gym.contract asks for.")
    broken_if(
        hasattr(instance, "know"),
        "know gives it the domain, and with it the future: leave it out, and learn in observe.",
    )


def given(trial: AdapterTrial) -> None:
    """The adapted predictor does not change, whatever is observed."""
    source, remedy = trial.source, "keep copy.deepcopy(of), and change that."
    if source is None:
        raise NotChecked("an instance was given, and not its class")
    trial.comparable()
    ask(source, trial.lessons[0].observation)  # fills caches before the snapshot
    before = snapshot(source)
    adapter = trial.around(source)
    with contextlib.suppress(MotionGymError):  # reported by other rules
        _taught(adapter, trial.lessons)
    touched = changed(before, snapshot(source))
    broken_if(touched, f"it changed {', '.join(touched[:3])} of the predictor that it adapts: {remedy}")
    arrays = [leaf for _, leaf in leaves(adapter) if isinstance(leaf, np.ndarray)]
    common = [
        path
        for path, leaf in leaves(source)
        if isinstance(leaf, np.ndarray) and leaf.flags.writeable
        if any(np.may_share_memory(leaf, array) for array in arrays)
    ]
    broken_if(common, f"it shares the memory of {', '.join(common[:3])} with the predictor that it adapts: {remedy}")


def learning(trial: AdapterTrial) -> None:
    """Method predict learns nothing, also after an observation."""
    adapter, scenes = trial.comparable(), trial.lessons
    _taught(adapter, scenes[:LESSONS])
    first, before = _forecast(adapter, scenes[0]), snapshot(adapter)
    for scene in scenes:
        _forecast(adapter, scene)
    touched = changed(before, snapshot(adapter))
    if first != _forecast(adapter, scenes[0]) or touched:
        fault = f"predict changed {', '.join(touched[:3])}" if touched else "predict gave two answers to one question"
        raise CheckError(
            f"after an observation, {fault}: learn in observe alone, from truth that is revealed after the forecast is "
            "scored."
        )


def unknown(trial: AdapterTrial) -> None:
    """Method observe takes partly known truth and ignores unknown steps."""
    adapter, other, scenes = trial.comparable(), trial.comparable(), trial.lessons
    for number, scene in enumerate(scenes):
        before = _forecast(adapter, scenes[0])
        parts = [partly_known(scene), *(known_up_to(scene, step) for step in (0, 1, 5, FUTURE))]
        for part in parts[number % 2 :: 2]:
            tell(adapter, part)
            noise = np.random.default_rng(number).normal(0, 9, part.future.shape).astype(np.float32)
            tell(other, dataclasses.replace(part, future=np.where(part.known[..., None], part.future, noise)))
            after = _forecast(adapter, scenes[0])
            broken_if(
                after != _forecast(other, scenes[0]),
                "values where truth.known is False change forecasts: leave these steps out.",
            )
            broken_if(
                not part.known.any() and after != before,
                "a truth without a known step changed forecasts: learn nothing from it.",
            )
            before = after


def order(trial: AdapterTrial) -> None:
    """A forecast does not depend on truth that is observed after it."""
    scenes = trial.lessons
    first = _taught(trial.comparable(), scenes)
    for cut in (0, len(scenes) // 2):
        second = _taught(trial.comparable(), [*scenes[:cut], *(moved_on(s, cut) for s in scenes[cut:])])
        broken_if(
            first[: cut + 1] != second[: cut + 1],
            f"with another truth of scene {cut} and later scenes, forecasts made before its observation differ: learn "
            "in observe alone, and keep what is learned in the object, not in its class.",
        )


def restart(trial: AdapterTrial) -> None:
    """Method reset restores the initial state, bit by bit."""
    adapter, scenes = trial.comparable(), trial.lessons
    _forecast(adapter, scenes[0])  # fills caches before the snapshot
    before = snapshot(adapter)
    first = _taught(adapter, scenes)
    guarded(adapter, "reset")
    _forecast(adapter, scenes[0])
    after = snapshot(adapter)
    touched = sorted(path for path in before.keys() | after.keys() if before.get(path) != after.get(path))
    broken_if(
        touched,
        f"after reset, {', '.join(touched[:3])} {'are' if len(touched) > 1 else 'is'} not as at the start: restore "
        "weights, states, counts and the optimiser, best from a copy made in the constructor.",
    )
    broken_if(
        _taught(adapter, scenes) != first,
        "after reset, the same scenes gave other forecasts: draw from a seed that reset restores.",
    )


def twins(trial: AdapterTrial) -> None:
    """A copy or a pickle made midway learns in the same way, and independently."""
    half, rest = trial.lessons[:LESSONS], trial.lessons[LESSONS:] or trial.lessons
    adapter = trial.comparable()
    _taught(adapter, half)
    forecasts = {}
    for name, copier in (("copy", copy.deepcopy), ("pickle", pickled_copy)):
        try:
            twin = copier(adapter)
        except Exception as error:
            raise CheckError(f"a {name} made midway raised {type(error).__name__}: {error}.") from error
        common = shared_arrays(adapter, twin)
        before = [_forecast(adapter, scene) for scene in rest]
        forecasts[name] = _taught(twin, rest)
        if common or before != [_forecast(adapter, scene) for scene in rest]:
            arrays = f" ({', '.join(common[:3])})" if common else ""
            raise CheckError(f"observations of a {name} made midway change the original{arrays}: copy arrays too.")
    own = _taught(adapter, rest)
    for name, answers in forecasts.items():
        broken_if(
            answers != own, f"a {name} made midway forecasts differently after the same scenes: copy the whole state."
        )


def memory(trial: AdapterTrial) -> None:
    """The state does not grow without bound."""
    adapter, sizes = trial.comparable(), [0]
    for number in range(1, MEASURED[-1] + 1):
        tell(adapter, trial.like(BATCH, number))
        if number in MEASURED:
            _forecast(adapter, trial.lessons[0])
            sizes.append(_size(adapter))
            if number > MEASURED[0] and sizes[-1] <= sizes[-2]:
                return
    raise CheckError(
        f"it holds {sizes[-2]:,} bytes after {MEASURED[-2] * BATCH} scenes, and {sizes[-1]:,} after "
        f"{MEASURED[-1] * BATCH}: keep a fixed number of scenes, at most some hundred, as in "
        "collections.deque(maxlen=64)."
    )


def online(trial: AdapterTrial) -> None:
    """Function evaluate_online runs with it, also with a copy for each agent, and its scores repeat."""
    adapter, stream = trial.comparable(), trial.stream
    evaluate_online(adapter, stream, labels="stepwise", scope="agent")
    first, again = (evaluate_online(adapter, stream, scope="place", realtime=True, cost=COST) for _ in range(2))
    broken_if(
        not np.array_equal(first.values, again.values),
        "on the same stream, with the same cost of updates, scores differ: do not read clocks.",
    )


ADAPTER_RULES: Rules = {
    rule.__name__: rule for rule in (adapter, given, learning, unknown, order, restart, twins, memory, online)
}


def _taught(adapter: Any, scenes: Sequence[Truth]) -> list[bytes]:
    """The forecast of each scene, made before its truth is observed."""
    forecasts = []
    for scene in scenes:
        forecasts.append(_forecast(adapter, scene))
        tell(adapter, scene)
    return forecasts


def _forecast(adapter: Any, scene: Truth) -> bytes:
    """All bits of the forecast of a scene."""
    forecast = ask(adapter, scene.observation)
    return forecast.positions.tobytes() + (b"" if forecast.weights is None else forecast.weights.tobytes())


def _size(thing: Any) -> int:
    """Bytes of the arrays and texts in an object, and 8 for each further leaf."""
    values = (leaf for _, leaf in leaves(thing))
    return sum(len(x) if isinstance(x, (str, bytes)) else x.nbytes if isinstance(x, np.ndarray) else 8 for x in values)
