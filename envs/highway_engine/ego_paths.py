"""The paths on which an ego vehicle can drive in each scenario."""

from __future__ import annotations

import functools

import numpy as np

from motion_gym.driving.paths import Path
from motion_gym.envs.highway_engine.roads import SCENARIOS, WIDTH

FASTER = 1.2
"""Target speed of the ego vehicle, as a share of the mean target speed of the others: it has to pass some of them."""
MOVED = 0.5
"""Smallest distance of two points of a path, metres."""
ASIDE = 1.0
"""Distance of the proposals on roads of one lane, metres."""
LANES = {"straight": (-WIDTH, WIDTH), "merge": (-WIDTH, 0.0)}
"""Smallest and largest lateral position of the lanes along x, metres to the left of the x axis."""
BESIDE = 2.0
"""A vehicle further than this from those lanes, in metres, is on the ramp."""
ENDS = (-300.0, 300.0)
"""x of the beginning and the end of roads along x."""


@functools.cache
def _share_of_speed(scenario: str) -> float:
    return SCENARIOS[scenario]().speed


def ego_path(scenario: str, speed: float, track: np.ndarray) -> Path | None:
    """The path of the ego vehicle that takes the place of a recorded vehicle; None if it cannot.

    On roads along x it is the x axis, and the ego vehicle may change lane. Elsewhere it is the way of the recorded
    vehicle. A vehicle on a ramp cannot become the ego vehicle, since the ramp ends.

    Args:
        scenario: Name of the scenario.
        speed: Mean target speed of the style, m/s.
        track: [T, 2] positions of the recorded vehicle, metres, y up, traffic on the right.
    """
    target = FASTER * speed * _share_of_speed(scenario)
    if scenario in LANES:
        lowest, highest = LANES[scenario]
        if track[:, 1].min() < lowest - BESIDE:
            return None
        return Path(np.array([[x, 0.0] for x in ENDS]), WIDTH, lowest, highest, target)
    points = [track[0]]
    for point in track[1:]:
        if np.linalg.norm(point - points[-1]) > MOVED:
            points.append(point)
    return Path(np.array(points), ASIDE, -ASIDE, ASIDE, target) if len(points) > 2 else None
