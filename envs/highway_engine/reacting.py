"""Traffic that reacts to an ego vehicle which something else drives."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from motion_gym.envs.highway_engine.continuation import vehicles_of
from motion_gym.envs.highway_engine.roads import SCENARIOS, TrafficRoad
from motion_gym.envs.highway_engine.styles import Style
from motion_gym.envs.highway_engine.traffic import EVERY, STEP
from motion_gym.envs.highway_engine.vehicles import LENGTH, TrafficVehicle, vehicle_class

MOST_POINTS = 16
"""About the number of points of a path at which its roads are looked up."""


class EgoVehicle(TrafficVehicle):
    """A vehicle on the road that is moved by ``place``; the others see it as they see each other."""

    def act(self, action: Any = None) -> None:
        """Decide nothing."""

    def step(self, dt: float) -> None:
        """Stay; ``place`` moves the vehicle."""

    def place(self, state: np.ndarray) -> None:
        """Move the vehicle to a state [4]: x, y, heading and speed, with y down."""
        self.position, self.heading, self.speed = state[:2].copy(), float(state[2]), float(state[3])
        self.on_state_update()
        self.target_lane_index = self.lane_index


class ReactingWorld:
    """Vehicles around an ego vehicle, simulated on from their histories by IDM and MOBIL.

    Args:
        scenario: Name of the scenario.
        style: Style of the others.
        history: [N, 8, 2] metres, y up.
        ego: [4] state of the ego vehicle: x, y, heading, speed.
        path: [P, 2] its path, which tells where it will turn.
        side: Side of the road on which vehicles drive, ``"right"`` or ``"left"``.
    """

    def __init__(self, scenario: str, style: Style, history: np.ndarray, ego: np.ndarray, path: np.ndarray, side: str):
        # The package's y points down, and traffic on the left is mirrored once more.
        self._mirror = np.array((1, 1, 1, 1) if side == "left" else (1, -1, -1, 1))
        self.road = TrafficRoad(SCENARIOS[scenario](), np.random.default_rng(0))
        state = ego * self._mirror
        kind = type("StyledEgo", (EgoVehicle, vehicle_class(style)), {})
        route = _route(self.road, path * self._mirror[:2])
        self.ego: Any = kind(self.road, state[:2], float(state[2]), float(state[3]), route=route)
        self.ego.check_collisions = False
        self.road.vehicles.append(self.ego)
        self.vehicles: list[Any] = vehicles_of(self.road, style, history * self._mirror[:2])
        self.here = np.ones(len(self.vehicles), bool)

    def advance(self, ego: np.ndarray) -> np.ndarray:
        """States [T, N, 4] of the others after each 0.1 s, while the ego vehicle drives through states [T, 4].

        Rows of vehicles that have left the road are NaN.
        """
        states = np.full((len(ego), len(self.vehicles), 4), np.nan)
        for step, state in enumerate(ego * self._mirror):
            self.road.act()
            self.road.step(STEP)
            self.ego.place(state)
            for number in np.flatnonzero(self.here):
                vehicle = self.vehicles[number]
                if vehicle.lane_index[1] not in self.road.network.graph and vehicle.left() < LENGTH / 2:
                    self.road.vehicles.remove(vehicle)
                    self.here[number] = False
                else:
                    states[step, number] = (*vehicle.position, vehicle.heading, vehicle.speed)
        return states * self._mirror

    def future(self, ego: np.ndarray) -> np.ndarray:
        """Positions [N, 12, 2] each 0.4 s, if the ego vehicle drives through states [48, 4]; of a copy of the world."""
        return self._copy().advance(ego)[EVERY - 1 :: EVERY, :, :2].swapaxes(0, 1)

    def _copy(self) -> ReactingWorld:
        """A copy that shares the road network, which does not change."""
        twin, road = copy.copy(self), copy.copy(self.road)
        road._placed = {}
        copies = {vehicle: copy.copy(vehicle) for vehicle in self.road.vehicles}
        for vehicle in copies.values():
            vehicle.road, vehicle.position = road, vehicle.position.copy()
            vehicle.route, vehicle.action = vehicle.route and list(vehicle.route), dict(vehicle.action)
        road.vehicles = [copies[vehicle] for vehicle in self.road.vehicles]
        twin.road, twin.ego, twin.here = road, copies[self.ego], self.here.copy()
        twin.vehicles = [copies.get(vehicle) for vehicle in self.vehicles]
        return twin


def _route(road: Any, path: np.ndarray) -> list[Any]:
    """The roads that a path [P, 2] with y down follows, as a route."""
    heading = np.arctan2(*np.diff(path, axis=0).T[::-1])
    every = max(len(heading) // MOST_POINTS, 1)
    lanes = [road.network.get_closest_lane_index(p, h) for p, h in zip(path[:-1:every], heading[::every], strict=True)]
    return [lane for number, lane in enumerate(lanes) if number == 0 or lane[:2] != lanes[number - 1][:2]]
