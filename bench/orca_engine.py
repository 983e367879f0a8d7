"""Measure the ORCA engine: how closely it agrees with RVO2, and how long it takes beside a pyrvo loop.

Run it with ``python bench/orca_engine.py`` (about half a minute). pyrvo and the test dependencies must be installed.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pyrvo
from machine import machine

from motion_gym.envs.orca_engine.simulation import simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "envs"))
from test_orca_engine import circle_crossing, feasible, rvo2


def pyrvo_loop(start, goal, radius, steps=400):
    """Simulate scene after scene with pyrvo and keep nothing: the least that a loop costs."""
    for points, goals in zip(start.tolist(), goal.tolist(), strict=True):
        simulator = pyrvo.RVOSimulator(0.02, 10.0, 10, 2.0, 2.0, radius, 1.0)
        for point in points:
            simulator.add_agent(tuple(point))
        for _ in range(steps):
            for agent, (x, y) in enumerate(goals):
                now = simulator.get_agent_position(agent)
                dx, dy = x - now.x, y - now.y
                slower = max((dx * dx + dy * dy) ** 0.5, 1.0)
                simulator.set_agent_pref_velocity(agent, (dx / slower, dy / slower))
            simulator.do_step()


def seconds(function, *args, **kwargs):
    begin = time.perf_counter()
    function(*args, **kwargs)
    return time.perf_counter() - begin


def agreement():
    print("Largest distance from pyrvo at any of 400 steps; d = 0.1, 0.3, 0.6 in turn")
    print("| agents | scenes | with an infeasible program | before the first one | to the end |")
    print("|---:|---:|---:|---:|---:|")
    for agents in (2, 5, 10):
        radius = np.resize([0.1, 0.3, 0.6], 200)
        start = circle_crossing(200, agents, radius, seed=agents)
        simulation = simulate(start, -start, radius=radius, every=1)
        error = np.linalg.norm(simulation.positions - rvo2(start, -start, radius), axis=-1).max(axis=-1)
        before = feasible(simulation)
        print(
            f"| {agents} | {len(start)} | {(~before).any(axis=1).sum()} | "
            f"{np.where(before, error, 0).max() * 1000:.6f} mm | {error.max() * 1000:.6f} mm |",
            flush=True,
        )


def speed():
    print(
        "Seconds for scenes of 400 steps, d = 0.3; the engine on one thread, the best of 3 runs or as many as take 8 s"
    )
    print("| agents | scenes | engine | pyrvo loop, scaled up | from scenes | ratio |")
    print("|---:|---:|---:|---:|---:|---:|")
    for agents, scenes, judged in ((2, 10_000, 400), (10, 1_000, 20), (20, 300, 10)):
        start = circle_crossing(scenes, agents, 0.3)
        runs = []
        while len(runs) < 3 and sum(runs) < 8:
            runs.append(seconds(simulate, start, -start, radius=0.3))
        loop = seconds(pyrvo_loop, start[:judged], -start[:judged], 0.3) * scenes / judged
        engine = min(runs)
        print(
            f"| {agents} | {scenes} | {engine:.2f} | {loop:.1f} | {judged} | {loop / engine:.0f} |",
            flush=True,
        )


def main():
    print(machine(), end="\n\n")
    agreement()
    print()
    speed()


if __name__ == "__main__":
    main()
