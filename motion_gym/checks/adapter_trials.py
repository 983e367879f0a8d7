"""The trial that the rules of adapters take: scenes to learn from, and a short stream."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from motion_gym.checks.predictor_trials import PredictorTrial, synthetic
from motion_gym.contract import FUTURE, HISTORY, WINDOW, Recording, Truth
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.windows import Tracks, pick_scenes
from motion_gym.online.streams import Segment, Stream

LESSONS = 4
"""Number of scenes that most rules let an adapter observe, one by one."""
FRAMES, VISITS = 24, 2
"""Listed frames for which a pair of people of a synthetic stream walks, and number of pairs."""
SEGMENT = 4 * WINDOW
"""Most frames of a segment of the stream."""


class Walkers(RecordedDomain):
    """People who walk in pairs, one pair after another, so that many forecasts of each are outstanding together.

    Args:
        further: Number of features besides x and y; they are constant.
    """

    name = "walkers"

    def __init__(self, further: int = 0):
        self.further = further
        self.feature_names = tuple(f"feature{number}" for number in range(further))

    def recordings(self, split: str) -> list[Recording]:
        """One recording, the same for every split."""
        rng = np.random.default_rng(0)
        turn = rng.uniform(0, 2 * np.pi, (VISITS, 1, 2)) + rng.normal(0, 0.1, (VISITS, FRAMES, 2)).cumsum(axis=1)
        xy = np.stack([np.cos(turn), np.sin(turn)], axis=-1).cumsum(axis=1) * 0.4 + rng.normal(size=(VISITS, 1, 2, 2))
        frame = np.repeat(np.arange(VISITS * FRAMES), 2)
        agent = frame // FRAMES * 2 + np.arange(len(frame)) % 2
        return [Recording(frame, agent, xy.reshape(-1, 2), self.dt, self.name)]

    def features(self, history: np.ndarray) -> np.ndarray:
        """Ones."""
        return np.ones((*history.shape[:2], self.further))


class AdapterTrial(PredictorTrial):
    """An adapter, and the scenes and the stream that the rules let it learn from.

    Args:
        make: Makes a copy of the adapter that has observed nothing.
        domain: Domain that gives scenes and stream; None for synthetic ones.
        source: Predictor that the adapter adapts; None if an instance of the adapter is checked.
        around: Makes an adapter around a predictor.
    """

    def __init__(
        self,
        make: Callable[[], Any],
        domain: Any = None,
        source: Any = None,
        around: Callable[[Any], Any] = lambda of: of,
    ):
        super().__init__(make, domain)
        self.source, self.around = source, around

    @functools.cached_property
    def lessons(self) -> list[Truth]:
        """Complete scenes, each to be forecast and then observed."""
        if self.domain is None:
            sizes = itertools.cycle(np.diff(self._observation.scene).tolist())
            truth = synthetic(list(itertools.islice(sizes, 2 * LESSONS)), self._observation.history.shape[2], 1)
        else:
            truth = pick_scenes(self.domain.windows("test"), slice(0, 2 * LESSONS))
        return [pick_scenes(truth, [scene]) for scene in range(truth.observation.scenes)]

    def like(self, number: int, seed: int) -> Truth:
        """Complete scenes, all with the same number of agents; every seed gives different scenes."""
        if self.domain is None:
            return synthetic([2] * number, self._observation.history.shape[2], seed)
        test, rng = self.domain.windows("test"), np.random.default_rng(seed)
        sizes = np.diff(test.observation.scene)
        truth = pick_scenes(test, rng.choice(np.flatnonzero(sizes == np.bincount(sizes).argmax()), number))
        shift = np.random.default_rng(seed).normal(0, 1, 2).astype(np.float32)
        history = truth.observation.history.copy()
        history[..., :2] += shift
        future = np.where(truth.known[..., None], truth.future + shift, truth.future)
        return Truth(future, truth.known, dataclasses.replace(truth.observation, history=history))

    @functools.cached_property
    def stream(self) -> Stream:
        """Two short segments of the test split; the first one starts with the first complete window."""
        domain = Walkers(self._observation.history.shape[2] - 2) if self.domain is None else self.domain
        first, frames = None, 0
        for recording in domain.recordings("test"):
            tracks = Tracks.of(recording)
            ticks = tracks.tick[tracks.complete()]
            if first is None and len(ticks):
                first = frames + int(ticks.min()) - HISTORY + 1
            frames += tracks.ticks
        start = (first or 0) // WINDOW * WINDOW
        half = max(min((frames - start) // 2, SEGMENT), min(frames - start, 2 * WINDOW))
        ends = (start, start + half, min(start + 2 * half, frames))
        return Stream([Segment(domain, *pair) for pair in itertools.pairwise(ends) if pair[0] < pair[1]])

    @property
    def _observation(self) -> Any:
        return self.scenes.truth.observation


def moved_on(scene: Truth, seed: int) -> Truth:
    """The same history with a different future."""
    noise = np.random.default_rng(seed).normal(0, 1, scene.future.shape).cumsum(axis=1).astype(np.float32)
    return dataclasses.replace(scene, future=scene.future + noise * scene.known[..., None])


def known_up_to(scene: Truth, step: int) -> Truth:
    """The same truth, known up to a step."""
    return dataclasses.replace(scene, known=scene.known & (np.arange(FUTURE) < step))
