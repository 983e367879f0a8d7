"""The second world of the leak probe: a copy of a domain whose data is another one after a given time."""

from __future__ import annotations

import copy
import dataclasses
import functools
import types
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Domain, Recording, SpecError, Truth
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.windows import Tracks, windows_of

METRES = 5.0
"""Standard deviation of the noise on each coordinate."""
LEAVE, LOSE = 0.3, 0.5
"""Shares of the people who never appear again, and of those who are lost for two frames of every 12."""
SKIP = 0.1
"""Share of the frames that disappear."""
NEWCOMERS, NEW_FRAMES = 3, 16
LATEST = 2000
"""Steps of an episode within which the changes begin: an episode is played from its start, as states need."""


class Stage:
    """A copy of a domain whose data can be changed under its feet; whoever holds the copy sees the change.

    What is changed is the answer of the lowest method ``recordings`` among the domain's class and its bases, so that
    all that subclasses make of it, and windows and histories, follow. Time counts listed frames over all recordings of
    the split. Where windows do not follow from recordings, they are changed themselves, and time is their number.

    Args:
        domain: The domain; it is not changed.
        clock: ``stream`` or ``windows``. On the stream clock presence is changed too.
        split: The split that is played, the only one that is changed.
        seed: Source of the changes.

    Attributes:
        domain: The copy.
        seam: The method whose answer is changed.
        unprobed: What cannot be probed, and why.

    Raises:
        SpecError: the split has nobody to observe, or nothing that could be changed.
    """

    def __init__(self, domain: Domain, clock: str, split: str, seed: int):
        self.clock, self.split, self.seed = clock, split, seed
        self._original = domain
        self.domain: Any = copy.copy(domain)
        self._given: Sequence[Recording] = ()
        self._played: Sequence[Recording] = ()
        self._frames: list[np.ndarray] = []
        self._times: np.ndarray | None = None
        self._windows: Truth | None = None
        self._candidates = np.zeros(0, np.int64)
        self._definer: type | None = None
        self.unprobed: list[str] = []
        name = type(domain).__name__
        self.restore()
        if clock == "windows":
            self._windows = self.domain.windows(split)
            self._candidates = np.arange(self._windows.observation.scenes)
        for kind in type(domain).__mro__:
            if "recordings" in vars(kind) and kind not in (RecordedDomain, Domain) and not self._reach(kind):
                break
        self.seam = f"{name}.windows" if self._definer is None else f"{self._definer.__name__}.recordings"
        if self._definer is None:
            if clock == "stream":
                raise SpecError(f"{name} cannot be probed on the stream clock: no change of its recordings arrives.")
            self.unprobed.append(f"{name}.windows does not follow from recordings: how it makes them was not probed")
        if not len(self._candidates):
            raise SpecError(f"Split `{split}` of {domain!r} has nobody to observe: nothing to probe.")
        self.restore()
        if self._definer is not None and clock == "windows":
            self._times = self._window_times()

    def cuts(self, number: int) -> list[int]:
        """Times at which somebody is observed, one drawn in each of as many equal parts of the first 2000 steps."""
        parts = (np.arange(number) + np.random.default_rng(self.seed).random(number)) / number
        times = self._candidates[:LATEST]
        if len(self._candidates) > LATEST:
            self.unprobed.append(f"times after the first {LATEST} of {len(self._candidates)} steps")
        return sorted({int(t) for t in times[(parts * len(times)).astype(int)]})

    def restore(self) -> None:
        """Give the copy the data of the original again, without what it has cached."""
        kind = type(self._original)
        object.__setattr__(self.domain, "__class__", kind)
        state = {
            key: value
            for key, value in vars(copy.copy(self._original)).items()
            if not isinstance(getattr(kind, key, None), functools.cached_property)
        }
        vars(self.domain).clear()
        # Whatever points back to the original is to point to the copy.
        vars(self.domain).update(copy.deepcopy(state, {id(self._original): self.domain}))
        self._times = None

    def change(self, cut: int) -> bool:
        """Change all data after a time; whether windows are then still those of the recordings."""
        self.restore()
        if self._definer is not None:
            self._install(self._definer, lambda: self._other(cut))
        elif self._windows is not None:
            truth, windows = _other_windows(self._windows, cut, self._rng(cut)), self.domain.windows
            vars(self.domain)["windows"] = lambda split: truth if split == self.split else windows(split)
        if self._unchanged():
            self.unprobed.append(f"the change after time {cut} did not arrive: the domain keeps its data elsewhere")
        if self._definer is None or self.clock == "stream":
            return True
        self._times = self._window_times()
        return self._times is not None

    def observed(self, env: Any) -> int:
        """Time of what is observed now."""
        if self._times is None or env.clock.time >= len(self._times):
            return int(env.clock.time)
        return int(self._times[env.clock.time])

    def revealed(self, env: Any) -> int | None:
        """Time of the last data that the next step reveals; None where that is the time after the step."""
        if self.clock == "stream":
            return None
        return self.observed(env) + (1 if self._times is None else FUTURE)

    def _reach(self, kind: type) -> bool:
        """Whether a change of what ``kind.recordings`` gives arrives; if so, it is taken as the place of changes."""
        caught: list[Sequence[Recording]] = []

        def catch() -> Sequence[Recording]:
            caught[:] = [copy.deepcopy(kind.recordings(self.domain, self.split))]  # type: ignore[attr-defined]
            return copy.deepcopy(caught[0])

        self.restore()
        self._install(kind, catch)
        try:
            played = self.domain.recordings(self.split)
        except NotImplementedError:
            return False
        if not caught or len(caught[0]) != len(played):
            return False
        frames = [np.unique(r.frame) for r in played]
        if not all(np.isin(f, r.frame).all() for f, r in zip(frames, caught[0], strict=True)):
            return False
        times = self._window_times() if self.clock == "windows" else _observed(played)
        if times is None:
            return False
        # After the last frame there is nothing to change.
        times = times[times < sum(map(len, frames)) - 1]
        before = self._given, self._frames, self._played
        self._given, self._frames, self._played = caught[0], frames, played
        if len(times):
            self.restore()
            self._install(kind, lambda: self._other(int(times[0])))
            if self._unchanged():
                self._given, self._frames, self._played = before
                return False
        self._definer, self._candidates = kind, times
        return True

    def _unchanged(self) -> bool:
        """Whether what is played is still what the original gives."""
        if self._windows is not None:
            return bool(np.array_equal(self.domain.windows(self.split).future, self._windows.future))
        now = self.domain.recordings(self.split)
        return all(np.array_equal(a.xy, b.xy) for a, b in zip(self._played, now, strict=False))

    def _install(self, kind: type, recordings: Callable[[], Sequence[Recording]]) -> None:
        """Put a class right before ``kind`` in the copy's bases, whose ``recordings`` answers for it."""
        copied, split, top = self.domain, self.split, type(self._original)

        def answer(domain: Any, asked: str) -> Sequence[Recording]:
            return recordings() if domain is copied and asked == split else kind.recordings(domain, asked)  # type: ignore[attr-defined]

        body = {"recordings": answer, "__slots__": (), "__module__": kind.__module__}
        changed = types.new_class(kind.__name__, (kind,), exec_body=lambda names: names.update(body))
        if kind is not top:
            changed = types.new_class(top.__name__, (top, changed), exec_body=lambda n: n.update(__slots__=()))
        object.__setattr__(self.domain, "__class__", changed)

    def _window_times(self) -> np.ndarray | None:
        """[S] time of the last observed step of every window, if they are those of the recordings."""
        played = self.domain.recordings(self.split)
        starts = np.cumsum([0] + [len(np.unique(r.frame)) for r in played])
        ticked = []
        for recording, start in zip(played, starts, strict=False):
            tick = np.unique(recording.frame, return_inverse=True)[1].reshape(-1) + start
            ticked.append(dataclasses.replace(recording, xy=np.stack([tick, tick], axis=1).astype(np.float64)))
        if not ticked:
            return None
        least, stride = (getattr(self.domain, key, 1) for key in ("min_agents", "stride"))
        ours = windows_of(ticked, min_agents=least, stride=stride).observation
        theirs = self.domain.windows(self.split).observation
        if not (np.array_equal(ours.scene, theirs.scene) and np.array_equal(ours.agent, theirs.agent)):
            return None
        return ours.history[ours.scene[:-1], HISTORY - 1, 0].astype(np.int64)

    def _rng(self, cut: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, cut])

    def _other(self, cut: int) -> list[Recording]:
        """The recordings with another future after a time."""
        starts = np.cumsum([0] + [len(f) for f in self._frames])
        place = int(np.searchsorted(starts, cut, side="right")) - 1
        frame, rng, others = self._frames[place][cut - starts[place]], self._rng(cut), []
        for index, recording in enumerate(copy.deepcopy(self._given)):
            if index >= place:
                after = (recording.frame > frame) | (index > place)
                recording = _other_future(recording, after, self.clock == "stream", rng)
            others.append(recording)
        return others


def _observed(recordings: Sequence[Recording]) -> np.ndarray:
    """Times at which somebody has 8 observed steps."""
    parts, start = [np.zeros(0, np.int64)], 0
    for recording in recordings:
        tracks = Tracks.of(recording)
        parts.append(start + np.unique(tracks.tick[tracks.age >= HISTORY - 1]))
        start += tracks.ticks
    return np.concatenate(parts)


def _other_future(recording: Recording, after: np.ndarray, presence: bool, rng: np.random.Generator) -> Recording:
    """Move the rows ``after`` [R]; with ``presence``, also take away and add people and frames among them."""
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
    # The lowest free ids come first: a number that counts everybody, those to come included, then changes.
    new = np.setdiff1d(np.arange(ids[-1] + 1 + NEWCOMERS), ids)[:NEWCOMERS]
    walks = xy.mean(axis=0) + rng.normal(0, METRES, (len(later) * len(new), 2))
    frame = np.concatenate([frame[keep], np.repeat(later, len(new))])
    agent = np.concatenate([agent[keep], np.tile(new, len(later))])
    xy = np.concatenate([xy[keep], walks])
    order = np.lexsort((agent, frame))
    return dataclasses.replace(recording, frame=frame[order], agent=agent[order], xy=xy[order])


def _other_windows(truth: Truth, cut: int, rng: np.random.Generator) -> Truth:
    """Move the histories of the windows after a number, and the futures from that number on."""
    observation, window = truth.observation, truth.observation.scene_index
    history, future = observation.history.copy(), truth.future.copy()
    history[window > cut] += rng.normal(0, METRES, history[window > cut].shape).astype(np.float32)
    moved = (window >= cut)[:, None] & truth.known
    future[moved] += rng.normal(0, METRES, future[moved].shape).astype(np.float32)
    return Truth(future, truth.known, dataclasses.replace(observation, history=history))
