"""Simulates observed vehicles on: the style is known, target speeds, lanes and routes are estimated."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from motion_gym.envs.highway_engine.roads import SCENARIOS, TrafficRoad
from motion_gym.envs.highway_engine.styles import Style
from motion_gym.envs.highway_engine.traffic import EVERY, SLOW, SPREAD, STEP
from motion_gym.envs.highway_engine.vehicles import LENGTH, TrafficVehicle, vehicle_class

CHANGING = 0.3
"""Lateral speed, in m/s, from which on a vehicle changes lane."""
STANDING = 0.5
"""Below this speed, in m/s, a vehicle has the heading of its lane."""


def continued(scenario: str, style: Style, history: np.ndarray, steps: int) -> np.ndarray:
    """Simulate the vehicles of a scene on.

    Args:
        scenario: Name of the scenario.
        style: Style of all vehicles.
        history: [A, 8, 2] float64, metres, y up.
        steps: Number of steps of 0.4 s.

    Returns:
        [A, steps, 2] float64, metres, y up.
    """
    road = TrafficRoad(SCENARIOS[scenario](), np.random.default_rng(0))
    vehicles = vehicles_of(road, style, history * (1, -1))
    future = np.empty((len(vehicles), steps, 2))
    for step in range(steps):
        for _ in range(EVERY):
            road.act()
            road.step(STEP)
        future[:, step] = [vehicle.position for vehicle in vehicles]
    return future * (1, -1)


def vehicles_of(road: TrafficRoad, style: Style, history: np.ndarray) -> list[TrafficVehicle]:
    """Put observed vehicles on a road: their lanes, routes and target speeds are estimated.

    Args:
        road: The road.
        style: Style of all vehicles.
        history: [A, 8, 2] float64, metres, y down.
    """
    dt = STEP * EVERY
    moved = np.diff(history, axis=1)
    speeds = np.linalg.norm(moved, axis=-1) / dt
    accelerations = (speeds[:, -1] - speeds[:, -2]) / dt
    vehicles = [
        _placed(road, style, history[i, -1], moved[i, -1] / dt, speeds[i, -1], accelerations[i])
        for i in range(len(history))
    ]
    road.vehicles.extend(vehicles)
    for vehicle, acceleration in zip(vehicles, accelerations, strict=True):
        vehicle.target_speed = _target_speed(vehicle, acceleration, style.speed * road.scenario.speed)
    return vehicles


def _placed(
    road: TrafficRoad, style: Style, position: np.ndarray, velocity: np.ndarray, speed: float, acceleration: float
) -> TrafficVehicle:
    """A vehicle at a position [2], with the lane that its velocity [2] points to."""
    network = road.network
    heading = float(np.arctan2(velocity[1], velocity[0])) if speed > STANDING else None
    index = network.get_closest_lane_index(position, heading)
    lane = network.get_lane(index)
    s, lateral = lane.local_coordinates(position)
    along = lane.heading_at(s) if heading is None else heading
    sideways = float(speed * np.sin(along - lane.heading_at(s)))
    target = index
    if road.scenario.lane_changes and abs(sideways) > CHANGING and sideways * lateral > 0:
        beside = index[2] + (1 if sideways > 0 else -1)
        if (*index[:2], beside) in network.side_lanes(index):
            target = (*index[:2], beside)
    vehicle = vehicle_class(style)(
        road,
        position,
        along,
        max(speed + acceleration * STEP * EVERY / 2, 0.0),
        target_lane_index=target,
        route=_middle_route(road, index[:2]),
        enable_lane_change=road.scenario.lane_changes,
        timer=TrafficVehicle.LANE_CHANGE_DELAY / 2,
    )
    vehicle.check_collisions = False  # an estimate may overlap another one
    return vehicle


def _middle_route(road: TrafficRoad, here: Any) -> list[Any] | None:
    """The middle one of the remaining routes over a road, by their lengths; None if no route leads over it."""
    routes = set()
    for route in itertools.chain.from_iterable(entry.routes for entry in road.scenario.entries):
        nodes = [step[:2] for step in route]
        if here in nodes:
            routes.add(tuple(route[nodes.index(here) :]))
    ordered = sorted(routes, key=lambda route: (len(route), route))
    return list(ordered[len(ordered) // 2]) if ordered else None


def _target_speed(vehicle: TrafficVehicle, acceleration: float, mean: float) -> float:
    """The target speed with which IDM gives an acceleration in m/s^2, within the target speeds that vehicles have."""
    low, high = mean * (1 - SPREAD) * SLOW, mean * (1 + SPREAD)
    front, _ = vehicle.road.neighbour_vehicles(vehicle)
    crowding = 0.0
    if front is not None:
        gap = max(vehicle.lane_distance_to(front), LENGTH)
        crowding = float(max(vehicle.desired_gap(vehicle, front), 0.0) / gap) ** 2
    share = 1 - crowding - acceleration / vehicle.COMFORT_ACC_MAX
    if share <= 0 or vehicle.speed <= 0:
        return mean
    return float(np.clip(vehicle.speed / share ** (1 / vehicle.DELTA), low, high))
