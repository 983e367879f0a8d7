"""The traffic engine on highway-env's roads: the package is left alone, neighbours, gates, crashes and styles."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tests.traffic import needs_highway_env

needs_highway_env()

from highway_env.road.road import Road  # noqa: E402

from motion_gym.envs.highway_engine.roads import SCENARIOS, TrafficRoad  # noqa: E402
from motion_gym.envs.highway_engine.runs import simulate_runs  # noqa: E402
from motion_gym.envs.highway_engine.styles import STYLES  # noqa: E402
from motion_gym.envs.highway_engine.traffic import STEP, Traffic  # noqa: E402
from motion_gym.envs.highway_engine.vehicles import TrafficVehicle, vehicle_class  # noqa: E402

BOTH_DIRECTIONS = """
import gymnasium, hashlib, highway_env, numpy as np
from highway_env.vehicle.behavior import IDMVehicle
from motion_gym.envs.highway_engine.styles import STYLES
from motion_gym.envs.highway_engine.traffic import simulate

def constants():
    return {(c.__name__, k): repr(v) for c in IDMVehicle.__mro__ for k, v in vars(c).items() if k.isupper()}

def ours():
    return hashlib.sha256(simulate("roundabout", STYLES["normal"], 8.0, [3]).xy.tobytes()).hexdigest()

def theirs():
    env = gymnasium.make("highway-fast-v0")
    seen = [env.reset(seed=0)[0]] + [env.step(1)[0] for _ in range(3)]
    return hashlib.sha256(np.concatenate(seen).tobytes()).hexdigest()

before, episode = constants(), theirs()
tracks = ours()
assert constants() == before, "simulating changes no constant of the package"
assert theirs() == episode, "simulating changes no episode of the package"
gymnasium.make("intersection-v1").reset(seed=0)
assert constants() != before, "this environment writes constants of the package's vehicles"
assert ours() == tracks, "an environment of the package changes nothing here"
"""


def filled(scenario: str, style: str = "normal", seconds: float = 20.0) -> Traffic:
    """Traffic after some time."""
    traffic = Traffic(TrafficRoad(SCENARIOS[scenario](), np.random.default_rng(0)), STYLES[style])
    for _ in range(round(seconds / STEP)):
        traffic.step()
    return traffic


def placed(traffic: Traffic, lane, position: float, speed: float, **options) -> TrafficVehicle:
    """A vehicle that is put on a lane."""
    vehicle = traffic.kind.make_on_lane(traffic.road, lane, position, speed)
    for name, value in options.items():
        setattr(vehicle, name, value)
    traffic._numbers[vehicle] = 1000 + len(traffic._numbers)
    traffic.road.vehicles.append(vehicle)
    traffic.road._placed.clear()
    return vehicle


def test_the_package_and_the_engine_leave_each_other_alone():
    done = subprocess.run([sys.executable, "-c", BOTH_DIRECTIONS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_constant_is_set_on_the_class_of_a_style():
    kind = vehicle_class(STYLES["calm"])
    own = {**vars(TrafficVehicle), **vars(kind)}
    package = {name for base in TrafficVehicle.__mro__[1:] for name in vars(base) if name.isupper()}
    assert len(package) > 20 and package <= set(own)
    assert kind is vehicle_class(STYLES["calm"]) and kind is not vehicle_class(STYLES["normal"])


def test_neighbours_are_those_of_the_package():
    traffic = filled("straight")
    road, compared = traffic.road, 0
    road._placed.clear()
    settled = [v for v in road.vehicles if v.lane_index == v.target_lane_index]
    road.vehicles[:] = settled  # here a vehicle that changes lane is on both lanes
    for vehicle in settled:
        for lane in range(3):
            index = ("west", "east", lane)
            assert road.neighbour_vehicles(vehicle, index) == Road.neighbour_vehicles(road, vehicle, index)
            compared += 1
    assert compared > 30


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_every_vehicle_on_a_lane_is_found_there(scenario):
    road = TrafficRoad(SCENARIOS[scenario](), np.random.default_rng(0))
    kind, rng = vehicle_class(STYLES["normal"]), np.random.default_rng(1)
    lanes = road.network.lanes_dict()
    for lane in lanes.values():
        for s in rng.uniform(-6, lane.length + 6, 20):
            road.vehicles.append(kind(road, lane.position(s, rng.uniform(-4, 4)), lane.heading_at(s), 5.0))
    for index, lane in lanes.items():
        coordinates = [lane.local_coordinates(vehicle.position) for vehicle in road.vehicles]
        there = [
            (s, vehicle)
            for (s, lateral), vehicle in zip(coordinates, road.vehicles, strict=True)
            if vehicle.target_lane_index == index or lane.on_lane(vehicle.position, s, lateral, margin=1)
        ]
        assert len(there) > 15 and road.placed(index) == there


def test_a_follower_sees_a_leader_on_the_next_road():
    traffic = filled("merge", seconds=0)
    rear = placed(traffic, ("a", "b", 1), 200.0, 20.0)
    front = placed(traffic, ("b", "c", 1), 10.0, 20.0)
    assert traffic.road.neighbour_vehicles(rear)[0] is front and traffic.road.neighbour_vehicles(front)[1] is rear
    assert rear.lane_distance_to(front) == pytest.approx(30.0)
    ramp = placed(traffic, ("k", "b", 0), 60.0, 20.0)
    assert traffic.road.neighbour_vehicles(ramp)[0] is None, "the lanes beside the ramp do not continue it"


def test_vehicles_that_crash_are_removed_and_counted():
    traffic = filled("straight", seconds=0)
    placed(traffic, ("west", "east", 0), 100.0, 20.0)
    placed(traffic, ("west", "east", 0), 103.0, 20.0)
    clear = placed(traffic, ("west", "east", 2), 100.0, 20.0)
    traffic.step()
    assert len(traffic.crashed) == 2
    assert [v for v in traffic.road.vehicles if v.crashed] == [] and clear in traffic.road.vehicles


def test_a_vehicle_waits_at_a_gate_until_the_circle_is_free():
    traffic = filled("roundabout", seconds=0)
    route = traffic.scenario.entries[0].routes[0]
    waiting = placed(traffic, route[1][:3], 10.0, 5.0, route=list(route[1:]), target_speed=8.0)
    circle = placed(traffic, ("e3", "e2", 0), 1.0, 0.0, target_speed=1e-9)
    traffic.scenario.entries[:] = []
    for _ in range(100):
        traffic.step()
    assert waiting.speed < 0.5 and waiting.lane_index == route[1]
    traffic.road.vehicles.remove(circle)
    for _ in range(50):
        traffic.step()
    assert waiting.lane_index[:2] in {step[:2] for step in route[2:]}


def test_a_vehicle_on_a_ramp_waits_before_its_end():
    traffic = filled("merge", seconds=0)
    traffic.scenario.entries[:] = []
    vehicle = placed(traffic, ("b", "c", 2), 50.0, 20.0, target_speed=20.0, enable_lane_change=False)
    for _ in range(200):
        traffic.step()
    assert vehicle in traffic.road.vehicles and vehicle.speed < 0.5 and 0 < vehicle.left() < 40


def test_no_vehicle_drives_backwards_and_all_leave():
    traffic = filled("merge")
    traffic.scenario.entries[:] = []
    while traffic.road.vehicles:
        traffic.step()
        assert all(v.speed >= 0 for v in traffic.road.vehicles)
    assert not traffic._numbers


def test_three_processes_simulate_the_same_tracks():
    seeds = [(5, 0)] * 3  # one run for each process
    arguments = ("roundabout", STYLES["calm"], 8.0, seeds, "test")
    one, three = (simulate_runs(*arguments, processes=number) for number in (1, 3))
    assert all(np.array_equal(one[name], three[name]) for name in one)
    runs = [three["xy"][three["frame"] // 20 == number] for number in range(3)]
    assert len(runs[0]) > 50 and all(np.array_equal(runs[0], run) for run in runs[1:])
    assert len(np.unique(three["agent"])) == three["vehicles"][:, 0].sum()
