"""The path that an ego vehicle follows, and positions relative to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Path:
    """A path on a road.

    Positions on a path are the distance s along it and the lateral position d, both in metres; d grows to the left.

    Attributes:
        points: [P, 2] float64, points of the path, metres, in the frame of the recording.
        spacing: Lateral distance of the proposals, metres: a lane, or less where there is only one lane.
        lowest: Smallest lateral position on the road.
        highest: Largest lateral position on the road.
        speed: Target speed of the ego vehicle, m/s.
    """

    points: np.ndarray
    spacing: float
    lowest: float
    highest: float
    speed: float

    def __post_init__(self) -> None:
        steps = np.diff(self.points, axis=0)
        length = np.linalg.norm(steps, axis=1)
        heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        at_points = np.concatenate([heading[:1], (heading[1:] + heading[:-1]) / 2, heading[-1:]])
        for name, value in (
            ("_along", np.concatenate([[0.0], np.cumsum(length)])),
            ("_unit", steps / length[:, None]),
            ("_heading", at_points),
        ):
            object.__setattr__(self, name, value)

    @property
    def length(self) -> float:
        """Metres from the first to the last point."""
        return float(self._along[-1])  # type: ignore[attr-defined]

    def mirrored(self) -> Path:
        """The path with y mirrored."""
        return Path(self.points * (1, -1), self.spacing, -self.highest, -self.lowest, self.speed)

    def heading(self, s: np.ndarray) -> np.ndarray:
        """Heading of the path, radians, at distances s of any shape."""
        return np.interp(s, self._along, self._heading)  # type: ignore[attr-defined, no-any-return]

    def position(self, s: np.ndarray, d: np.ndarray) -> np.ndarray:
        """Positions [..., 2] at distances s and lateral positions d [...]; straight on beyond both ends."""
        along, heading = self._along, self.heading(s)  # type: ignore[attr-defined]
        xy = np.stack([np.interp(s, along, self.points[:, axis]) for axis in (0, 1)], axis=-1)
        direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        beyond = s - np.clip(s, 0.0, along[-1])
        normal = np.stack([-direction[..., 1], direction[..., 0]], axis=-1)
        return xy + beyond[..., None] * direction + d[..., None] * normal  # type: ignore[no-any-return]

    def local(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance s and lateral position d [...] of positions [..., 2], by the nearest segment of the path."""
        start, unit, along = self.points[:-1], self._unit, self._along  # type: ignore[attr-defined]
        length = np.diff(along)
        flat = xy.reshape(-1, 2)
        away = flat[:, None] - start
        forward = np.einsum("mpx,px->mp", away, unit)
        inside = np.clip(forward, 0.0, length)
        nearest = np.argmin(np.square(away - inside[..., None] * unit).sum(axis=-1), axis=1)
        rows = np.arange(len(flat))
        first, last = nearest == 0, nearest == len(start) - 1
        free, held = forward[rows, nearest], inside[rows, nearest]
        own = np.where((first & (free < 0)) | (last & (free > held)), free, held)
        to_left = unit[nearest, 0] * away[rows, nearest, 1] - unit[nearest, 1] * away[rows, nearest, 0]
        return (along[nearest] + own).reshape(xy.shape[:-1]), to_left.reshape(xy.shape[:-1])
