"""Encounters: two agents who come towards each other and pass, and the side on which they pass."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from motion_gym.contract import Recording
from motion_gym.data.windows import step_numbers

NEAR = 2.0
"""Largest distance at which two agents pass, metres."""
SLOWEST = 0.3
"""Smallest speed of an agent who passes another, m/s."""
ONCOMING = -0.5
"""Largest cosine of the angle between the velocities of two agents who come towards each other: 120 degrees or more."""
PERIOD = 30.0
"""Seconds of a recording that are resampled together; the encounters of one person, and of people who walk together,
are mostly in one such period."""


class Encounters(NamedTuple):
    """Encounters of a recording.

    Attributes:
        right: [E] bool, whether they pass on the right: each moves to its right, and has the other on its left.
        distance: [E] their smallest distance, metres.
        period: [E] int64, number of the half-minute of the recording.
        agents: [E, 2] int64, ids of both agents.
    """

    right: np.ndarray
    distance: np.ndarray
    period: np.ndarray
    agents: np.ndarray


def on_the_right(between: np.ndarray, closing: np.ndarray) -> np.ndarray:
    """Whether one agent passes another on the right, so that it has the other on its left.

    Args:
        between: [..., 2] position of the other agent relative to the one, where they are nearest, in axes where y is to
            the left of x, seen from above.
        closing: [..., 2] velocity of the one relative to the other.
    """
    return np.asarray(closing[..., 0] * between[..., 1] - closing[..., 1] * between[..., 0] > 0)


def passed(paths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How the two agents of each scene pass.

    Args:
        paths: [S, 2, T, 2] positions, metres.

    Returns:
        [S] bool, whether they pass on the right, and [S] their smallest distance at a step.
    """
    between = paths[:, 1] - paths[:, 0]
    distance = np.linalg.norm(between, axis=-1)
    step, scene = distance.argmin(axis=1), np.arange(len(paths))
    closing = -np.gradient(between, axis=1)[scene, step]
    return on_the_right(between[scene, step], closing), distance[scene, step]


def encounters(recording: Recording, downwards: bool = False) -> Encounters:
    """All encounters of a recording.

    Two agents pass where their distance is smallest while both are seen, if both are also seen one step before and
    after, the distance is at most 2 m, both walk at 0.3 m/s or more, and their directions differ by 120 degrees or
    more. Velocities are central differences. Two agents have one encounter at most.

    Args:
        recording: Positions in metres.
        downwards: Whether the y axis points to the right of the x axis, seen from above, as in images.
    """
    frames, numbers = step_numbers(recording)
    step = numbers[np.searchsorted(frames, recording.frame)]
    xy = recording.xy * (1.0, -1.0) if downwards else recording.xy
    velocity = _velocities(step, recording.agent, xy, recording.dt)
    one, other = _near_pairs(step, xy)
    distance = np.linalg.norm(xy[other] - xy[one], axis=1)
    pair = np.sort(np.stack([recording.agent[one], recording.agent[other]], axis=1), axis=1)
    order = np.lexsort((distance, pair[:, 1], pair[:, 0]))
    first = np.ones(len(order), bool)
    first[1:] = (np.diff(pair[order], axis=0) != 0).any(axis=1)
    chosen = order[first]
    one, other = one[chosen], other[chosen]
    fast, slow = velocity[one], velocity[other]
    speeds = np.linalg.norm(fast, axis=1), np.linalg.norm(slow, axis=1)
    keep = (np.minimum(*speeds) >= SLOWEST) & ((fast * slow).sum(axis=1) <= ONCOMING * speeds[0] * speeds[1])
    right = on_the_right(xy[other] - xy[one], fast - slow)
    period = (step[one] * recording.dt // PERIOD).astype(np.int64)
    return Encounters(right[keep], distance[chosen][keep], period[keep], pair[chosen][keep])


def _velocities(step: np.ndarray, agent: np.ndarray, xy: np.ndarray, dt: float) -> np.ndarray:
    """[R, 2] velocity of each row, from the rows of the agent one step before and after; NaN without them."""
    order = np.lexsort((step, agent))
    steps, agents, places = step[order], agent[order], xy[order]
    velocity = np.full(xy.shape, np.nan)
    inside = (agents[2:] == agents[:-2]) & (steps[2:] - steps[:-2] == 2)
    velocity[order[1:-1][inside]] = (places[2:] - places[:-2])[inside] / (2 * dt)
    return velocity


def _near_pairs(step: np.ndarray, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of every two agents who are within 2 m of each other in the same step."""
    order = np.argsort(step, kind="stable")
    ends = np.flatnonzero(np.diff(step[order])) + 1
    pairs = [np.empty((0, 2), np.int64)]
    for start, end in itertools.pairwise([0, *ends.tolist(), len(order)]):
        rows = order[start:end]
        gap = xy[rows, None] - xy[None, rows]
        one, other = np.nonzero(np.triu((gap**2).sum(axis=-1) <= NEAR**2, 1))
        pairs.append(np.stack([rows[one], rows[other]], axis=1))
    together = np.concatenate(pairs)
    return together[:, 0], together[:, 1]
