"""What an adapter is tried on: scenes to learn from and a short stream, and the trial that its rules take."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.checks.predictor_trials import PredictorTrial, synthetic
from motion_gym.contract import FUTURE, HISTORY, WINDOW, Recording, Truth
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.windows import Tracks, pick_scenes
from motion_gym.online.streams import Segment, Stream

LESSONS = 4
"""Scenes that most rules let an adapter observe, one by one."""
AT_ONCE = 8
"""Scenes of an observation where memory is measured."""
FRAMES, VISITS = 24, 2
"""Listed frames for which two people of a synthetic stream walk, and how many such pairs there are."""
SEGMENT = 4 * WINDOW
"""Most frames of a segment of a short stream."""


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


class AdapterTrial:
    """An adapter with the scenes that its rules teach it.

    Args:
        predictor: Trial of the adapter as a predictor.
        lessons: Scenes and a stream.
        source: The predictor that the adapter is put around; None where an instance is checked.
        around: Puts the adapter around a predictor.
    """

    def __init__(self, predictor: PredictorTrial, lessons: Lessons, source: Any, around: Callable[[Any], Any]):
        self.predictor, self.lessons, self.source, self.around = predictor, lessons, source, around

    def adapter(self) -> Any:
        """A copy of the adapter that has observed nothing; NotChecked if its forecasts cannot be compared."""
        self.predictor.comparable()
        return self.predictor.make()


def _each(truth: Truth) -> list[Truth]:
    return [pick_scenes(truth, [scene]) for scene in range(truth.observation.scenes)]


def _moved(truth: Truth, seed: int) -> Truth:
    """The same scenes elsewhere."""
    shift = np.random.default_rng(seed).normal(0, 1, 2).astype(np.float32)
    seen = truth.observation
    history = seen.history.copy()
    history[..., :2] += shift
    future = np.where(truth.known[..., None], truth.future + shift, truth.future)
    return Truth(future, truth.known, dataclasses.replace(seen, history=history))


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
