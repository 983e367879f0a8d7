"""One episode: the ego vehicle drives, the others move, and everything that happens is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Observation
from motion_gym.driving import footprints
from motion_gym.driving.episodes import SUBSTEPS, Episode, World, world_of
from motion_gym.driving.footprints import LENGTH
from motion_gym.driving.planner import KEEPING, SHORTEST_TTC, composite, is_comfortable, stays_on
from motion_gym.driving.proposals import DT, ROLLING, Ego, Plans, state_of, states_on

LONGEST_TTC = 10.0
"""Times to collision are cut off here, seconds."""
NEAR_MISS = 1.0
"""Seconds; an episode without collision in which the time to collision is shorter has a near miss."""
IDS = 1000
"""Ids of the agents of an episode begin at this multiple of its number; that of the ego vehicle is the last one."""


class Run:
    """The state of an episode between two steps.

    Attributes:
        episode: The episode.
        world: The vehicles around the ego vehicle.
        ego: The ego vehicle.
        step: Number of the step.
        arrived: Whether the ego vehicle is at the end of its path.
        collision: Whether it has collided.
        passed: [N] whether a vehicle has hit it from behind while it kept its lane, which ends nothing.
        states: The last states [4, 4] of the ego vehicle, one each 0.1 s.
        others: The last states [N, 4] of the others; NaN for those that have left.
    """

    def __init__(self, domain: Any, episode: Episode, others: str):
        self.episode, self.step = episode, 0
        self.ego = Ego(episode.s, episode.speed, episode.d)
        self.states = state_of(self.ego, episode.path)[None]
        self.world: World = world_of(domain, episode, others, self.states[-1])
        self.others = footprints.states_of(episode.history, DT)[:, -1]
        self.track = [episode.history[:, n] for n in range(HISTORY)]
        """[N, 2] positions of the others at each step, the first 8 before the episode."""
        self.own = list(episode.ego_history)
        self.arrived = self.collision = False
        self.on_road, self.passed = True, np.zeros(len(episode.history), bool)
        self.ttc: list[float] = []
        """Shortest time to collision in each step, seconds."""
        self.driven = [(self.ego.acceleration, *self.states[-1, 2:])]
        """Acceleration, heading and speed after each step."""

    @property
    def there(self) -> np.ndarray:
        """Numbers of the others that have not left."""
        return np.flatnonzero(~np.isnan(self.others[:, 0]))

    def observation(self) -> Observation:
        """The last 8 steps of the others that are here, and of the ego vehicle, which is the last agent."""
        here, first = self.there, self.episode.number * IDS
        others = np.stack(self.track[-HISTORY:], axis=1)[here]
        history = np.concatenate([others, np.array(self.own[-HISTORY:])[None]]).astype(np.float32)
        agent = np.append(first + here, first + IDS - 1)
        return Observation(history, np.array([0, len(history)]), agent, DT, np.array([first + self.step]))

    def forecast_paths(self, positions: np.ndarray) -> np.ndarray:
        """[N, 13, 2] positions now and as forecast [N or N + 1, 12, 2], of the others that are here."""
        here = self.there
        return np.concatenate([self.others[here, None, :2], positions[: len(here)].astype(np.float64)], axis=1)

    def follow(self, plans: Plans, number: int) -> None:
        """Drive the first step of a proposal."""
        egos = [plans.after(number, DT * n / SUBSTEPS) for n in range(1, SUBSTEPS + 1)]
        self._advance(egos[-1], np.array([state_of(ego, self.episode.path) for ego in egos]))

    def steer(self, acceleration: float, steering: float) -> None:
        """Drive a step with an acceleration, m/s^2, and a steering angle, radians to the left: a bicycle model."""
        path, state, states = self.episode.path, self.states[-1].copy(), []
        slip, dt = np.arctan(np.tan(steering) / 2), DT / SUBSTEPS
        for _ in range(SUBSTEPS):
            course = state[2] + slip
            later = max(state[3] + acceleration * dt, 0.0)
            state = state + np.array([
                state[3] * np.cos(course) * dt, state[3] * np.sin(course) * dt,
                state[3] * np.sin(slip) / (LENGTH / 2) * dt, later - state[3],
            ])  # fmt: skip
            states.append(state)
        s, d = path.local(state[:2])
        off = state[2] - path.heading(s)
        speed = float(state[3] * np.cos(off))
        drift = float(state[3] * np.sin(off) / max(min(1.0, speed / ROLLING), 0.1))
        changed = (state[3] - self.states[-1, 3]) / DT
        self._advance(Ego(float(s), max(speed, 0.0), float(d), drift, float(changed)), np.array(states))

    def _advance(self, ego: Ego, states: np.ndarray) -> None:
        """Move everything for a step, and measure it."""
        others = self.world.advance(states)
        own = states[:, None]
        with np.errstate(invalid="ignore"):  # vehicles that have left
            seconds = footprints.time_to_collision(own, others)
            behind = footprints.is_behind(own, others) & (abs(ego.drift) < KEEPING)
        # A recorded vehicle goes on through the ego vehicle that it hits from behind.
        passed = np.logical_or.accumulate(np.concatenate([self.passed[None], behind & (seconds == 0)]), axis=0)
        self.passed = passed[-1]
        seconds = np.where(behind | passed[1:], np.inf, seconds)
        self.collision |= bool((seconds == 0).any())
        self.on_road &= bool(stays_on(self.episode.path, np.array([ego.d])))
        self.ttc.append(min(float(np.nanmin(seconds, initial=np.inf)), LONGEST_TTC))
        self.ego, self.others, self.step = ego, others[-1], self.step + 1
        self.states = states
        self.track.append(self.others[:, :2])
        self.own.append(states[-1, :2])
        self.driven.append((ego.acceleration, *states[-1, 2:]))
        self.arrived = ego.s >= self.episode.path.length

    @property
    def over(self) -> bool:
        """Whether the ego vehicle has collided or arrived."""
        return self.collision or self.arrived

    def happened(self, made: int, agents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the agents of an observation did after a step, as far as it has happened.

        The steps of the ego vehicle are not known: a predictor must not learn to forecast the planner.

        Returns:
            Positions [A, 12, 2], zero where not known, and known [A, 12].
        """
        future = np.full((len(agents), FUTURE, 2), np.nan)
        rows = agents[:-1] - self.episode.number * IDS
        for ahead in range(1, min(self.step - made, FUTURE) + 1):
            future[:-1, ahead - 1] = self.track[HISTORY - 1 + made + ahead][rows]
        known = ~np.isnan(future[..., 0])
        return np.where(known[..., None], future, 0.0), known

    def ahead(self, plans: Plans | None, number: int) -> np.ndarray:
        """[48, 4] states of the ego vehicle each 0.1 s on its present plan; at its present speed without one."""
        seconds = np.arange(1, FUTURE * SUBSTEPS + 1) * DT / SUBSTEPS
        if plans is None:
            ego = self.ego
            speed, d, drift = (np.full(len(seconds), value) for value in (ego.speed, ego.d, 0.0))
            return states_on(self.episode.path, ego.s + ego.speed * seconds, speed, d, drift)
        at, knots = seconds + DT, np.arange(FUTURE + 1) * DT  # the plan is a step old
        s, speed, d, drift = (np.interp(at, knots, x[number]) for x in (plans.s, plans.speed, plans.d, plans.drift))
        return states_on(self.episode.path, s + np.maximum(at - knots[-1], 0) * speed, speed, d, drift)

    def scores(self) -> dict[str, float]:
        """Scores of the episode; see ``METRICS``."""
        acceleration, heading, speed = np.array(self.driven).T
        pairs = (np.stack([x[:-1], x[1:]], axis=1) for x in (acceleration, heading, speed))
        comfort = is_comfortable(*pairs)
        shortest, safe = min(self.ttc), np.array(self.ttc) >= SHORTEST_TTC
        progress = self.ego.s - self.episode.s
        share = min(progress / (self.episode.path.speed * DT * self.step), 1.0)
        allowed = not self.collision and self.on_road
        return {
            "score": float(allowed * composite(safe.mean(), np.array(max(share, 0.0)), comfort.mean())),
            "collision": float(self.collision),
            "hit_from_behind": float(self.passed.any()),
            "near_miss": float(not self.collision and shortest < NEAR_MISS),
            "min_ttc": shortest,
            "progress": progress,
            "jerk": float(np.abs(np.diff(acceleration)).mean() / DT),
            "comfort": float(comfort.mean()),
        }


METRICS: Mapping[str, str] = {
    "score": "composite, 0 to 1",
    "collision": "share of episodes with a collision",
    "hit_from_behind": "share of episodes in which another vehicle hits the ego vehicle from behind",
    "near_miss": f"share of episodes without collision, but with a time to collision below {NEAR_MISS:g} s",
    "min_ttc": f"shortest time to collision, s, at most {LONGEST_TTC:g}",
    "progress": "metres",
    "jerk": "mean absolute jerk along the path, m/s³",
    "comfort": "share of comfortable steps",
}
"""Scores of an episode, with units."""
FORECAST_METRICS: Sequence[str] = ("ADE", "FDE", "MR_2m")
"""Errors of the forecasts that are planned with, over the others, of forecasts that mature in their episode."""
