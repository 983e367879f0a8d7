"""Footprints of vehicles: distances between them, and times to collision.

A footprint is three discs that cover a vehicle of 5 m by 2 m, as in Ziegler and Stiller, "Fast collision checking for
intelligent vehicle motion planning", Intelligent Vehicles Symposium 2010.
"""

from __future__ import annotations

import numpy as np

LENGTH, WIDTH = 5.0, 2.0
"""Metres."""
RADIUS = float(np.hypot(LENGTH / 6, WIDTH / 2))
"""Radius of a disc, metres."""
_PLACES = np.array([-LENGTH / 3, 0.0, LENGTH / 3])
STANDING = 0.5
"""Below this speed, m/s, a vehicle keeps its heading."""


def states_of(xy: np.ndarray, dt: float, heading: np.ndarray | None = None) -> np.ndarray:
    """States from positions.

    Args:
        xy: [N, T + 1, 2], metres.
        dt: Seconds per step.
        heading: [N] heading at the first position, of vehicles that stand; 0 by default.

    Returns:
        [N, T, 4]: x, y, heading in radians, and speed in m/s of the last T positions, by backward differences.
    """
    moved = np.diff(xy, axis=1)
    speed = np.linalg.norm(moved, axis=-1) / dt
    course = np.arctan2(moved[..., 1], moved[..., 0])
    moving = speed > STANDING
    latest = np.maximum.accumulate(np.where(moving, np.arange(moved.shape[1]), -1), axis=1)
    held = np.take_along_axis(course, np.maximum(latest, 0), axis=1)
    first = np.zeros(len(xy)) if heading is None else heading
    course = np.where(latest >= 0, held, first[:, None])
    return np.concatenate([xy[:, 1:], course[..., None], speed[..., None]], axis=-1)


def clearance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Metres between footprints of states [..., 4], which are broadcast; negative where they overlap."""
    between = _discs(one)[..., :, None, :] - _discs(other)[..., None, :, :]
    return np.sqrt(np.square(between).sum(axis=-1).min(axis=(-2, -1))) - 2 * RADIUS  # type: ignore[no-any-return]


def time_to_collision(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Seconds until footprints of states [..., 4] touch if both keep their velocities; infinite if they never do."""
    between = _discs(one)[..., :, None, :] - _discs(other)[..., None, :, :]
    velocity = _velocity(one) - _velocity(other)
    a = np.square(velocity).sum(axis=-1)[..., None, None]
    b = np.einsum("...x,...ijx->...ij", velocity, between)
    c = np.square(between).sum(axis=-1) - (2 * RADIUS) ** 2
    root = np.square(b) - a * c
    meets = (b < 0) & (root >= 0)
    seconds = np.where(meets, (-b - np.sqrt(np.maximum(root, 0.0))) / np.maximum(a, 1e-12), np.inf)
    return np.where(c <= 0, 0.0, seconds).min(axis=(-2, -1))  # type: ignore[no-any-return]


def is_behind(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether the centre of the other vehicle is behind the rear of the first; states [..., 4] are broadcast."""
    away = other[..., :2] - one[..., :2]
    forward = away[..., 0] * np.cos(one[..., 2]) + away[..., 1] * np.sin(one[..., 2])
    return forward < -LENGTH / 2  # type: ignore[no-any-return]


def _discs(state: np.ndarray) -> np.ndarray:
    """Centres [..., 3, 2] of the discs of states [..., 4]."""
    heading = state[..., 2, None]
    return np.stack(
        [state[..., 0, None] + _PLACES * np.cos(heading), state[..., 1, None] + _PLACES * np.sin(heading)], axis=-1
    )


def _velocity(state: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(state[..., 2]), np.sin(state[..., 2])], axis=-1) * state[..., 3, None]
