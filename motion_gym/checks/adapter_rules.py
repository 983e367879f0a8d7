"""The rules of the adapter contract; each takes an AdapterTrial and raises."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from motion_gym.checks.adapter_trials import AT_ONCE, LESSONS, AdapterTrial
from motion_gym.checks.predictor_method_rules import COPIERS
from motion_gym.checks.predictor_trials import partly_known
from motion_gym.checks.report import CheckError, NotChecked, Rule, broken_if
from motion_gym.contract import FUTURE, Forecast, MotionGymError, Truth
from motion_gym.online.evaluation import evaluate_online
from motion_gym.stepping.harness import ask, guarded, tell
from motion_gym.stepping.snapshot import changed, leaves, shared_arrays, snapshot

FIRST, LAST = 16, 128
"""Observations after which memory is first and last measured; it must have stopped growing by then."""
COST = 0.5
"""Seconds that an update is declared to take where the stream waits for nobody."""


def adapter(trial: AdapterTrial) -> None:
    """It has predict, observe and reset, and is told no domain."""
    broken_if(
        hasattr(trial.predictor.make(), "know"),
        "know shows it the domain, and with it the future: leave it out, and learn in observe.",
    )


def given(trial: AdapterTrial) -> None:
    """The predictor that it is put around stays as it was, whatever is observed."""
    source, remedy = trial.source, "keep copy.deepcopy(of), and change that."
    if source is None:
        raise NotChecked("an instance was given: give the class to have this rule checked")
    trial.predictor.comparable()
    ask(source, trial.lessons.scenes[0].observation)  # what it keeps for later, it keeps now
    before = snapshot(source)
    adapter = trial.around(source)
    with contextlib.suppress(MotionGymError):  # which other rules report
        _taught(adapter, trial.lessons.scenes)
    touched = changed(before, snapshot(source))
    broken_if(touched, f"it changed {', '.join(touched[:3])} of the predictor that it was put around: {remedy}")
    own = {path: leaf for path, leaf in leaves(source) if isinstance(leaf, np.ndarray) and leaf.flags.writeable}
    kept = [leaf for _, leaf in leaves(adapter) if isinstance(leaf, np.ndarray)]
    common = [path for path, leaf in own.items() if any(np.may_share_memory(leaf, other) for other in kept)]
    broken_if(common, f"it shares the memory of {', '.join(common[:3])} with the predictor it was given: {remedy}")


def learning(trial: AdapterTrial) -> None:
    """Predict learns nothing, also after something was observed."""
    adapter, scenes = trial.adapter(), trial.lessons.scenes
    _taught(adapter, scenes[:LESSONS])
    first, held = _asked(adapter, scenes[0]), snapshot(adapter)
    for scene in scenes:
        _asked(adapter, scene)
    touched = changed(held, snapshot(adapter))
    if first != _asked(adapter, scenes[0]) or touched:
        seen = f"predict changed {', '.join(touched[:3])}" if touched else "predict asked again answered otherwise"
        raise CheckError(
            f"after something was observed, {seen}: learn in observe alone, from truth that was told after the "
            "forecast was scored."
        )


def unknown(trial: AdapterTrial) -> None:
    """Observe takes truth that is known in part or not at all, and what is not known does not matter."""
    known, other, scenes = trial.adapter(), trial.adapter(), trial.lessons.scenes
    for number, scene in enumerate(scenes):
        before = _asked(known, scenes[0])
        for part in _parts(scene, number):
            tell(known, part)
            noise = np.random.default_rng(number).normal(0, 9, part.future.shape).astype(np.float32)
            tell(other, dataclasses.replace(part, future=np.where(part.known[..., None], part.future, noise)))
            after = _asked(known, scenes[0])
            broken_if(
                after != _asked(other, scenes[0]),
                "what stands where truth.known is False changes forecasts: leave these steps out.",
            )
            broken_if(
                not part.known.any() and after != before,
                "a truth of which nothing is known changed forecasts: learn nothing from it.",
            )
            before = after


def order(trial: AdapterTrial) -> None:
    """A forecast does not depend on truth that is told after it."""
    scenes = trial.lessons.scenes
    first = _taught(trial.adapter(), scenes)
    for cut in (0, len(scenes) // 2):
        second = _taught(trial.adapter(), [*scenes[:cut], *(_moved_on(s, cut) for s in scenes[cut:])])
        broken_if(
            first[: cut + 1] != second[: cut + 1],
            f"with another truth of scene {cut} and those after it, forecasts that were made before it was told "
            "are others: know nothing but by observe, and keep what was observed in the object, not in its class.",
        )


def restart(trial: AdapterTrial) -> None:
    """Reset brings back the state of the start, bit by bit."""
    adapter, scenes = trial.adapter(), trial.lessons.scenes
    _asked(adapter, scenes[0])  # what it keeps for later, it keeps now
    begun = snapshot(adapter)
    first = _taught(adapter, scenes)
    guarded(adapter, "reset")
    _asked(adapter, scenes[0])
    restarted = snapshot(adapter)
    touched = sorted(path for path in begun.keys() | restarted.keys() if begun.get(path) != restarted.get(path))
    broken_if(
        touched,
        f"after reset, {', '.join(touched[:3])} {'are' if len(touched) > 1 else 'is'} not as at the start: bring "
        "back weights, states, counts and the optimiser, best by a copy that was made in the constructor.",
    )
    broken_if(
        _taught(adapter, scenes) != first,
        "after reset, the same scenes gave other forecasts: draw from a seed that reset brings back.",
    )


def twins(trial: AdapterTrial) -> None:
    """A copy or a pickle made midway goes on alike, and learns by itself."""
    scenes = trial.lessons.scenes
    half, rest = scenes[:LESSONS], scenes[LESSONS:] or scenes
    adapter = trial.adapter()
    _taught(adapter, half)
    forecasts = {}
    for how, copied in COPIERS.items():
        try:
            twin = copied(adapter)
        except Exception as error:
            raise CheckError(f"a {how} made midway raised {type(error).__name__}: {error}.") from error
        common = shared_arrays(adapter, twin)
        before = [_asked(adapter, scene) for scene in rest]
        forecasts[how] = _taught(twin, rest)
        if common or before != [_asked(adapter, scene) for scene in rest]:
            which = f" ({', '.join(common[:3])})" if common else ""
            raise CheckError(f"what a {how} made midway observes changes the original{which}: copy arrays too.")
    own = _taught(adapter, rest)
    for how, answers in forecasts.items():
        broken_if(answers != own, f"a {how} made midway, taught the same, forecasts otherwise: carry all state over.")


def memory(trial: AdapterTrial) -> None:
    """What it holds does not grow without end."""
    adapter, before, least, after, most = trial.adapter(), 0, 0, 0, 0
    for number in range(1, LAST + 1):
        tell(adapter, trial.lessons.like(AT_ONCE, number))
        if number >= FIRST and number & (number - 1) == 0:  # powers of two
            _asked(adapter, trial.lessons.scenes[0])
            before, least, after, most = after, most, number * AT_ONCE, _bytes(adapter)
            if before and most <= least:
                return
    raise CheckError(
        f"it holds {least:,} bytes after {before} scenes, and {most:,} after {after}: keep a number of scenes that is "
        "fixed, at most some hundred, as in collections.deque(maxlen=64)."
    )


def online(trial: AdapterTrial) -> None:
    """evaluate_online runs with it, also with a copy for each agent, and gives the same again."""
    played, adapter = trial.lessons.stream, trial.adapter()
    evaluate_online(adapter, played, labels="stepwise", scope="agent")
    one, two = (evaluate_online(adapter, played, scope="place", realtime=True, cost=COST) for _ in range(2))
    broken_if(
        not np.array_equal(one.values, two.values),
        "on the same stream, with the same cost of updates, scores differ: leave clocks alone.",
    )


ADAPTER_METHODS = ("predict", "observe", "reset")
ADAPTER_RULES: Mapping[str, Rule] = MappingProxyType(
    {rule.__name__: rule for rule in (adapter, given, learning, unknown, order, restart, twins, memory, online)}
)


def _parts(scene: Truth, number: int) -> list[Truth]:
    """A truth of which nothing, a part of some agents, or ever more is known."""
    steps = np.arange(FUTURE)
    upto = [dataclasses.replace(scene, known=scene.known & (steps < n)) for n in (0, 1, 5, FUTURE)]
    return [partly_known(scene), *upto][number % 2 :: 2]


def _taught(adapter: Any, scenes: Sequence[Truth]) -> list[bytes]:
    """The forecast of each scene, before its truth was told."""
    forecasts = []
    for scene in scenes:
        forecasts.append(_asked(adapter, scene))
        tell(adapter, scene)
    return forecasts


def _asked(adapter: Any, scene: Truth) -> bytes:
    """All bits of a forecast."""
    forecast: Forecast = ask(adapter, scene.observation)
    weights = b"" if forecast.weights is None else forecast.weights.tobytes()
    return forecast.positions.tobytes() + weights


def _bytes(thing: Any) -> int:
    """What an object holds; of what is no array, the number of things."""
    held = (leaf for _, leaf in leaves(thing))
    return sum(len(x) if isinstance(x, (str, bytes)) else x.nbytes if isinstance(x, np.ndarray) else 8 for x in held)


def _moved_on(scene: Truth, seed: int) -> Truth:
    """The same history with another future."""
    noise = np.random.default_rng(seed).normal(0, 1, scene.future.shape).cumsum(axis=1).astype(np.float32)
    return dataclasses.replace(scene, future=scene.future + noise * scene.known[..., None])
