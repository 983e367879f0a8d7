"""The planner: scores proposals against the forecasts of the other vehicles, and chooses one.

The score follows PDM-Closed (Dauner et al., CoRL 2023) and the closed-loop score of nuPlan (Karnchanachari et al., ICRA
2024): a proposal that collides or leaves the road has the score 0, another one a weighted mean of time to collision,
progress and comfort.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.driving import footprints
from motion_gym.driving.paths import Path
from motion_gym.driving.proposals import BRAKE, DT, Ego, Plans, propose, state_of

WEIGHTS = {"ttc": 5.0, "progress": 5.0, "comfort": 2.0}
"""Weights of the parts of the composite, for proposals and for driven episodes."""
SHORTEST_TTC = 0.95
"""Seconds; a shorter time to collision counts as 0."""
ACCELERATIONS, LATERAL, JERK = (-4.05, 2.40), 4.89, 8.37
"""Bounds of comfort, m/s^2, m/s^2 and m/s^3 (those of nuPlan)."""
OFF_ROAD = 0.5
"""Metres by which the centre of the ego vehicle may be beside the outer lanes of its road."""
KEEPING = 0.3
"""Largest lateral speed, m/s, of a vehicle that keeps its lane."""


@dataclass(frozen=True, eq=False)
class Scored:
    """Scores of the proposals and of the emergency brake against forecasts, each [16].

    Attributes:
        collides: Whether the ego vehicle would collide; a vehicle that hits it from behind while it keeps its lane does
            not count.
        on_road: Whether it stays on the road.
        ttc: Shortest time to collision of all steps, seconds; infinite without a danger.
        progress: Metres along the path.
        comfort: Whether all accelerations and jerks are within their bounds.
        total: The composite, 0 to 1.
    """

    collides: np.ndarray
    on_road: np.ndarray
    ttc: np.ndarray
    progress: np.ndarray
    comfort: np.ndarray
    total: np.ndarray


def plan(ego: Ego, path: Path, others: np.ndarray, heading: np.ndarray) -> tuple[Plans, Scored, int]:
    """The proposals, their scores, and the number of the chosen one.

    Args:
        ego: The ego vehicle.
        path: Its path.
        others: [N, 13, 2] positions of the others now and as they are forecast, metres.
        heading: [N] headings of the others now, radians.
    """
    plans = propose(ego, path, others)
    scored = score_plans(plans, ego, path, footprints.states_of(others, DT, heading))
    best = int(scored.total[:BRAKE].argmax())
    return plans, scored, best if scored.total[best] > 0 else BRAKE


def score_plans(plans: Plans, ego: Ego, path: Path, others: np.ndarray) -> Scored:
    """Scores of proposals against forecast states [N, 12, 4] of the others."""
    states = plans.states(path)
    own, theirs = states[:, :, None], others.swapaxes(0, 1)[None]
    keeps = np.abs(plans.goal - ego.d) < path.spacing / 2
    seconds = footprints.time_to_collision(own, theirs)
    behind = keeps[:, None, None] & footprints.is_behind(own, theirs)
    # A forecast goes on through the ego vehicle that it hits from behind.
    ignored = behind | np.logical_or.accumulate(behind & (seconds == 0), axis=1)
    seconds = np.where(ignored, np.inf, seconds)
    collides = (seconds == 0).any(axis=(1, 2))
    ttc = seconds.min(axis=(1, 2), initial=np.inf)
    on_road = stays_on(path, plans.d)
    progress = plans.s[:, -1] - plans.s[:, 0]
    first = np.concatenate([state_of(ego, path)[None, None].repeat(len(states), axis=0), states], axis=1)
    acceleration = np.concatenate([np.full((len(states), 1), ego.acceleration), plans.acceleration], axis=1)
    comfort = is_comfortable(acceleration, first[..., 2], first[..., 3])
    allowed = ~collides & on_road
    furthest = max(float(np.where(allowed, progress, 0.0).max()), 1e-6)
    total = allowed * composite(ttc >= SHORTEST_TTC, np.clip(progress / furthest, 0.0, 1.0), comfort)
    return Scored(collides, on_road, ttc, progress, comfort, total)


def composite(ttc: np.ndarray, progress: np.ndarray, comfort: np.ndarray) -> np.ndarray:
    """Weighted mean of three parts, each 0 to 1."""
    parts = {"ttc": ttc, "progress": progress, "comfort": comfort}
    return sum(WEIGHTS[name] * part for name, part in parts.items()) / sum(WEIGHTS.values())  # type: ignore[return-value]


def stays_on(path: Path, d: np.ndarray) -> np.ndarray:
    """Whether lateral positions [..., T] stay on the road."""
    return np.asarray(((d > path.lowest - OFF_ROAD) & (d < path.highest + OFF_ROAD)).all(axis=-1))


def is_comfortable(acceleration: np.ndarray, heading: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Whether movements are comfortable.

    Args:
        acceleration: [..., T] along the path, m/s^2, of steps that follow each other.
        heading: [..., T] radians.
        speed: [..., T] m/s.
    """
    low, high = ACCELERATIONS
    turn = np.diff(heading, axis=-1)
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi) / DT
    calm = (acceleration[..., 1:] >= low) & (acceleration[..., 1:] <= high)
    calm &= np.abs(np.diff(acceleration, axis=-1)) / DT <= JERK
    calm &= turn * speed[..., 1:] <= LATERAL
    return np.asarray(calm.all(axis=-1))
