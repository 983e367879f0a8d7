"""The changed data of the leak probe: a copy of a domain whose recordings differ after a chosen time."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_gym.contract import HISTORY, Domain, Recording, SpecError
from motion_gym.data.windows import Tracks, frames_by_step

METRES = 5.0
"""Standard deviation of the noise on each coordinate."""
LEAVE, LOSE = 0.3, 0.5
"""Shares of people who never appear again, and of people who are lost for two frames of every 12."""
SKIP = 0.1
"""Share of frames that disappear."""
NEWCOMERS, NEW_FRAMES = 3, 16
LATEST = 2000
"""Steps of an episode within which the changes begin; every play starts at the first step."""


class Stage:
    """A copy of a domain whose recordings can be changed while a predictor or an environment holds the copy.

    Method ``recordings`` of the copy returns the recordings that are stored here. Time counts listed frames over all
    recordings of the split.

    Args:
        domain: The domain; it is not changed.
        clock: ``stream`` or ``windows``. On the stream clock presence is changed too.
        split: The split that is played; other splits are not changed.
        seed: Seed of the changes.

    Attributes:
        domain: The copy.
        unprobed: Parts that cannot be probed, and why.

    Raises:
        SpecError: The split has no agent to observe.
    """

    def __init__(self, domain: Domain, clock: str, split: str, seed: int):
        self.clock, self.split, self.seed = clock, split, seed
        self.domain: Any = copy.copy(domain)
        domain.windows(split)  # fills the caches of the original, and refuses an unknown split
        self._original = list(domain.recordings(split))
        self._frames = [frames_by_step(recording) for recording in self._original]
        self.unprobed: list[str] = []
        self.change(None)
        self._windows = self.domain.windows(split).observation.time if clock == "windows" else None
        times = _observed(self._original) if self._windows is None else self._windows
        # After the last frame there is nothing to change.
        self._candidates = np.unique(times[times < sum(map(len, self._frames)) - 1])
        if not len(self._candidates):
            raise SpecError(f"Split `{split}` of {domain!r} has no agent to observe: there is nothing to probe.")

    def cuts(self, number: int) -> list[int]:
        """Times with an observation, one drawn in each of ``number`` equal parts of the first 2000 steps."""
        parts = (np.arange(number) + np.random.default_rng(self.seed).random(number)) / number
        times = self._candidates[:LATEST]
        if len(self._candidates) > LATEST:
            self.unprobed.append(f"times after the first {LATEST} of {len(self._candidates)} steps")
        return sorted({int(t) for t in times[(parts * len(times)).astype(int)]})

    def change(self, cut: int | None) -> None:
        """Change all data of the copy after a time; None restores the original data."""
        recordings, original = self._original if cut is None else self._changed(cut), type(self.domain).recordings
        vars(self.domain).pop("_made_once", None)
        vars(self.domain)["recordings"] = lambda split: (
            copy.deepcopy(recordings) if split == self.split else original(self.domain, split)
        )

    def time(self, env: Any) -> int:
        """Time of the current frame or window; after the last window, the number of frames."""
        if self._windows is None:
            return int(env.clock.time)
        number = int(env.clock.time)
        return int(self._windows[number]) if number < len(self._windows) else sum(map(len, self._frames))

    def _changed(self, cut: int) -> list[Recording]:
        """The recordings with a different future after a time."""
        starts = np.cumsum([0] + [len(frames) for frames in self._frames])
        place = int(np.searchsorted(starts, cut, side="right")) - 1
        frame, rng = self._frames[place][cut - starts[place]], np.random.default_rng([self.seed, cut])
        others = list(self._original[:place])
        for index, recording in enumerate(self._original[place:], place):
            after = (recording.frame > frame) | (index > place)
            others.append(_other_future(recording, after, self.clock == "stream", rng))
        return others


def _observed(recordings: Sequence[Recording]) -> np.ndarray:
    """Times at which an agent has 8 observed steps."""
    parts, start = [np.zeros(0, np.int64)], 0
    for recording in recordings:
        tracks = Tracks.of(recording)
        parts.append(start + np.unique(tracks.tick[tracks.age >= HISTORY - 1]))
        start += tracks.ticks
    return np.concatenate(parts)


def _other_future(recording: Recording, after: np.ndarray, presence: bool, rng: np.random.Generator) -> Recording:
    """Move the rows ``after`` [R]; with ``presence``, also remove and add people and frames among them."""
    frame, agent, xy = recording.frame, recording.agent, recording.xy
    xy = np.where(after[:, None], xy + rng.normal(0, METRES, xy.shape), xy)
    if not presence:
        return dataclasses.replace(recording, xy=xy)
    ids, person = np.unique(agent, return_inverse=True)
    person = person.reshape(-1)
    frames, tick = np.unique(frame, return_inverse=True)
    fate, beat = rng.random(len(ids))[person], rng.integers(0, 12, len(ids))[person]
    lost = (fate < LEAVE + LOSE) & ((tick.reshape(-1) + beat) % 12 < 2)
    skipped = rng.random(len(frames)) < SKIP
    keep = ~(after & ((fate < LEAVE) | lost | skipped[tick.reshape(-1)]))
    later = frames[np.isin(frames, frame[after]) & ~skipped]
    step = int(np.diff(frames).min(initial=max(1, int(frames[-1] - frames[0]))))
    later = np.concatenate([later, frames[-1] + step * np.arange(1, NEW_FRAMES + 1)])
    # The lowest free ids come first, which changes every number that counts agents of the future, too.
    new = np.setdiff1d(np.arange(ids[-1] + 1 + NEWCOMERS), ids)[:NEWCOMERS]
    walks = xy.mean(axis=0) + rng.normal(0, METRES, (len(later) * len(new), 2))
    frame = np.concatenate([frame[keep], np.repeat(later, len(new))])
    agent = np.concatenate([agent[keep], np.tile(new, len(later))])
    xy = np.concatenate([xy[keep], walks])
    order = np.lexsort((agent, frame))
    return dataclasses.replace(recording, frame=frame[order], agent=agent[order], xy=xy[order])
