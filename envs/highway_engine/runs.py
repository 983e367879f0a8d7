"""Many runs of a scenario, on several processes."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.envs.highway_engine.styles import Style
from motion_gym.envs.highway_engine.traffic import Run, simulate

MOST_PROCESSES = 8
SECONDS_BETWEEN_LINES = 5.0
"""Shortest time between two lines of progress on the error stream."""
WORTH_A_PROCESS = 60.0
"""Simulated seconds for which the start of a second process pays."""
SIMULATE = "import sys; sys.path[:] = {}; from motion_gym.envs.highway_engine.runs import answer; answer(*{})"
"""Code of a further process."""


def simulate_runs(
    scenario: str,
    style: Style,
    seconds: float,
    seeds: Sequence[Sequence[int]],
    label: str,
    processes: int | None = None,
) -> dict[str, np.ndarray]:
    """Simulate runs one after another, and join their tracks; the result does not depend on the number of processes.

    Args:
        scenario: Name of the scenario.
        style: Style of all vehicles.
        seconds: Recorded time of a run.
        seeds: Seed of each run.
        label: What is simulated, for the lines of progress on the error stream.
        processes: Number of processes; by default one for each core.

    Returns:
        ``frame`` [R] int64 and ``agent`` [R] int64, counted over all runs; ``xy`` [R, 2] float32, metres, y up;
        ``vehicles`` [runs, 2] int64, recorded and crashed vehicles of each run.
    """
    if processes is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        processes = min(cores, MOST_PROCESSES) if seconds * len(seeds) > WORTH_A_PROCESS else 1
    processes = max(1, min(processes, len(seeds)))
    parts = [list(seeds[number::processes]) for number in range(processes)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        others = [
            _start(folder, number, (scenario, style, seconds, part)) for number, part in enumerate(parts[1:], start=1)
        ]
        try:
            done = [_own_part(scenario, style, seconds, parts[0], label, processes)]
            for number, process in enumerate(others, start=1):
                if process.wait() == 0:
                    done.append(pickle.loads((folder / f"{number}.runs").read_bytes()))
                else:  # killed, or no memory for another process
                    done.append(_own_part(scenario, style, seconds, parts[number], label, 1))
        finally:
            for process in others:
                process.kill()
                process.wait()
    return _joined([done[number % processes][number // processes] for number in range(len(seeds))], seconds)


def _start(folder: Path, number: int, question: Any) -> subprocess.Popen[bytes]:
    """Start a process that simulates some runs. It is no fork, and needs no guard in the script of a user."""
    (folder / f"{number}.question").write_bytes(pickle.dumps(question))
    code = SIMULATE.format(sys.path, [str(folder / f"{number}.question"), str(folder / f"{number}.runs")])
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def answer(question: str, runs: str) -> None:
    """Run in a further process: simulate runs and write them."""
    scenario, style, seconds, seeds = pickle.loads(Path(question).read_bytes())
    Path(runs).write_bytes(pickle.dumps([simulate(scenario, style, seconds, seed) for seed in seeds]))


def _own_part(
    scenario: str, style: Style, seconds: float, seeds: Sequence[Sequence[int]], label: str, processes: int
) -> list[Run]:
    """Simulate runs in this process; a line of progress now and then counts those of all processes."""
    runs, last = [], time.monotonic()
    for seed in seeds:
        runs.append(simulate(scenario, style, seconds, seed))
        if time.monotonic() - last > SECONDS_BETWEEN_LINES and len(runs) < len(seeds):
            last = time.monotonic()
            share = len(runs) / len(seeds)
            print(f"{label}: {share:.0%} simulated ({processes} processes)", file=sys.stderr, flush=True)
    return runs


def _joined(runs: Sequence[Run], seconds: float) -> dict[str, np.ndarray]:
    """The tracks of runs one after another, with new numbers for the vehicles."""
    frames = 1 + max((int(run.frame.max(initial=0)) for run in runs), default=0)
    first = np.cumsum([0, *(int(run.agent.max(initial=-1)) + 1 for run in runs)])
    return {
        "frame": np.concatenate([run.frame + number * frames for number, run in enumerate(runs)]),
        "agent": np.concatenate([run.agent + shift for run, shift in zip(runs, first, strict=False)]),
        "xy": np.concatenate([run.xy for run in runs]),
        "vehicles": np.array([(run.tracks, run.crashed) for run in runs]),
    }
