"""Measure the traffic engine beside highway-env's own loop, on one process and on two.

Both loops step the same number of vehicles of one style on the same road, with a step of 0.1 s. The bare loop is
``Road.act()`` and ``Road.step()`` of highway-env with its own IDM vehicles; nobody enters, leaves or is recorded.

Run it with ``python bench/highway.py`` (about three minutes). highway-env must be installed.
"""

import subprocess
import sys
import time

import numpy as np
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle
from machine import machine

from motion_gym.envs.highway_engine.roads import SCENARIOS, TrafficRoad
from motion_gym.envs.highway_engine.runs import simulate_runs
from motion_gym.envs.highway_engine.styles import STYLES
from motion_gym.envs.highway_engine.traffic import STEP, Traffic

STYLE, FILL, SECONDS, RUNS = "normal", 40.0, 10.0, 4
LOOP = "x = 0\nfor i in range(40_000_000): x += i * i % 7"


def filled(scenario):
    """Traffic after some time, the same in every call."""
    traffic = Traffic(TrafficRoad(SCENARIOS[scenario](), np.random.default_rng(0)), STYLES[STYLE])
    for _ in range(round(FILL / STEP)):
        traffic.step()
    return traffic


def bare(scenario):
    """The package's road and vehicles, where the vehicles of ``filled`` are, with the same style."""
    traffic = filled(scenario)
    style = {name: getattr(traffic.kind, name) for name in ("TIME_WANTED", "DISTANCE_WANTED", "POLITENESS")}
    style |= {name: getattr(traffic.kind, name) for name in ("COMFORT_ACC_MAX", "COMFORT_ACC_MIN")}
    kind = type("Plain", (IDMVehicle,), style)
    road = Road(traffic.scenario.network, np_random=np.random.default_rng(0), neighbour_vehicles_connected_lanes=True)
    for v in traffic.road.vehicles:
        road.vehicles.append(
            kind(road, v.position, v.heading, v.speed, v.target_lane_index, v.target_speed, v.route and list(v.route))
        )
    return road


def seconds_per_vehicle_step(step, road):
    begin, count = time.perf_counter(), 0
    for _ in range(round(SECONDS / STEP)):
        count += len(road.vehicles)
        step()
    return (time.perf_counter() - begin) / count


def loops():
    print("Milliseconds per vehicle and step, the best of 3 interleaved runs")
    print("| scenario | vehicles | bare loop of highway-env | this engine | ratio |")
    print("|---|---:|---:|---:|---:|")
    for scenario in SCENARIOS:
        theirs, ours = [], []
        for _ in range(3):
            road = bare(scenario)
            vehicles = len(road.vehicles)

            def step(road=road):
                road.act()
                road.step(STEP)

            theirs.append(seconds_per_vehicle_step(step, road))
            traffic = filled(scenario)
            ours.append(seconds_per_vehicle_step(traffic.step, traffic.road))
        print(
            f"| {scenario} | {vehicles} | {min(theirs) * 1e3:.3f} | {min(ours) * 1e3:.3f} | "
            f"{min(ours) / min(theirs):.2f} |",
            flush=True,
        )


def busy_loops(number):
    """Seconds until equal Python loops in several processes have ended: how far the machine itself scales."""
    begin = time.perf_counter()
    loops = [subprocess.Popen([sys.executable, "-c", LOOP]) for _ in range(number)]
    for loop in loops:
        loop.wait()
    return time.perf_counter() - begin


def processes():
    print(
        f"Seconds for a test split, {RUNS} runs of 120 s on the straight road, with the start of a further process, and"
    )
    print("for the same work in plain Python loops, all in turn. Both times depend on what else the machine does.")
    print("| turn | engine, 1 process | 2 processes | times as fast | loops, times as fast |")
    print("|---:|---:|---:|---:|---:|")
    for turn in range(3):
        took = []
        for number in (1, 2):
            begin = time.perf_counter()
            simulate_runs("straight", STYLES[STYLE], 120.0, [(0, run) for run in range(RUNS)], "bench", number)
            took.append(time.perf_counter() - begin)
        alone, together = busy_loops(1), busy_loops(2)
        print(
            f"| {turn + 1} | {took[0]:.1f} | {took[1]:.1f} | {took[0] / took[1]:.2f} | {2 * alone / together:.2f} |",
            flush=True,
        )


def main():
    print(machine(), end="\n\n")
    loops()
    print()
    processes()


if __name__ == "__main__":
    main()
