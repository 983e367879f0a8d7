"""The rules of the contract of adapters; ``motion_gym.checks.adapter_checks`` is the way in."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.checks.predictor_rules import COPIERS
from motion_gym.checks.predictor_trials import Report, partly_known, synthetic
from motion_gym.contract import FUTURE, HISTORY, WINDOW, Forecast, MotionGymError, Recording, Truth
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.windows import Tracks, pick_scenes
from motion_gym.online.evaluation import evaluate_online
from motion_gym.online.streams import Segment, Stream
from motion_gym.stepping.harness import ask, guarded, tell
from motion_gym.stepping.snapshot import changed, leaves, shared_arrays, snapshot

ADAPTER_RULES = {
    "adapter": "it has predict, observe and reset, and is told no domain",
    "given": "the predictor that it is put around stays as it was, whatever is observed",
    "learning": "predict learns nothing, also after something was observed",
    "unknown": "observe takes truth that is known in part or not at all, and what is not known does not matter",
    "order": "a forecast does not depend on truth that is told after it",
    "restart": "reset brings back the state of the start, bit by bit",
    "twins": "a copy or a pickle made midway goes on alike, and learns by itself",
    "memory": "what it holds does not grow without end",
    "online": "evaluate_online runs with it, also with a copy for each agent, and gives the same again",
}
LESSONS = 4
"""Scenes that most rules let an adapter observe, one by one."""
AT_ONCE = 8
"""Scenes of an observation where memory is measured."""
FIRST, LAST = 16, 128
"""Observations after which memory is first and last measured; it must have stopped growing by then."""
FRAMES, VISITS = 24, 2
"""Listed frames for which two people of a synthetic stream walk, and how many such pairs there are."""
SEGMENT = 4 * WINDOW
"""Most frames of a segment of a short stream."""
COST = 0.5
"""Seconds that an update is declared to take where the stream waits for nobody."""


@dataclass(frozen=True)
class Lessons:
    """What an adapter is tried on.

    Attributes:
        scenes: Scenes of which all is known, each a Truth, to be forecast and then told.
        like: Scenes of the same number of agents, without end: makes so many of them, from a seed.
        stream: A short stream.
    """

    scenes: Sequence[Truth]
    like: Callable[[int, int], Truth]
    stream: Stream


class Walkers(RecordedDomain):
    """People who walk in pairs, one pair after another, so that many forecasts of each are outstanding together.

    Args:
        further: Features besides x and y; they are constant.
    """

    name = "walkers"

    def __init__(self, further: int = 0):
        self.further = further
        self.feature_names = tuple(f"feature{number}" for number in range(further))

    def recordings(self, split: str) -> list[Recording]:
        """One recording."""
        rng = np.random.default_rng(0)
        turn = rng.uniform(0, 2 * np.pi, (VISITS, 1, 2)) + rng.normal(0, 0.1, (VISITS, FRAMES, 2)).cumsum(axis=1)
        xy = np.stack([np.cos(turn), np.sin(turn)], axis=-1).cumsum(axis=1) * 0.4 + rng.normal(size=(VISITS, 1, 2, 2))
        frame = np.repeat(np.arange(VISITS * FRAMES), 2)
        agent = frame // FRAMES * 2 + np.arange(len(frame)) % 2
        return [Recording(frame, agent, xy.reshape(-1, 2), self.dt, self.name)]

    def features(self, history: np.ndarray) -> np.ndarray:
        """Ones."""
        return np.ones((*history.shape[:2], self.further))


def synthetic_lessons(features: int, sizes: Sequence[int]) -> Lessons:
    """Scenes that need no data.

    Args:
        features: F.
        sizes: Agents of scenes that the predictor takes; these again and again.
    """
    scenes = synthetic([sizes[i % len(sizes)] for i in range(2 * LESSONS)], features, 1)
    return Lessons(
        _each(scenes),
        lambda number, seed: synthetic([2] * number, features, seed),
        _whole(Walkers(features - 2)),
    )


def domain_lessons(domain: Any) -> Lessons:
    """The first test windows of a domain, and two parts of its test stream."""
    test = domain.windows("test")
    scenes = np.arange(min(test.observation.scenes, 2 * LESSONS))
    sizes = np.diff(test.observation.scene)
    alike = np.flatnonzero(sizes == np.bincount(sizes).argmax())

    def like(number: int, seed: int) -> Truth:
        chosen = np.random.default_rng(seed).choice(alike, number)
        return _moved(pick_scenes(test, chosen), seed)

    return Lessons(_each(pick_scenes(test, scenes)), like, _whole(domain))


def apply_adapter_rules(adapter: Any, lessons: Lessons, report: Report) -> None:
    """Report every rule that an adapter breaks, but for what becomes of the predictor that it was put around.

    Args:
        adapter: It is not changed.
        lessons: What to try copies of it on.
        report: Called with the name of a rule and what is wrong.
    """
    if hasattr(adapter, "know"):
        report("adapter", "know shows it the domain, and with it the future: leave it out, and learn in observe.")
        return
    rules: dict[str, Callable[..., None]] = {
        "learning": _learning,
        "unknown": _unknown,
        "order": _order,
        "restart": _restart,
        "twins": _twins,
        "memory": _memory,
        "online": _online,
    }
    for rule, apply in rules.items():
        try:
            apply(functools.partial(copy.deepcopy, adapter), lessons, report)
        except MotionGymError as error:
            report(rule, str(error))


def apply_given_rule(make: Callable[[], Any], source: Any, lessons: Lessons, report: Report) -> None:
    """Report what an adapter does to the predictor that it is put around.

    Args:
        make: Puts the adapter around ``source``.
        source: The predictor.
        lessons: What to let the adapter observe.
        report: Called with the name of the rule and what is wrong.
    """
    ask(source, lessons.scenes[0].observation)  # what it keeps for later, it keeps now
    before = snapshot(source)
    adapter = make()
    with contextlib.suppress(MotionGymError):  # which other rules report
        _taught(adapter, lessons.scenes)
    touched = changed(before, snapshot(source))
    if touched:
        report("given", f"it changed {', '.join(touched[:3])} of the predictor that it was put around: {_COPY}")
        return
    own = {path: leaf for path, leaf in leaves(source) if isinstance(leaf, np.ndarray) and leaf.flags.writeable}
    kept = [leaf for _, leaf in leaves(adapter) if isinstance(leaf, np.ndarray)]
    common = [path for path, leaf in own.items() if any(np.may_share_memory(leaf, other) for other in kept)]
    if common:
        report("given", f"it shares the memory of {', '.join(common[:3])} with the predictor it was given: {_COPY}")


_COPY = "keep copy.deepcopy(of), and change that."


def _learning(make: Callable[[], Any], lessons: Lessons, report: Report) -> None:
    adapter = make()
    _taught(adapter, lessons.scenes[:LESSONS])
    remedy = "learn in observe alone, from truth that was told after the forecast was scored."
    first = _asked(adapter, lessons.scenes[0])
    held = snapshot(adapter)
    for scene in lessons.scenes:
        _asked(adapter, scene)
    touched = changed(held, snapshot(adapter))
    again = _asked(adapter, lessons.scenes[0])
    if first != again or touched:
        what = f"predict changed {', '.join(touched[:3])}" if touched else "predict asked again answered otherwise"
        report("learning", f"after something was observed, {what}: {remedy}")


def _unknown(make: Callable[[], Any], lessons: Lessons, report: Report) -> None:
    known, other = make(), make()
    for number, scene in enumerate(lessons.scenes):
        before = _asked(known, lessons.scenes[0])
        for part in _parts(scene, number):
            tell(known, part)
            noise = np.random.default_rng(number).normal(0, 9, part.future.shape).astype(np.float32)
            tell(other, dataclasses.replace(part, future=np.where(part.known[..., None], part.future, noise)))
            one, two = (_asked(adapter, lessons.scenes[0]) for adapter in (known, other))
            if one != two:
                report("unknown", "what stands where truth.known is False changes forecasts: leave these steps out.")
                return
            if not part.known.any() and one != before:
                report("unknown", "a truth of which nothing is known changed forecasts: learn nothing from it.")
                return
            before = one


def _parts(scene: Truth, number: int) -> list[Truth]:
    """A truth of which nothing, a part of some agents, or ever more is known."""
    steps = np.arange(FUTURE)
    upto = [dataclasses.replace(scene, known=scene.known & (steps < n)) for n in (0, 1, 5, FUTURE)]
    return [partly_known(scene), *upto][number % 2 :: 2]


def _order(make: Callable[[], Any], lessons: Lessons, report: Report) -> None:
    adapter = make()
    first = _taught(adapter, lessons.scenes)
    for cut in (0, len(lessons.scenes) // 2):
        other = [*lessons.scenes[:cut], *(_moved_on(s, cut) for s in lessons.scenes[cut:])]
        second = _taught(make(), other)
        if first[: cut + 1] != second[: cut + 1]:
            report(
                "order",
                f"with another truth of scene {cut} and those after it, forecasts that were made before it was told "
                "are others: know nothing but by observe, and keep what was observed in the object, not in its class.",
            )
            return


def _restart(make: Callable[[], Any], lessons: Lessons, report: Report) -> None:
    adapter = make()
    _asked(adapter, lessons.scenes[0])  # what it keeps for later, it keeps now
    begun = snapshot(adapter)
    first = _taught(adapter, lessons.scenes)
    guarded(adapter, "reset")
    _asked(adapter, lessons.scenes[0])
    restarted = snapshot(adapter)
    touched = sorted(path for path in begun.keys() | restarted.keys() if begun.get(path) != restarted.get(path))
    if touched:
        report(
            "restart",
            f"after reset, {', '.join(touched[:3])} {'are' if len(touched) > 1 else 'is'} not as at the start: bring "
            "back weights, states, counts and the optimiser, best by a copy that was made in the constructor.",
        )
    elif _taught(adapter, lessons.scenes) != first:
        report("restart", "after reset, the same scenes gave other forecasts: draw from a seed that reset brings back.")


def _twins(make: Callable[[], Any], lessons: Lessons, report: Report) -> None:
    half, rest = lessons.scenes[:LESSONS], lessons.scenes[LESSONS:] or lessons.scenes
    adapter = make()
    _taught(adapter, half)
    forecasts = {}
    for how, copied in COPIERS:
        try:
            twin = copied(adapter)
        except Exception as error:
            report("twins", f"a {how} made midway raised {type(error).__name__}: {error}.")
            return
        common = shared_arrays(adapter, twin)
        before = [_asked(adapter, scene) for scene in rest]
        forecasts[how] = _taught(twin, rest)
        if common or before != [_asked(adapter, scene) for scene in rest]:
            what = f" ({', '.join(common[:3])})" if common else ""
            report("twins", f"what a {how} made midway observes changes the original{what}: copy arrays too.")
            return
    own = _taught(adapter, rest)
    for how, answers in forecasts.items():
        if answers != own:
            report("twins", f"a {how} made midway, taught the same, forecasts otherwise: carry all state over.")


def _memory(make: Callable[[], Any], lessons: Lessons, report: Report) -> None:
    adapter, before, least, after, most = make(), 0, 0, 0, 0
    for number in range(1, LAST + 1):
        tell(adapter, lessons.like(AT_ONCE, number))
        if number >= FIRST and number & (number - 1) == 0:  # powers of two
            _asked(adapter, lessons.scenes[0])
            before, least, after, most = after, most, number * AT_ONCE, _bytes(adapter)
            if before and most <= least:
                return
    report(
        "memory",
        f"it holds {least:,} bytes after {before} scenes, and {most:,} after {after}: keep a number of scenes that is "
        "fixed, at most some hundred, as in collections.deque(maxlen=64).",
    )


def _online(make: Callable[[], Any], lessons: Lessons, report: Report) -> None:
    played, adapter = lessons.stream, make()
    evaluate_online(adapter, played, labels="stepwise", scope="agent")
    one, two = (evaluate_online(adapter, played, scope="place", realtime=True, cost=COST) for _ in range(2))
    if not np.array_equal(one.values, two.values):
        report("online", "on the same stream, with the same cost of updates, scores differ: leave clocks alone.")


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


def _each(truth: Truth) -> list[Truth]:
    return [pick_scenes(truth, [scene]) for scene in range(truth.observation.scenes)]


def _bytes(thing: Any) -> int:
    """What an object holds; of what is no array, the number of things."""
    sizes = (leaf.nbytes if isinstance(leaf, np.ndarray) else _length(leaf) for _, leaf in leaves(thing))
    return sum(sizes)


def _length(leaf: Any) -> int:
    return len(leaf) if isinstance(leaf, (str, bytes)) else 8


def _moved(truth: Truth, seed: int) -> Truth:
    """The same scenes elsewhere."""
    shift = np.random.default_rng(seed).normal(0, 1, 2).astype(np.float32)
    seen = truth.observation
    history = seen.history.copy()
    history[..., :2] += shift
    future = np.where(truth.known[..., None], truth.future + shift, truth.future)
    return Truth(future, truth.known, dataclasses.replace(seen, history=history))


def _moved_on(scene: Truth, seed: int) -> Truth:
    """The same history with another future."""
    noise = np.random.default_rng(seed).normal(0, 1, scene.future.shape).cumsum(axis=1).astype(np.float32)
    return dataclasses.replace(scene, future=scene.future + noise * scene.known[..., None])


def _whole(domain: Any) -> Stream:
    """Two segments of a domain's test split; the first one from where there is the first whole window."""
    first, frames = None, 0
    for recording in domain.recordings("test"):
        tracks = Tracks.of(recording)
        ticks = tracks.tick[(tracks.age >= HISTORY - 1) & (tracks.left >= FUTURE)]
        if first is None and len(ticks):
            first = frames + int(ticks.min()) - HISTORY + 1
        frames += tracks.ticks
    start = (first or 0) // WINDOW * WINDOW
    half = max(min((frames - start) // 2, SEGMENT), min(frames - start, 2 * WINDOW))
    ends = (start, start + half, min(start + 2 * half, frames))
    return Stream([Segment(domain, *pair) for pair in itertools.pairwise(ends) if pair[0] < pair[1]])
