"""The lines of the lanes of a scenario, for pictures."""

from __future__ import annotations

import numpy as np
from highway_env.road.lane import LineType

from motion_gym.envs.highway_engine.roads import SCENARIOS

SPACING = 2.0
"""Metres between the points of a line."""


def lane_lines(scenario: str) -> list[tuple[np.ndarray, bool]]:
    """Both sides of every lane that have a line.

    Args:
        scenario: Name of the scenario.

    Returns:
        Points [P, 2] of each line, metres, y up; and whether the line is dashed.
    """
    lines = []
    for lane in SCENARIOS[scenario]().network.lanes_list():
        at = np.linspace(0, lane.length, 2 + round(lane.length / SPACING))
        for kind, side in zip(lane.line_types, (-0.5, 0.5), strict=True):
            if kind != LineType.NONE:
                points = np.array([lane.position(s, side * lane.width_at(s)) for s in at])
                lines.append((points * (1, -1), kind == LineType.STRIPED))
    return lines
