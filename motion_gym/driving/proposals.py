"""Proposals: what the ego vehicle could do, 5 speeds by 3 lateral positions, each driven by IDM among forecasts.

After PDM-Closed (Dauner, Hallgarten, Geiger, Chitta, "Parting with misconceptions about learning-based vehicle motion
planning", CoRL 2023), whose proposals are 5 speed fractions by 3 lateral offsets with IDM along each of them. There the
other vehicles are extrapolated at constant velocity; here their positions are the forecasts of a predictor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.contract import FUTURE
from motion_gym.driving.footprints import LENGTH, WIDTH
from motion_gym.driving.paths import Path

FRACTIONS = (1.0, 0.8, 0.6, 0.4, 0.2)
"""Speeds, as shares of the target speed."""
SIDES = (0, 1, -1)
"""Lateral positions: that of the nearest lane, and one ``spacing`` to the left and to the right of it."""
COUNT = len(FRACTIONS) * len(SIDES)
"""Number of proposals. Proposal i has the side ``SIDES[i // 5]`` and the speed fraction ``FRACTIONS[i % 5]``."""
BRAKE = COUNT
"""Number of a further plan, the emergency brake: it is taken if every proposal collides or leaves the road."""
DT = 0.4
"""Seconds per step of a proposal."""
HEADWAY, GAP, ACCELERATION, BRAKING, EXPONENT = 1.5, 2.0, 1.5, 3.0, 4
"""IDM of the ego vehicle: s, m, m/s^2, m/s^2."""
HARDEST, EMERGENCY = 6.0, 4.0
"""Largest deceleration of a proposal, and that of the emergency brake, m/s^2."""
CORRIDOR = WIDTH + 0.6
"""A vehicle within this lateral distance of the ego vehicle or its goal, metres, may be its leader."""
RATE = 1.0
"""Rate of lateral moves, 1/s: critically damped, so that a lane of 4 m is changed in about 4 s."""
ROLLING = 5.0
"""Below this speed, m/s, lateral moves are slower, as the speed is: a standing vehicle does not move sideways."""


@dataclass(frozen=True)
class Ego:
    """State of the ego vehicle on its path.

    Attributes:
        s: Distance along the path, metres.
        speed: m/s along the path.
        d: Lateral position, metres, to the left.
        drift: Lateral speed at ``ROLLING`` and faster, m/s.
        acceleration: Last acceleration along the path, m/s^2.
    """

    s: float
    speed: float
    d: float
    drift: float = 0.0
    acceleration: float = 0.0


@dataclass(frozen=True, eq=False)
class Plans:
    """The 15 proposals, and the emergency brake, over the 12 steps of a forecast; step 0 is now.

    Attributes:
        s: [16, 13] distance along the path, metres.
        speed: [16, 13], m/s.
        d: [16, 13] lateral position, metres.
        drift: [16, 13] lateral speed as in ``Ego``.
        acceleration: [16, 12] constant in each step, m/s^2.
        goal: [16] lateral position that is approached.
    """

    s: np.ndarray
    speed: np.ndarray
    d: np.ndarray
    drift: np.ndarray
    acceleration: np.ndarray
    goal: np.ndarray

    def states(self, path: Path) -> np.ndarray:
        """[16, 12, 4]: x, y, heading and speed at the 12 steps ahead."""
        return states_on(path, self.s[:, 1:], self.speed[:, 1:], self.d[:, 1:], self.drift[:, 1:])

    def after(self, number: int, seconds: float) -> Ego:
        """The ego vehicle after some seconds of the first step of a proposal."""
        a = float(self.acceleration[number, 0])
        s, speed, d, drift = (float(x[number, 0]) for x in (self.s, self.speed, self.d, self.drift))
        later, own = max(speed + a * seconds, 0.0), float(self.goal[number])
        warped = seconds * min(1.0, (speed + later) / 2 / ROLLING)
        moved, moving = _lateral(d - own, drift, np.array(warped))
        return Ego(s + speed * seconds + a * seconds**2 / 2, later, own + float(moved), float(moving), a)


def propose(ego: Ego, path: Path, others: np.ndarray) -> Plans:
    """The 15 proposals, and the emergency brake.

    Args:
        ego: The ego vehicle.
        path: Its path.
        others: [N, 13, 2] positions of the others now and as they are forecast, metres.
    """
    lane = path.spacing * round(ego.d / path.spacing)
    goal = np.append(np.repeat([lane + side * path.spacing for side in SIDES], len(FRACTIONS)), lane)
    wanted = np.append(np.tile(FRACTIONS, len(SIDES)), 1.0) * path.speed
    along, across = path.local(others)
    forward = np.diff(along, axis=1, append=2 * along[:, -1:] - along[:, -2:-1]) / DT
    beside = (np.abs(across - ego.d) < CORRIDOR)[None] | (np.abs(across - goal[:, None, None]) < CORRIDOR)
    plans = COUNT + 1
    s, speed = np.empty((plans, FUTURE + 1)), np.empty((plans, FUTURE + 1))
    acceleration = np.empty((plans, FUTURE))
    s[:, 0], speed[:, 0] = ego.s, ego.speed
    for step in range(FUTURE):
        now, v = s[:, step], speed[:, step]
        gap = np.where(beside[:, :, step], along[:, step] - now[:, None], np.inf)
        gap[gap <= 0] = np.inf
        a = np.maximum(ACCELERATION * (1 - (v / wanted) ** EXPONENT), -BRAKING)
        if len(others):
            leader = gap.argmin(axis=1)
            free = np.maximum(gap[np.arange(plans), leader] - LENGTH, 0.1)
            closing = v - forward[leader, step]
            desired = GAP + np.maximum(v * HEADWAY + v * closing / (2 * np.sqrt(ACCELERATION * BRAKING)), 0.0)
            a = a - ACCELERATION * (desired / free) ** 2
        a = np.maximum(a, -HARDEST)
        a[BRAKE] = -EMERGENCY
        later = np.maximum(v + a * DT, 0.0)
        acceleration[:, step] = (later - v) / DT
        s[:, step + 1], speed[:, step + 1] = now + (v + later) / 2 * DT, later
    warped = np.cumsum(DT * np.minimum(1.0, (speed[:, 1:] + speed[:, :-1]) / 2 / ROLLING), axis=1)
    warped = np.concatenate([np.zeros((plans, 1)), warped], axis=1)
    moved, drift = _lateral((ego.d - goal)[:, None], ego.drift, warped)
    return Plans(s, speed, goal[:, None] + moved, drift, acceleration, goal)


def states_on(path: Path, s: np.ndarray, speed: np.ndarray, d: np.ndarray, drift: np.ndarray) -> np.ndarray:
    """States [..., 4], x, y, heading and speed, of positions on a path."""
    sideways = drift * np.minimum(1.0, speed / ROLLING)
    heading = path.heading(s) + np.arctan2(sideways, np.maximum(speed, 0.1))
    return np.concatenate([path.position(s, d), heading[..., None], np.hypot(speed, sideways)[..., None]], axis=-1)


def state_of(ego: Ego, path: Path) -> np.ndarray:
    """[4] x, y, heading and speed of the ego vehicle."""
    return states_on(path, *(np.array(value) for value in (ego.s, ego.speed, ego.d, ego.drift)))


def _lateral(off: np.ndarray | float, drift: float, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to the goal and its rate of change after some seconds of a critically damped approach."""
    slope = drift + RATE * off
    decay = np.exp(-RATE * seconds)
    return (off + slope * seconds) * decay, (drift - RATE * slope * seconds) * decay
