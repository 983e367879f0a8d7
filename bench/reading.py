"""Time to read and window the seven training files of the eth split, and to import motion_gym."""

import statistics
import subprocess
import sys
import time

from machine import machine

import motion_gym
from motion_gym.data import datasets
from motion_gym.data.domains import training_set


def reading() -> float:
    """Seconds for a fresh set of domains: checksums, reading, windowing, sigma."""
    datasets._verified.clear()
    began = time.perf_counter()
    windows = [source.windows("train") for source in motion_gym.domain("eth:alpha=1").sources()]
    seconds = time.perf_counter() - began
    assert sum(len(w.future) for w in windows) == 29809
    return seconds


def importing(module: str) -> float:
    """Seconds of ``import module`` in a fresh interpreter, start of the interpreter not included."""
    clock = "time.perf_counter()"
    code = f"import sys, time; t = {clock}; import {module}; print({clock} - t, 'torch' in sys.modules)"
    seconds, torch = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert torch == "False"
    return float(seconds)


def spread(times: list[float]) -> str:
    """Best and median of several runs: on a shared machine the two may be far apart."""
    return f"best {min(times):.3f} s, median {statistics.median(times):.3f} s of {len(times)}"


if __name__ == "__main__":
    print(f"Reading and importing. {machine()}")
    times = [reading() for _ in range(7)]
    print(f"seven training files, read, checked and windowed with sigma: {spread(times)}")
    train, validation = training_set(motion_gym.domain("eth:alpha=1"))
    began = time.perf_counter()
    motion_gym.predictor("linear:sigma=true").fit(train, validation)
    print(f"linear:sigma=true fitted to them: {time.perf_counter() - began:.3f} s")
    for module in ("motion_gym", "gymnasium"):
        times = [importing(module) for _ in range(9)]
        print(f"import {module}: {spread(times)}, torch not imported")
