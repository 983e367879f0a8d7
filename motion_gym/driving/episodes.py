"""Episodes: moments of a recording at which one vehicle becomes the ego vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, DataError, Domain, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.data.windows import Tracks
from motion_gym.driving.footprints import states_of
from motion_gym.driving.paths import Path
from motion_gym.driving.proposals import DT

STEPS = 14
"""Steps of an episode, 5.6 s."""
NEAR, NEAR_SECONDS = 80.0, 4.0
"""Vehicles are in an episode if they are as near to the ego vehicle as it drives in 4 s, and at most 80 m."""
SUBSTEPS = 4
"""Steps of the simulation in each step of an episode."""
OTHERS: Mapping[str, str] = {
    "react": "the others are simulated on from their histories, and react to the ego vehicle",
    "replay": "the others drive as they did in the recording, whatever the ego vehicle does",
}


class World(Protocol):
    """The vehicles around the ego vehicle. Rows of vehicles that have left are NaN."""

    def advance(self, ego: np.ndarray) -> np.ndarray:
        """States [4, N, 4] of the others after each 0.1 s, while the ego vehicle drives through states [4, 4]."""

    def future(self, ego: np.ndarray) -> np.ndarray:
        """Positions [N, 12, 2] at the next 12 steps, if the ego vehicle drives through states [48, 4]."""


@dataclass(frozen=True, eq=False)
class Episode:
    """A moment of a recording, with the ego vehicle and the vehicles around it.

    Attributes:
        number: Number of the moment in the split.
        agent: [N] int64, ids of the others in the recording.
        history: [N, 8, 2] float64, metres, of the others.
        future: [N, T, 2] recorded positions of the others after the moment; NaN where they have left.
        ego_history: [8, 2] of the ego vehicle.
        path: Its path.
        s: Distance along the path at the moment, metres.
        d: Lateral position, metres.
        speed: Along the path, m/s.
    """

    number: int
    agent: np.ndarray
    history: np.ndarray
    future: np.ndarray
    ego_history: np.ndarray
    path: Path
    s: float
    d: float
    speed: float


class Episodes:
    """All moments of a split at which an episode can begin.

    Moments are one length of an episode apart, so that episodes do not overlap in time, and a predictor that learns in
    one episode has seen nothing of later ones.

    Args:
        domain: A domain with ``ego_path``.
        split: Split of the domain.
        steps: Steps of an episode.

    Raises:
        SpecError: Nobody can drive in the domain.
        DataError: The split has no vehicle that is observed for a whole episode.
    """

    def __init__(self, domain: Domain, split: str = "test", steps: int = STEPS):
        self.domain, self.steps = domain, steps
        if not hasattr(domain, "ego_path"):
            raise SpecError(
                f"Domain `{spec_of(domain)}` has no roads to drive on (method `ego_path`): use highway, as "
                "highway:style=calm."
            )
        self._candidates: list[tuple[Tracks, int, np.ndarray]] = []
        for recording in domain.recordings(split):
            tracks = Tracks.of(recording)
            fits = (tracks.age >= HISTORY - 1) & (tracks.left >= steps)
            for tick in range(HISTORY - 1, tracks.ticks, steps):
                rows = np.flatnonzero(fits & (tracks.tick == tick))
                rows = np.array([row for row in rows if self._path(tracks, int(row)) is not None], np.int64)
                if len(rows):
                    self._candidates.append((tracks, tick, rows))
        if not self._candidates:
            raise DataError(
                f"Split `{split}` of {spec_of(domain)} has no vehicle that is observed for {HISTORY + steps} steps: "
                "give the domain more `seconds` or `runs`."
            )

    def __len__(self) -> int:
        return len(self._candidates)

    @property
    def most(self) -> int:
        """Largest number of others in an episode, or more."""
        return max(
            int(((tracks.tick == tick) & (tracks.age >= HISTORY - 1)).sum()) - 1 for tracks, tick, _ in self._candidates
        )

    def draw(self, count: int, seed: int) -> list[Episode]:
        """Draw episodes, in the order of time.

        Raises:
            SpecError: There are not as many.
        """
        if count > len(self):
            raise SpecError(
                f"`episodes={count}`: {spec_of(self.domain)} has {len(self)} moments at which an episode can begin: "
                "ask for fewer, or give the domain more `runs`."
            )
        rng = np.random.default_rng([seed, count])
        return [self.episode(int(n), rng) for n in np.sort(rng.permutation(len(self))[:count])]

    def episode(self, number: int, rng: np.random.Generator) -> Episode:
        """The episode of a moment; the ego vehicle is drawn among those that can be it."""
        tracks, tick, rows = self._candidates[number]
        row = int(rng.choice(rows))
        path: Any = self._path(tracks, row)
        there = np.flatnonzero((tracks.tick == tick) & (tracks.age >= HISTORY - 1))
        away = np.linalg.norm(tracks.xy[there] - tracks.xy[row], axis=1)
        there = there[(away < min(NEAR, NEAR_SECONDS * path.speed)) & (there != row)]
        past, ahead = np.arange(1 - HISTORY, 1), np.arange(1, self.steps + FUTURE + 1)
        known = ahead <= tracks.left[there, None]
        future = np.where(known[..., None], tracks.xy[np.where(known, there[:, None] + ahead, there[:, None])], np.nan)
        own = tracks.xy[row + past]
        along, across = path.local(own)
        return Episode(
            number, tracks.agent[there], tracks.xy[there[:, None] + past], future, own, path, float(along[-1]),
            float(across[-1]), float(max((along[-1] - along[-2]) / DT, 0.0)),
        )  # fmt: skip

    def _path(self, tracks: Tracks, row: int) -> Path | None:
        first = row - int(tracks.age[row])
        return self.domain.ego_path(tracks.xy[first : row + int(tracks.left[row]) + 1])  # type: ignore[attr-defined, no-any-return]


class Replay:
    """A world in which the others drive as they did in the recording."""

    def __init__(self, episode: Episode):
        path = np.concatenate([episode.history, episode.future], axis=1)
        self._xy, self._at = path[:, HISTORY - 1 :], 0
        self._heading = states_of(episode.history, DT)[:, -1, 2]

    def advance(self, ego: np.ndarray) -> np.ndarray:
        """The others at 0.1 s steps, between recorded positions in straight lines; see ``World``."""
        start, end = self._xy[:, self._at], self._xy[:, self._at + 1]
        state = states_of(np.stack([start, end], axis=1), DT, self._heading)[:, 0]
        self._heading = np.where(np.isnan(end[:, 0]), self._heading, state[:, 2])
        self._at += 1
        share = np.arange(1, SUBSTEPS + 1)[:, None, None] / SUBSTEPS
        return np.concatenate([start + share * (end - start), np.tile(state[:, 2:], (SUBSTEPS, 1, 1))], axis=-1)

    def future(self, ego: np.ndarray) -> np.ndarray:
        """The recorded positions; see ``World``."""
        return self._xy[:, self._at + 1 : self._at + 1 + FUTURE]


def world_of(domain: Any, episode: Episode, others: str, ego: np.ndarray) -> World:
    """The world of an episode, by a name of ``OTHERS``, with the ego vehicle in a state [4]."""
    if others == "replay" or not len(episode.history):
        return Replay(episode)
    return domain.reacting_world(episode.history, ego, episode.path.points)  # type: ignore[no-any-return]
