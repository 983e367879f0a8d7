"""A study of traffic: how vehicles of each style follow, accelerate and change lane, and how many there are.

Everything is measured from recorded positions of parallel lanes along x, so that nothing is taken from the simulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.data.windows import counts
from motion_gym.metrics.bootstrap import clustered_interval

MEASURES = {
    "headway": "time headway, s",
    "gap": "gap, m",
    "acceleration": "absolute acceleration, m/s²",
    "lane_changes": "changes of lane per minute",
    "speed": "speed, m/s",
}
"""Names of the measured values with their units."""


def driving_styles(
    domains: Mapping[str, str],
    trained: Sequence[str],
    lane_width: float,
    vehicle_length: float,
    following: float,
    counted: Mapping[str, str],
) -> dict[str, Any]:
    """Measures of each style, means over vehicles and steps with intervals clustered by vehicle.

    Args:
        domains: Specs of domains with parallel lanes along x, by the name of the style.
        trained: Names of styles whose ``train`` windows are counted as well.
        lane_width: Metres.
        vehicle_length: Metres.
        following: Longest time headway, in seconds, of a vehicle that counts as following another one.
        counted: Specs of further domains whose ``test`` windows are counted, by name.

    Returns:
        ``measures``: style -> name -> mean, low and high; ``following``; ``counts``: name -> split -> agent-windows,
        agents and ``crashed_agents``; ``unit`` and ``dt``.
    """
    measures: dict[str, dict[str, list[float]]] = {}
    numbers: dict[str, dict[str, dict[str, int]]] = {}
    for name, spec in {**domains, **counted}.items():
        domain = catalog.domain(spec)
        splits = ["train", "test"] if name in trained else ["test"]
        seen = {split: counts(domain.windows(split)) for split in splits}
        card = domain.card
        numbers[name] = {split: {**seen[split], **_crashed(card.counts.get(split, {}))} for split in splits}
        if name in domains:
            (recording,) = domain.recordings("test")
            values, vehicle = measured(recording, lane_width, vehicle_length, following)
            measures[name] = {key: [float(end) for end in clustered_interval(values[key], vehicle)] for key in MEASURES}
    return {"measures": measures, "following": following, "counts": numbers, "unit": card.unit, "dt": card.dt}


def measured(
    recording: Any, lane_width: float, vehicle_length: float, following: float
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Measures of each vehicle at each step but its first and last two.

    Args:
        recording: Tracks of vehicles that drive along x in lanes whose centres are multiples of the width apart.
        lane_width: Metres.
        vehicle_length: Metres.
        following: Longest time headway, seconds.

    Returns:
        Values [V] of each of ``MEASURES``, NaN for the headway and the gap of a vehicle that follows nobody; and the
        vehicle [V] of each value.
    """
    order = np.lexsort((recording.frame, recording.agent))
    frame, agent, x, y = (column[order] for column in (recording.frame, recording.agent, *recording.xy.T))
    lane = np.rint(y / lane_width).astype(np.int64)
    inner = np.flatnonzero((agent[:-2] == agent[2:]) & (frame[2:] - frame[:-2] == 2)) + 1
    speed = (x[inner + 1] - x[inner - 1]) / (2 * recording.dt)
    acceleration = (x[inner + 1] - 2 * x[inner] + x[inner - 1]) / recording.dt**2
    gap = _gaps(frame, lane, x)[inner] - vehicle_length
    headway = gap / np.maximum(speed, 0.1)
    alone = ~(headway < following)
    return {
        "headway": np.where(alone, np.nan, headway),
        "gap": np.where(alone, np.nan, gap),
        "acceleration": np.abs(acceleration),
        "lane_changes": (lane[inner] != lane[inner - 1]) * 60 / recording.dt,
        "speed": speed,
    }, agent[inner]


def _gaps(frame: np.ndarray, lane: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Metres from the centre of each vehicle to that of the next one in its lane; infinite where there is none."""
    order = np.lexsort((x, lane, frame))
    gap = np.full(len(x), np.inf)
    together = (np.diff(frame[order]) == 0) & (np.diff(lane[order]) == 0)
    gap[order[:-1][together]] = np.diff(x[order])[together]
    return gap


def _crashed(counted: Mapping[str, int]) -> dict[str, int]:
    return {key: value for key, value in counted.items() if key == "crashed_agents"}
