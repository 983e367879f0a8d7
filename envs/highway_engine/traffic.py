"""One run of a scenario: vehicles enter, drive and leave, and their positions are recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.envs.highway_engine.roads import SCENARIOS, Entry, Scenario, TrafficRoad
from motion_gym.envs.highway_engine.styles import Style
from motion_gym.envs.highway_engine.vehicles import LENGTH, TrafficVehicle, vehicle_class

STEP = 0.1
"""Seconds per step of the simulation."""
EVERY = 4
"""Steps between recorded frames, which are 0.4 s apart."""
WARM_UP = 20.0
"""Seconds before the first recorded frame, in which the empty road fills."""
SLOW_SHARE, SLOW = 0.15, 0.75
"""Share of slow vehicles, and their target speed as a share of that of others."""
SPREAD = 0.12
"""Target speeds are uniform within this share around the mean."""


@dataclass(frozen=True, eq=False)
class Run:
    """The tracks of one run.

    Attributes:
        frame: [R] int64, number of the frame, from 0; sorted.
        agent: [R] int64, number of the vehicle in the run.
        xy: [R, 2] float32, metres, y up.
        tracks: Number of vehicles that were recorded, crashed ones included.
        crashed: Number of vehicles that crashed; their tracks are left out.
    """

    frame: np.ndarray
    agent: np.ndarray
    xy: np.ndarray
    tracks: int
    crashed: int


def simulate(scenario: str, style: Style, seconds: float, seed: Sequence[int]) -> Run:
    """Simulate a run.

    A vehicle that crashes is removed at once, so that nobody is held up by it, and its whole track is left out.

    Args:
        scenario: Name of the scenario.
        style: Style of all vehicles.
        seconds: Recorded time.
        seed: Seed of all random values.
    """
    road = TrafficRoad(SCENARIOS[scenario](), np.random.default_rng(seed))
    traffic = Traffic(road, style)
    for _ in range(round(WARM_UP / STEP)):
        traffic.step()
    rows: list[tuple[int, int, float, float]] = []
    for frame in range(round(seconds / STEP / EVERY)):
        rows += [(frame, number, *vehicle.position) for number, vehicle in traffic.numbered()]
        for _ in range(EVERY):
            traffic.step()
    table = np.array(rows, np.float64).reshape(-1, 4)
    agent = table[:, 1].astype(np.int64)
    kept = ~np.isin(agent, list(traffic.crashed))
    seen = np.unique(agent)
    return Run(
        table[kept, 0].astype(np.int64),
        agent[kept],
        (table[kept, 2:] * (1, -1)).astype(np.float32),
        len(seen),
        len(np.intersect1d(seen, list(traffic.crashed))),
    )


class Traffic:
    """Vehicles of one style on a road, which enter and leave.

    Attributes:
        road: The road with the vehicles that are on it now.
        crashed: Numbers of the vehicles that have crashed.
    """

    def __init__(self, road: TrafficRoad, style: Style):
        self.road, self.style = road, style
        self.scenario: Scenario = road.scenario
        self.kind = vehicle_class(style)
        self.crashed: set[int] = set()
        self._numbers: dict[Any, int] = {}
        self._entered = 0
        self._waiting = [self._interval(entry) for entry in self.scenario.entries]

    def numbered(self) -> list[tuple[int, TrafficVehicle]]:
        """Number of each vehicle, in the order of entry, and the vehicle."""
        return [(self._numbers[vehicle], vehicle) for vehicle in self.road.vehicles]

    def step(self) -> None:
        """Let vehicles enter, drive for one step, and leave."""
        for index, entry in enumerate(self.scenario.entries):
            self._waiting[index] -= STEP
            if self._waiting[index] <= 0 and self._enter(entry):
                self._waiting[index] = self._interval(entry)
        self.road.act()
        self.road.step(STEP)
        for vehicle in [v for v in self.road.vehicles if v.crashed or self._arrived(v)]:
            self.road.vehicles.remove(vehicle)
            number = self._numbers.pop(vehicle)
            if vehicle.crashed:
                self.crashed.add(number)

    def _interval(self, entry: Entry) -> float:
        """Seconds until the next vehicle wants to enter."""
        return float(self.road.np_random.exponential(1 / entry.flow))

    def _enter(self, entry: Entry) -> bool:
        """Let a vehicle enter, unless the vehicle in front is too near."""
        rng, lane = self.road.np_random, self.road.network.get_lane(entry.lane)
        here = [v for v in self.road.vehicles if entry.lane in (v.lane_index, v.target_lane_index)]
        ahead = [(lane.local_coordinates(v.position)[0], v.speed) for v in here]
        gap, front = min(ahead, default=(np.inf, np.inf))
        target = self.style.speed * self.scenario.speed * rng.uniform(1 - SPREAD, 1 + SPREAD)
        target *= SLOW if rng.random() < SLOW_SHARE else 1.0
        speed = min(target, front)
        if gap < LENGTH + self.style.distance + speed * self.style.headway:
            return False
        route = list(entry.routes[rng.integers(len(entry.routes))]) if entry.routes else None
        vehicle = self.kind(
            self.road,
            lane.position(0, 0),
            lane.heading_at(0),
            speed,
            target_lane_index=entry.lane,
            target_speed=target,
            route=route,
            enable_lane_change=self.scenario.lane_changes,
            timer=rng.uniform(0, self.kind.LANE_CHANGE_DELAY),
        )
        vehicle.randomize_behavior()
        self._numbers[vehicle] = self._entered
        self._entered += 1
        self.road.vehicles.append(vehicle)
        return True

    def _arrived(self, vehicle: TrafficVehicle) -> bool:
        """Whether a vehicle is at the end of a lane that no lane continues."""
        return vehicle.lane_index[1] not in self.road.network.graph and vehicle.left() < LENGTH / 2
