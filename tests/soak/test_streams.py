"""Long streams: memory stays flat."""

from __future__ import annotations

import gc

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import Recording
from motion_gym.data.domains import RecordedDomain
from motion_gym.stepping.harness import ask
from motion_gym.stepping.stream_clock import StreamClock
from tests.taped import fitted_linear

STEPS = 200_000
"""Frames; an hour at 2.5 Hz has 9,000."""
GROWTH = 8.0
"""Most MiB by which memory may grow from the first to the last quarter."""


def long_recording(frames: int) -> Recording:
    """Two or three people at any time, each for 40 frames."""
    start = np.arange(0, frames - 40, 16)
    frame = (start[:, None] + np.arange(40)).ravel()
    agent = np.repeat(np.arange(len(start)), 40)
    xy = np.random.default_rng(0).normal(size=(len(frame), 2)).cumsum(axis=0) % 50
    order = np.lexsort((agent, frame))
    return Recording(frame[order], agent[order], xy[order], 0.4)


class Long(RecordedDomain):
    """One long recording."""

    name = "long"

    def recordings(self, split):
        return [long_recording(STEPS // 10)]


def resident() -> float:
    """MiB of memory that the process holds now."""
    gc.collect()
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 2**20


def test_the_clock(tally):
    predictor = motion_gym.predictor("constant_velocity")
    clock, sizes = StreamClock([long_recording(STEPS)], keep=False), []
    step, quarter = clock.reset(), clock.scenes // 4
    for number in range(1, clock.scenes + 1):
        step = clock.step(ask(predictor, step.observation))
        if number % quarter == 0:
            sizes.append(resident())
    with tally(f"memory flat over {STEPS:,} frames of the stream clock", sizes):
        assert not len(step.observation) and len(clock.ledger) == 0
        assert sizes[3] - sizes[0] < GROWTH


@pytest.mark.parametrize("adapter", ["none", "hedge"])
def test_online_evaluation(adapter, tally):
    place, sizes = Long(), []
    learner = motion_gym.adapter(adapter, "kalman_velocity" if adapter == "none" else fitted_linear())

    def report(done, total, _):
        if len(sizes) < 3 and done >= (len(sizes) + 1) * total // 4:
            sizes.append(resident())

    motion_gym.evaluate_online(learner, motion_gym.stream([place]), report=report)
    sizes.append(resident())
    with tally(f"memory flat over {STEPS // 10:,} frames of `evaluate_online`", (adapter, sizes)):
        assert len(sizes) == 4 and sizes[3] - sizes[0] < GROWTH
