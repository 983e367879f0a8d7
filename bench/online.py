"""Streams: agent-steps per second and memory over a million of them, and what each adapter costs with 50 agents."""

import resource
import time

import numpy as np
import torch
from machine import machine

import motion_gym
from motion_gym.data.domains import RecordedDomain
from motion_gym.stepping.harness import ready

AGENTS = 50
"""People in sight."""


class Crowd(RecordedDomain):
    """People who walk at random, 50 at a time; each stays for some frames."""

    name = "crowd"

    def __init__(self, frames: int = 1000, life: int = 40):
        self.frames, self.life = frames, life

    def recordings(self, split: str) -> list[motion_gym.Recording]:
        """One recording; people leave and others come, a few at each frame."""
        rng = np.random.default_rng(0)
        frame = np.repeat(np.arange(self.frames), AGENTS)
        place = np.tile(np.arange(AGENTS), self.frames)
        generation = (frame + place * self.life // AGENTS) // self.life
        xy = rng.normal(0, 0.05, (self.frames, AGENTS, 2)).cumsum(axis=0).cumsum(axis=0) * 0.02
        xy += rng.uniform(-10, 10, (1, AGENTS, 2))
        return [motion_gym.Recording(frame, generation * AGENTS + place, xy.reshape(-1, 2), self.dt)]


def peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def long_stream() -> None:
    stream = motion_gym.stream(Crowd(25_000))
    steps = stream.clock.count
    seen = []
    began = time.perf_counter()
    card = motion_gym.evaluate_online(
        "constant_velocity", stream, report=lambda done, of, what: seen.append((done / of, peak()))
    )
    spent = time.perf_counter() - began
    tenth = next(megabytes for share, megabytes in seen if share >= 0.1)
    print(
        f"constant_velocity over {steps:,} agent-steps: {steps / spent:,.0f} a second, intervals included; peak memory "
        f"{tenth} MB after a tenth, {seen[-1][1]} MB at the last step ({100 * (seen[-1][1] / tenth - 1):+.1f} %), "
        f"{peak()} MB with the intervals ({card.ade.agent_windows:,} matured forecasts)"
    )


def costs() -> None:
    stream = motion_gym.stream(Crowd(120, life=100_000))
    linear = ready("linear", motion_gym.domain("orca:d=0.3,scenes=200"))
    for of, rows in (
        (linear, ("none", "kalman", "hedge")),
        (
            "erm_no_sigma:weights=original/zara2",
            (
                "none",
                "kalman",
                "hedge",
                "finetune:parts=last_layer",
                "finetune:parts=all",
                "ema_anchor",
                "ekf:parts=last_layer",
            ),
        ),
        ("modular_stgat", ("none", "style", "kalman", "hedge", "refine:memory=16", "finetune:parts=modulator")),
    ):
        name = of if isinstance(of, str) else "linear"
        for row in rows:
            card = motion_gym.evaluate_online(motion_gym.adapter(row, of), stream, realtime=True)
            update, tick = (f"{1000 * a:.1f} / {1000 * b:.1f}" for a, b in (card.update_seconds, card.tick_seconds))
            done = f"{card.updates} updates, {card.skipped} skipped"
            print(f"{name}, {row}: update {update} ms, whole step {tick} ms; {done}")


if __name__ == "__main__":
    torch.set_num_threads(1)  # so few agents are not worth a second one
    print(f"Online, labels matured. {machine()}; torch {torch.__version__}, 1 thread")
    long_stream()
    print(f"realtime, a step of 0.4 s, {AGENTS} agents; median / 95th percentile:")
    costs()
