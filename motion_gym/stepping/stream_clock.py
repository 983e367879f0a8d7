"""The stream clock: each step is one listed frame, and ground truth is revealed after its last step."""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, DataError, Forecast, Observation, Recording, Truth
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.windows import Features, Tracks, positions_only
from motion_gym.metrics.errors import distance
from motion_gym.stepping.clocks import Settled, Step, extent_of
from motion_gym.stepping.outstanding import Outstanding

_NOBODY = Recording(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), 0.4)
_NO_ROWS = np.zeros(0, np.int64)
_AHEAD = np.arange(1, FUTURE + 1)


class StreamClock:
    """Each step is one listed frame; an agent is one unbroken track, from its 8th frame until it leaves.

    Frames without an agent that has 8 observed frames are skipped. An agent that is found again is a new agent. The
    ground truth of a scene is revealed once, after its last forecast step or when its last agent has left.

    Args:
        recordings: Recordings, replayed one after another.
        features: Function that gives the history of each agent (a domain's ``history``), or one for each recording.
        keep: Whether the ledger keeps settled forecasts; otherwise memory stays bounded.
        images: The image of the ground that observations of each recording hold, in the frame of the source.

    Attributes:
        times: [T] listed frames with an observed agent, counted over all recordings.
        count: Number of forecasts of a whole episode, one per agent and step.
        rewards: Whether rewards are computed; otherwise they are zero, which saves time.

    Raises:
        DataError: The recordings have different time steps.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        features: Features | Sequence[Features] = positions_only,
        keep: bool = True,
        images: Sequence[SceneImage | None] = (),
    ):
        pairs = itertools.zip_longest(recordings, images)
        parts = [Tracks.of(recording, image) for recording, image in pairs] or [Tracks.of(_NOBODY)]
        if len(steps := {p.dt for p in parts}) > 1:
            raise DataError(f"Recordings of one stream have the same step, but these have dt {sorted(steps)} seconds.")
        ticks = np.cumsum([0] + [p.ticks for p in parts])
        counts = np.cumsum([0] + [int(p.track.max(initial=-1)) + 1 for p in parts])
        shifts = np.cumsum([0] + [int(p.agent.max(initial=-1)) + 1 for p in parts])
        join = np.concatenate
        self.dt = parts[0].dt
        self.tracks = Tracks(
            join([p.tick + t for p, t in zip(parts, ticks, strict=False)]),
            join([p.track + c for p, c in zip(parts, counts, strict=False)]),
            join([p.agent + s for p, s in zip(parts, shifts, strict=False)]),
            join([p.xy for p in parts]),
            join([p.age for p in parts]),
            join([p.left for p in parts]),
            int(ticks[-1]),
            self.dt,
        )
        self._features = [features] * len(parts) if callable(features) else list(features)
        self._images = [part.image for part in parts]
        self._ends = ticks[1:].tolist()
        observable = np.flatnonzero(self.tracks.age >= HISTORY - 1)
        observable = observable[np.argsort(self.tracks.tick[observable], kind="stable")]
        self.times, start = np.unique(self.tracks.tick[observable], return_index=True)
        self.count = len(observable)
        rows = np.split(observable, start[1:]) if len(observable) else []
        self._rows = dict(zip(self.times.tolist(), rows, strict=True))
        # An agent has left at the first step without it.
        longest = np.minimum(np.maximum.reduceat(self.tracks.left[observable], start) + 1, FUTURE) if rows else start
        self._known_at = dict(zip(self._rows, (self.times + longest).tolist(), strict=True))
        # Numbered in the order of entry; a number that counts later agents would reveal the future.
        _, first, identity = np.unique(self.tracks.track[observable], return_index=True, return_inverse=True)
        self.size = len(first)
        self._identity = np.full(len(self.tracks.tick), -1)
        self._identity[observable] = np.argsort(np.argsort(first))[identity]
        self._place = np.zeros(self.size, np.int64)
        self.keep, self.rewards = keep, True
        self.reset()

    @property
    def extent(self) -> np.ndarray:
        """[2, 2], lowest and highest x and y."""
        return extent_of(self.tracks.xy)

    def name(self, identity: int) -> str:
        """``agent_N``."""
        return f"agent_{identity}"

    @property
    def time(self) -> int:
        """Listed frames since the first, over all recordings."""
        return int(self.times[self.at]) if self.at < len(self.times) else self.tracks.ticks

    @property
    def scenes(self) -> int:
        """Number of steps of an episode: one for each frame with an observed agent."""
        return len(self.times)

    @property
    def most(self) -> int:
        """Largest number of agents observed at once."""
        return max(map(len, self._rows.values()), default=0)

    @property
    def reach(self) -> float:
        """Largest absolute value of the histories of an episode."""
        return max((float(np.abs(self._history(int(time))).max()) for time in self.times), default=0.0)

    def reset(self, scene: int = 0) -> Step:
        """Go to a frame of ``times``, by default the first, with an empty ledger."""
        return self.resume(scene, Outstanding(self.keep))

    def resume(self, at: int, ledger: Outstanding) -> Step:
        """Go to ``times[at]`` with the ledger that this clock had there; the step holds the observation."""
        self.at, self.ledger = at, ledger
        return self._step(np.zeros(0), None)

    def step(self, forecast: Forecast) -> Step:
        """Store the forecasts, go to the next frame with an observed agent, and reveal the ground truth that is due."""
        self.ledger.store(self.time, self._observation, forecast)
        # If frames are skipped, all agents have left at the first skipped frame: nothing changes in the other ones.
        after = self.time + 1
        reward = self._reward(after) if self.rewards else np.zeros(len(self._observation))
        settled = self._settle(after)
        self.at += 1
        return self._step(reward, settled)

    def so_far(self) -> Truth | None:
        """The ground truth known so far of all scenes that wait; None if none waits."""
        times = [stored.made for stored in self.ledger]
        if not times:
            return None
        rows = [self._rows[made] for made in times]
        row = np.concatenate(rows)
        until = self.time - np.repeat(times, [len(own) for own in rows])
        return self.ledger.so_far(times, *self._future(row, until))

    def latest_paths(self) -> np.ndarray:
        """[A, K, 13, 2], the most recent outstanding forecasts, each after its last observed position."""
        waiting = list(self.ledger)
        if not waiting:
            return np.zeros((0, 1, FUTURE + 1, 2))
        rows, positions = self._rows[waiting[-1].made], waiting[-1].forecast.positions
        here = self.tracks.left[rows] >= self.time - waiting[-1].made
        start = np.broadcast_to(self.tracks.xy[rows, None, None], (*positions.shape[:2], 1, 2))
        return np.concatenate([start, positions], axis=2)[here]

    def _step(self, reward: np.ndarray, settled: Settled | None) -> Step:
        now = self.time
        rows = self._rows.get(now, _NO_ROWS)
        history = self._history(now)
        scene, time = (np.array([0, len(rows)]), np.array([now])) if len(rows) else (np.zeros(1, np.int64), rows)
        identity = self._identity[rows]
        for array in (history, scene, identity, time):
            array.flags.writeable = False  # the ledger keeps them as they are
        image = self._images[bisect_right(self._ends, now)] if len(rows) else None
        images = None if image is None else (image,)
        self._observation = Observation(history, scene, identity, self.dt, time, images)
        return Step(self._observation, identity, reward, settled)

    def _history(self, time: int) -> np.ndarray:
        """[A, 8, F] float32, what is observed at a frame."""
        rows = self._rows.get(time, _NO_ROWS)
        # All rows are of one recording.
        recording = bisect_right(self._ends, time) if len(rows) else 0
        return self._features[recording](*self.tracks.around(rows)).astype(np.float32)

    def _reward(self, now: int) -> np.ndarray:
        """[A] for the agents observed at the last step; see ``Step``."""
        waiting = list(self.ledger)
        parts = [self._rows[stored.made] for stored in waiting]
        before = self._identity[parts[-1]]
        self._place[before] = np.arange(len(before))
        rows, ahead = np.concatenate(parts), np.repeat([now - s.made for s in waiting], [len(p) for p in parts])
        points = np.concatenate([s.forecast.most_likely()[:, now - s.made - 1] for s in waiting])
        here = self.tracks.left[rows] >= ahead
        rows = rows[here]
        error = distance(points[here] - self.tracks.xy[rows + ahead[here]])
        owner = self._place[self._identity[rows]]
        count = np.bincount(owner, minlength=len(before))
        return -np.bincount(owner, error, minlength=len(before)) / np.maximum(count, 1)

    def _settle(self, now: int) -> Settled | None:
        """Settle the scenes without an unknown step; they are the oldest ones."""
        times, rows = [], []
        for stored in self.ledger:
            if now < self._known_at[stored.made]:
                break
            times.append(stored.made)
            rows.append(self._rows[stored.made])
        if not times:
            return None
        row = np.concatenate(rows)
        person = self.tracks.agent[row]
        forecast, truth = self.ledger.settle(times, *self._future(row, FUTURE), person)
        return Settled(forecast, truth, self._identity[row], person, self.tracks.tick[row])

    def _future(self, rows: np.ndarray, until: int | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions [A, 12, 2] after the given rows, valid where known, and known [A, 12], up to a step."""
        known = np.minimum(self.tracks.left[rows], until)[:, None] >= _AHEAD
        return self.tracks.xy[np.where(known, rows[:, None] + _AHEAD, rows[:, None])], known
