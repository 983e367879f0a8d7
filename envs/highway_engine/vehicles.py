"""The vehicle class of a style: a private subclass of highway-env's IDM vehicle."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from highway_env.vehicle.behavior import IDMVehicle

from motion_gym.envs.highway_engine.roads import TrafficRoad
from motion_gym.envs.highway_engine.styles import Style

LENGTH = 5.0
"""Length of a vehicle, metres."""
HARDEST = 6.0
"""Largest acceleration and deceleration, m/s^2."""
LATEST = 4.5
"""m/s^2; a vehicle that would have to brake harder drives on."""
SLOW = 1.0
"""m/s; the package lets no slower vehicle change lane."""
SAFE_BRAKING, SAFE_BRAKING_AT_END = 2.0, 4.0
"""Largest deceleration that a change of lane may impose on another vehicle, m/s^2; the latter at the end of a ramp."""
SLOWEST_START = 3.0
"""m/s; vehicles that stand at a gate are assumed to drive at least as fast, once they drive."""
AT_FORK = 1.0
"""Metres by which another road must be nearer than the one that a vehicle follows."""
RUN_OUT = 25.0
"""Metres before the end of a ramp at which a vehicle that has found no gap waits."""


class TrafficVehicle(IDMVehicle):
    """An IDM and MOBIL vehicle that never drives backwards, gives way at gates, and waits at the end of a ramp.

    Every constant that the package's vehicles read is set on this class or on that of a style. The package's
    environments write constants of ``IDMVehicle``, which therefore change nothing here.
    """

    LENGTH, WIDTH, HISTORY_SIZE = LENGTH, 2.0, 30
    DEFAULT_INITIAL_SPEEDS = (23, 25)
    MAX_SPEED, MIN_SPEED = 40.0, -40.0
    TAU_ACC, TAU_HEADING, TAU_LATERAL = 0.6, 0.2, 0.6
    TAU_PURSUIT = 0.1
    KP_A, KP_HEADING, KP_LATERAL = 1 / 0.6, 1 / 0.2, 1 / 0.6
    MAX_STEERING_ANGLE, DELTA_SPEED = np.pi / 3, 5
    ACC_MAX, DELTA, DELTA_RANGE = HARDEST, 4.0, (3.5, 4.5)
    LANE_CHANGE_MIN_ACC_GAIN, LANE_CHANGE_MAX_BRAKING_IMPOSED, LANE_CHANGE_DELAY = 0.2, SAFE_BRAKING, 1.0

    road: TrafficRoad
    lane: Any
    lane_index: Any
    target_lane_index: Any
    speed: float

    def act(self, action: Any = None) -> None:
        """Decide as IDM and MOBIL do, and stop at a gate or at the end of a ramp while there is no gap."""
        super().act(action)
        if self.crashed:
            return
        if self.lane_index in self.road.dead_ends and self.target_lane_index == self.lane_index:
            self._stop_within(self.left() - RUN_OUT)
        elif self._must_wait():
            self._stop_within(self.left() - LENGTH / 2 - 1.0)

    def change_lane_policy(self) -> None:
        """Change lane as MOBIL decides; on a ramp with more courage, and also from a standstill."""
        on_ramp = self.lane_index in self.road.dead_ends
        self.LANE_CHANGE_MAX_BRAKING_IMPOSED = SAFE_BRAKING_AT_END if on_ramp else SAFE_BRAKING
        super().change_lane_policy()
        if on_ramp and self.speed < SLOW and self.target_lane_index == self.lane_index:
            for index in self.road.network.side_lanes(self.lane_index):
                if self.mobil(index):
                    self.target_lane_index = index

    def step(self, dt: float) -> None:
        """Move; a vehicle that brakes stops at a speed of 0."""
        super().step(dt)
        self.speed = max(self.speed, 0.0)

    def on_state_update(self) -> None:
        """Find the lane among those that can be reached; at a fork the vehicle is on the road that it follows."""
        network = self.road.network

        def distance(index: Any) -> float:
            elsewhere = AT_FORK if index[:2] != self.target_lane_index[:2] else 0.0
            return elsewhere + float(network.get_lane(index).distance_with_heading(self.position, self.heading))

        self.lane_index = min(self.road.near[self.lane_index[:2]], key=distance)
        self.lane = network.get_lane(self.lane_index)

    def lane_distance_to(self, other: Any, lane: Any = None) -> float:
        """Distance to another vehicle along the lane, in metres; also to a vehicle on the next lane."""
        if other is not None and lane is None and other.lane_index in self.road.next[self.lane_index]:
            return float(self.left() + other.lane.local_coordinates(other.position)[0])
        return float(super().lane_distance_to(other, lane))

    def left(self) -> float:
        """Metres to the end of the lane."""
        return float(self.lane.length - self.lane.local_coordinates(self.position)[0])

    def _stop_within(self, distance: float) -> None:
        """Brake as IDM does for an obstacle at a distance in metres, unless it is too late to stop."""
        if self.speed**2 > 2 * LATEST * max(distance, 0.0):
            return
        desired = self.speed * self.TIME_WANTED
        desired += self.speed**2 / (2 * np.sqrt(-self.COMFORT_ACC_MAX * self.COMFORT_ACC_MIN))
        braking = self.COMFORT_ACC_MAX * (1 - ((1.0 + desired) / max(distance, 0.1)) ** 2)
        self.action["acceleration"] = max(min(self.action["acceleration"], float(braking)), -HARDEST)

    def _must_wait(self) -> bool:
        """Whether another vehicle passes the gate at the end of the road first."""
        gate = self.road.scenario.gates.get((self.lane_index[:2], self.following()))
        if gate is None:
            return False
        latest = self.left() / max(self.speed, SLOWEST_START) + self.TIME_WANTED
        return any(
            vehicle.lane_index[:2] in gate.occupied
            or (vehicle.following() in gate.arriving and vehicle.left() < latest * max(vehicle.speed, SLOWEST_START))
            for vehicle in self.road.vehicles
        )

    def following(self) -> Any:
        """The road after the one that the vehicle is on; None without a route."""
        # The package drops a road from the route shortly before its end.
        return next((step[:2] for step in self.route or () if step[0] == self.lane_index[1]), None)


@functools.cache
def vehicle_class(style: Style) -> type[TrafficVehicle]:
    """The class of the vehicles of a style."""
    constants = {
        "TIME_WANTED": style.headway,
        "DISTANCE_WANTED": style.distance + LENGTH,  # the package measures between centres
        "POLITENESS": style.politeness,
        "COMFORT_ACC_MAX": style.acceleration,
        "COMFORT_ACC_MIN": -style.braking,
    }
    return type("StyledVehicle", (TrafficVehicle,), {**constants, "__doc__": "A vehicle of one style."})
