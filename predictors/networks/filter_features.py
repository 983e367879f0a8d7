"""Inputs of ``kalman_residual``: a bank of Kalman filters and the nearest neighbours, in the frame of each agent.

The frame of an agent has its origin at the last observed position and its x axis along the filtered velocity, so the
inputs do not depend on the origin or the direction of the axes. An agent that does not move at all has the axes of the
world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.contract import FUTURE, HISTORY
from motion_gym.predictors.kalman_velocity import ACCELERATION, MEASUREMENT, FilterBank, filtered

NEAREST = 6
"""Neighbours of an agent: those that are nearest at the last observed step."""
SHOWN = (0, 7, 14, 21, 28)
"""Filters of the bank whose velocity is an input: one for each variance of the acceleration."""
OWN = 2 * (HISTORY - 1) + 3 + len(ACCELERATION) + len(MEASUREMENT) + 2 * len(SHOWN)
"""Inputs of an agent: observed steps, filtered speed and position, weights of the filters, velocities of some."""
OTHER = 9
"""Inputs of a neighbour: position, velocity, nearness, and the closest approach at constant velocity."""
HORIZON = 4.8
"""Seconds within which a closest approach is searched."""
STANDING = 1e-6
"""Speed, m/s, below which an agent has no direction."""


@dataclass(frozen=True)
class Inputs:
    """Inputs of agents.

    Attributes:
        own: [A, OWN] float32.
        others: [A, 6, OTHER] float32, zero where there is no neighbour.
        there: [A, 6] float32, 1 where there is a neighbour.
        straight: [A, 12, 2] float64, forecast of the filters relative to the last observed position, world axes.
        turn: [A, 2, 2] float64, matrices that turn row vectors of the world into the frame of the agent.
    """

    own: np.ndarray
    others: np.ndarray
    there: np.ndarray
    straight: np.ndarray
    turn: np.ndarray


def nearest_neighbours(last: np.ndarray, scene: np.ndarray, reach: float | None = None) -> np.ndarray:
    """The nearest agents of the same scene, nearest first: [A, 6] int64 indices, -1 where there is none.

    Args:
        last: [A, 2] last observed positions.
        scene: [S + 1] agents of scene s are scene[s] to scene[s + 1].
        reach: Largest distance of a neighbour, metres; None for any.
    """
    size = np.diff(scene)
    each = np.repeat(size, size)  # agents in the scene of each agent
    one = np.repeat(np.arange(len(last)), each)
    start = np.repeat(np.repeat(scene[:-1], size), each)
    other = start + np.arange(len(one)) - np.repeat(np.cumsum(each) - each, each)
    one, other = one[one != other], other[one != other]
    square = ((last[one] - last[other]) ** 2).sum(axis=-1)
    order = np.lexsort((other, square, one))
    if reach is not None:
        order = order[square[order] <= reach**2]
    one, other = one[order], other[order]
    rank = np.arange(len(one)) - np.searchsorted(one, one)
    nearest = np.full((len(last), NEAREST), -1)
    kept = rank < NEAREST
    nearest[one[kept], rank[kept]] = other[kept]
    return nearest


def inputs_of(
    xy: np.ndarray,
    dt: float,
    nearest: np.ndarray,
    chosen: np.ndarray | slice = slice(None),
    bank: bool = True,
    heading: bool = True,
) -> Inputs:
    """Inputs of some agents.

    Args:
        xy: [A, 8, 2] float64, observed positions of all agents, metres.
        dt: Seconds per step.
        nearest: [A, 6] from ``nearest_neighbours``.
        chosen: Index of the agents whose inputs are computed.
        bank: False for the last step in place of the filters.
        heading: False for the axes of the world in place of the frame of the agent.
    """
    q, r = (values.ravel() for values in np.meshgrid(ACCELERATION, MEASUREMENT, indexing="ij"))
    if bank:
        filters = filtered(xy - xy[:, -1:], dt, q, r)
    else:
        last = np.broadcast_to((xy[:, -1] - xy[:, -2]) / dt, (len(q), len(xy), 2))
        filters = FilterBank(np.zeros(last.shape), last, np.zeros(last.shape[:2]), np.zeros((len(q), 2, 2)))
    weight, velocities = filters.shares, filters.velocity
    position, velocity = (np.einsum("ga,gac->ac", weight, values) for values in (filters.position, velocities))
    place = xy[:, -1] + position  # filtered position at the last step

    own_velocity, own_position = velocity[chosen], position[chosen]
    speed = np.linalg.norm(own_velocity, axis=-1, keepdims=True)
    moves = (speed > STANDING) & heading
    along = np.where(moves, own_velocity / np.maximum(speed, STANDING), (1.0, 0.0))
    turn = np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=-1)], axis=-1)
    straight = own_position[:, None] + dt * np.arange(1, FUTURE + 1)[:, None] * own_velocity[:, None]

    shares = weight[:, chosen].T.reshape(-1, len(ACCELERATION), len(MEASUREMENT))
    further = velocities[list(SHOWN)][:, chosen].transpose(1, 0, 2) - own_velocity[:, None]
    own = [
        (np.diff(xy[chosen], axis=1) @ turn).reshape(len(turn), -1),
        speed,
        (own_position[:, None] @ turn)[:, 0],
        shares.sum(axis=2),
        shares.sum(axis=1),
        (further @ turn).reshape(len(turn), -1),
    ]
    other = np.maximum(nearest[chosen], 0)
    there = (nearest[chosen] >= 0).astype(np.float32)
    off = (place[other] - place[chosen][:, None]) @ turn
    drift = (velocity[other] - own_velocity[:, None]) @ turn
    distance = np.linalg.norm(off, axis=-1, keepdims=True)
    closing = -(off * drift).sum(axis=-1, keepdims=True) / ((drift**2).sum(axis=-1, keepdims=True) + STANDING)
    time = np.clip(closing, 0, HORIZON)
    approach = off + time * drift
    miss = np.linalg.norm(approach, axis=-1, keepdims=True)
    others = [off / 5, drift, 1 / (0.5 + distance), time / HORIZON, approach / 2, np.exp(-miss)]
    return Inputs(
        np.concatenate(own, axis=-1).astype(np.float32),
        np.concatenate(others, axis=-1).astype(np.float32) * there[..., None],
        there,
        straight,
        turn,
    )


def mirrored(inputs: Inputs) -> Inputs:
    """The inputs of the mirror image of every scene: left and right of each agent are swapped."""
    own, others = inputs.own.copy(), inputs.others.copy()
    own[:, OWN_LEFT] *= -1
    others[..., OTHER_LEFT] *= -1
    flip = np.array([1.0, -1.0])
    return Inputs(own, others, inputs.there, inputs.straight, inputs.turn * flip)


_SPEED = 2 * (HISTORY - 1)  # index of the first input after the observed steps
_VELOCITIES = _SPEED + 3 + len(ACCELERATION) + len(MEASUREMENT)
OWN_LEFT = [*range(1, _SPEED, 2), _SPEED + 2, *range(_VELOCITIES + 1, OWN, 2)]
"""Inputs of an agent that change their sign in a mirror."""
OTHER_LEFT = [1, 3, 7]
"""Inputs of a neighbour that change their sign in a mirror."""
