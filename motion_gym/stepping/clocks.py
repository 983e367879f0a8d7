"""Two clocks: what is observed, forecast and revealed, step by step, as arrays.

The windows clock goes from window to window and reveals each truth at once; the stream clock goes from frame to frame
and reveals the truth as it happens. Both store a forecast before they reveal anything, and neither ever hands out a
position before its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, DataError, Forecast, Observation, Recording, Truth
from motion_gym.data.windows import Features, Tracks, offsets, pick_scenes, positions_only, stack
from motion_gym.metrics.errors import distance, mean_over_known


@dataclass(frozen=True, eq=False)
class Settled:
    """Forecasts about which nothing more will be revealed: matured, or censored because their agent left.

    Attributes:
        forecast: The stored forecasts, M agents.
        truth: What happened, with the observations they answered; its scenes are the forecasts made at one time.
        identity: [M] int64, the clock's id of each agent (see ``Clock``).
        person: [M] int64, whom each agent is, as in ``domain.windows``: an agent that is lost and found again is two
            agents but one person.
        made: [M] int64, clock time at which each forecast was made.
    """

    forecast: Forecast
    truth: Truth
    identity: np.ndarray
    person: np.ndarray
    made: np.ndarray

    @property
    def matured(self) -> np.ndarray:
        """[M] bool, True where all 12 steps happened."""
        return np.all(self.truth.known, axis=1)


@dataclass(frozen=True, eq=False)
class Step:
    """What one step of a clock reveals.

    Attributes:
        observation: The agents observed now; A = 0 when the episode is over.
        identity: [A] int64, the clock's id of each of them.
        reward: [P] float64, for each agent of the observation *before*: minus the mean error, in metres, of the points
            that became known, over that agent's outstanding forecasts (most likely sample).
        settled: Forecasts that were settled on the way.
    """

    observation: Observation
    identity: np.ndarray
    reward: np.ndarray
    settled: Settled


class Clock(Protocol):
    """A clock. Agents have ids 0 .. ``size`` - 1, in the order in which they enter, that never return."""

    size: int

    @property
    def time(self) -> int:
        """Number of the current window, or of the current listed frame."""
        ...

    @property
    def extent(self) -> np.ndarray:
        """[2, 2], lowest and highest x and y that can occur, for a fixed scale."""
        ...

    def name(self, identity: int) -> str:
        """Name of an agent, as environments use it; ends in its number in the observation."""
        ...

    def reset(self) -> Step:
        """Go to the beginning."""
        ...

    def step(self, forecast: Forecast) -> Step:
        """Store the forecasts of the agents observed now, go on, reveal."""
        ...


class WindowsClock:
    """Each step is the next window; an agent is one (window, agent) pair and lives for one step.

    Args:
        truth: The windows, as ``domain.windows(split)`` gives them.
    """

    def __init__(self, truth: Truth):
        self.truth = truth
        self.size = len(truth.future)
        self._at = 0
        self._window = truth.observation.scene_index

    @property
    def extent(self) -> np.ndarray:
        """[2, 2], lowest and highest x and y."""
        seen = [self.truth.observation.xy.reshape(-1, 2), self.truth.future[self.truth.known]]
        return _extent(np.concatenate(seen))

    def name(self, identity: int) -> str:
        """``window_W_agent_N``."""
        return f"window_{self._window[identity]}_agent_{self.truth.observation.agent[identity]}"

    @property
    def time(self) -> int:
        """Number of the current window."""
        return self._at

    def reset(self) -> Step:
        """Go to the first window."""
        self._at = 0
        return self._reveal(np.zeros(0), self._settle(pick_scenes(self.truth, slice(0, 0)), Forecast(_NOTHING), 0))

    def step(self, forecast: Forecast) -> Step:
        """Score the forecasts of this window and go to the next."""
        truth = pick_scenes(self.truth, slice(self.time, self.time + 1))
        settled = self._settle(truth, forecast, self.time)
        error = distance(forecast.most_likely().astype(np.float64) - truth.future)
        reward = -np.nan_to_num(mean_over_known(error, truth.known))
        self._at += 1
        return self._reveal(reward, settled)

    def _reveal(self, reward: np.ndarray, settled: Settled) -> Step:
        observation = pick_scenes(self.truth, slice(self.time, self.time + 1)).observation
        return Step(observation, self._identity(self.time), reward, settled)

    def _settle(self, truth: Truth, forecast: Forecast, window: int) -> Settled:
        identity = self._identity(window)[: len(truth.future)]
        return Settled(forecast, truth, identity, truth.observation.agent, np.full(len(identity), window))

    def _identity(self, window: int) -> np.ndarray:
        scene = self.truth.observation.scene
        last = min(window, len(scene) - 1)
        return np.arange(scene[last], scene[min(last + 1, len(scene) - 1)])


class StreamClock:
    """Each step is one listed frame; an agent is one unbroken track, from its 8th frame until it leaves.

    Frames at which nobody has 8 observed frames are passed over. An agent that is found again is a new one.

    Args:
        recordings: Replayed one after another.
        features: Gives the history of each agent (a domain's ``history``): one for all recordings, or one for each.

    Raises:
        DataError: the recordings have different time steps.
    """

    def __init__(self, recordings: Sequence[Recording], features: Features | Sequence[Features] = positions_only):
        parts = [Tracks.of(recording) for recording in recordings] or [Tracks.of(_NOBODY)]
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
        self._ends = ticks[1:]
        observable = np.flatnonzero(self.tracks.age >= HISTORY - 1)
        observable = observable[np.argsort(self.tracks.tick[observable], kind="stable")]
        self._times, start = np.unique(self.tracks.tick[observable], return_index=True)
        self._rows = np.split(observable, start[1:]) if len(observable) else []
        # Numbered as they enter: a number that counted those yet to come would tell the future.
        _, first, identity = np.unique(self.tracks.track[observable], return_index=True, return_inverse=True)
        self.size = len(first)
        self._identity = np.full(len(self.tracks.tick), -1)
        self._identity[observable] = np.argsort(np.argsort(first))[identity]
        self._place = np.zeros(self.size, np.int64)
        self._nothing = self._settle(np.zeros(0, np.int64), Forecast(_NOTHING))
        self.reset()

    @property
    def extent(self) -> np.ndarray:
        """[2, 2], lowest and highest x and y."""
        return _extent(self.tracks.xy)

    def name(self, identity: int) -> str:
        """``agent_N``."""
        return f"agent_{identity}"

    @property
    def time(self) -> int:
        """Listed frames since the first, over all recordings."""
        return int(self._times[self._at]) if self._at < len(self._times) else self.tracks.ticks

    def reset(self) -> Step:
        """Go to the first frame at which somebody is observed."""
        self._at = 0
        self._row = np.zeros(0, np.int64)
        self._forecast = Forecast(_NOTHING)
        return self._reveal(np.zeros(0), self._nothing)

    def step(self, forecast: Forecast) -> Step:
        """Store the forecasts, go on to the next frame at which somebody is observed, and reveal what happened."""
        now = self._rows[self._at]
        before = self._identity[now]
        self._place[before] = np.arange(len(before))
        self._row = np.concatenate([self._row, now])
        self._forecast = Forecast.join([self._forecast, forecast])
        time, self._at = self.time, self._at + 1
        reward, settled_row, settled_forecast = np.zeros(len(now)), [], []
        while time < self.time and len(self._row):
            time += 1
            ahead = time - self.tracks.tick[self._row]
            alive = self.tracks.left[self._row] >= ahead
            point = self._forecast.most_likely()[alive, ahead[alive] - 1]
            error = distance(point - self.tracks.xy[self._row[alive] + ahead[alive]])
            owner = self._place[self._identity[self._row[alive]]]
            total = np.bincount(owner, error, minlength=len(now))
            reward -= total / np.maximum(np.bincount(owner, minlength=len(now)), 1)
            done = ~alive | (ahead == FUTURE)
            settled_row.append(self._row[done])
            settled_forecast.append(self._forecast.take(done))
            self._row, self._forecast = self._row[~done], self._forecast.take(~done)
        rows = np.concatenate(settled_row) if settled_row else np.zeros(0, np.int64)
        return self._reveal(reward, self._settle(rows, Forecast.join(settled_forecast)) if len(rows) else self._nothing)

    @property
    def outstanding(self) -> tuple[Forecast, np.ndarray, np.ndarray]:
        """Stored forecasts that are not settled, the ids of their agents and the times they were made."""
        return self._forecast, self._identity[self._row], self.tracks.tick[self._row]

    @property
    def times(self) -> np.ndarray:
        """[T] the times at which somebody is observed."""
        return self._times

    def truth_at(self, at: int) -> Truth:
        """The scene observed at ``times[at]`` with all of its future; agents have their ids.

        For a harness that keeps forecasts by itself. Only ``observation`` of it has happened by then.
        """
        rows = self._rows[at]
        return self._truth(rows, np.array([0, len(rows)]))

    def persons_at(self, at: int) -> np.ndarray:
        """[A] whom the agents observed at ``times[at]`` are, see ``Settled``."""
        return self.tracks.agent[self._rows[at]]

    def latest_paths(self) -> np.ndarray:
        """[A, K, 13, 2], the most recent outstanding forecasts, each from the position it started at."""
        _, _, made = self.outstanding
        latest = made == made.max(initial=-1)
        positions = self._forecast.positions[latest]
        start = np.broadcast_to(self.tracks.xy[self._row[latest], None, None], (*positions.shape[:2], 1, 2))
        return np.concatenate([start, positions], axis=2)

    def _reveal(self, reward: np.ndarray, settled: Settled) -> Step:
        rows = self._rows[self._at] if self._at < len(self._rows) else np.zeros(0, np.int64)
        identity = self._identity[rows]
        scene = np.array([0, len(rows)] if len(rows) else [0])
        return Step(self._truth(rows, scene).observation, identity, reward, settled)

    def _settle(self, rows: np.ndarray, forecast: Forecast) -> Settled:
        made = self.tracks.tick[rows]
        order = np.lexsort((rows, made))
        rows, made = rows[order], made[order]
        scene = np.concatenate([np.flatnonzero(np.diff(made, prepend=-1)), [len(made)]])
        truth = self._truth(rows, scene)
        return Settled(forecast.take(order), truth, truth.observation.agent, self.tracks.agent[rows], made)

    def _truth(self, rows: np.ndarray, scene: np.ndarray) -> Truth:
        """Observation and truth of rows, which are all of one recording: who leaves it is settled before the next."""
        recording = np.searchsorted(self._ends, self.tracks.tick[rows[:1]], side="right")
        features = self._features[recording[0] if len(recording) else 0]
        return self.tracks.truth(rows, scene, self._identity[rows], features)


class Ledger:
    """Every settled forecast of an episode; it outlives the agents, so that no score is lost when one leaves."""

    def __init__(self) -> None:
        self.entries: list[Settled] = []

    def add(self, settled: Settled) -> None:
        """Keep what was settled in a step."""
        if len(settled.made):
            self.entries.append(settled)

    def __len__(self) -> int:
        """Number of settled forecasts."""
        return sum(len(e.made) for e in self.entries)

    @property
    def matured(self) -> int:
        """Number of forecasts whose 12 steps all happened."""
        return sum(int(e.matured.sum()) for e in self.entries)

    @property
    def censored(self) -> int:
        """Number of forecasts whose agent left before their last step."""
        return len(self) - self.matured

    def read(self) -> tuple[Forecast, Truth]:
        """All settled forecasts with their truths, stacked.

        Raises:
            ValueError: nothing was settled yet.
        """
        if not self.entries:
            raise ValueError("The ledger is empty: step the environment until a forecast is settled.")
        return Forecast.join([e.forecast for e in self.entries]), stack([e.truth for e in self.entries])

    def matured_only(self) -> tuple[Forecast, Truth]:
        """The forecasts that have matured, with their truths; agents are persons, as in ``domain.windows``.

        Raises:
            ValueError: nothing was settled yet.
        """
        forecast, truth = self.read()
        keep = np.flatnonzero(truth.known.all(axis=1))
        observation = truth.observation
        sizes = np.bincount(observation.scene_index[keep], minlength=observation.scenes)
        person = np.concatenate([e.person for e in self.entries])
        chosen = Observation(
            observation.history[keep],
            offsets(sizes[sizes > 0]),
            person[keep],
            observation.dt,
            None if observation.time is None else observation.time[sizes > 0],
        )
        return forecast.take(keep), Truth(truth.future[keep], truth.known[keep], chosen)


_NOBODY = Recording(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), 0.4)
_NOTHING = np.zeros((0, 1, FUTURE, 2), np.float32)


def _extent(xy: np.ndarray) -> np.ndarray:
    return np.stack([xy.min(axis=0), xy.max(axis=0)]) if len(xy) else np.array([[0.0, 0.0], [1.0, 1.0]])
