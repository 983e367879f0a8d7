"""Seconds of a training epoch of STGAT and of an evaluation, beside the arithmetic floor.

The floor is the multiply-adds of all matrix products of an epoch (forward, and twice that backward) over the rate that
one large matrix product reaches here: no program that computes the same sums in single precision is faster.
"""

import time

import numpy as np
import torch
from machine import machine

import motion_gym
from motion_gym.predictors.networks.stgat_network import DECODER, GRAPH, TRAJECTORY
from motion_gym.predictors.stgat import Erm
from motion_gym.training import plans as training_plans

RELEASED = {1: 0.7, 2: 5.5, 3: 6.5}
"""Seconds of the released program's epochs on 2 cores."""


def multiply_adds(scenes: np.ndarray, stage: int) -> int:
    """Of the forward pass of one epoch, for scenes of so many agents."""
    agents, pairs = int(scenes.sum()), int((scenes**2).sum())
    trajectory = agents * 8 * (3 + TRAJECTORY + 1) * 4 * TRAJECTORY
    graph = agents * 8 * (2 * GRAPH + 1) * 4 * GRAPH
    attention = agents * 8 * (32 * (64 + 8) + 64 * (32 + 2)) + pairs * 8 * (64 + 32)
    decoder = agents * 12 * (DECODER + 3) * 4 * DECODER
    return trajectory + (stage > 1) * (graph + attention) + (stage > 2) * decoder


def rate() -> float:
    """Multiply-adds per second of a product of two matrices of 2048 rows."""
    a, b = torch.randn(2048, 2048), torch.randn(2048, 2048)
    torch.mm(a, b)
    times = []
    for _ in range(5):
        began = time.perf_counter()
        torch.mm(a, b)
        times.append(time.perf_counter() - began)
    return 2048**3 / min(times)


def best_epoch(seeds: int, stage: int, device: str, repeats: int) -> float:
    """Best seconds of an epoch of a stage, the first left out."""
    plan, seen = [0, 0, 1], [0.0]
    plan[stage - 1] = repeats + 1
    Erm().fit(*DATA, list(range(seeds)), epochs=plan, device=device, report=lambda p: seen.append(p.seconds))
    return min(np.diff(seen)[1 : repeats + 1])


def epochs(seeds: int, device: str = "cpu", repeats: int = 3) -> dict[int, float]:
    """Best seconds of an epoch of each stage, validation included."""
    return {stage: best_epoch(seeds, stage, device, repeats) for stage in (1, 2, 3)}


if __name__ == "__main__":
    DATA = training_plans.training("spurious").data()
    sizes = np.concatenate([np.diff(truth.observation.scene) for truth in DATA[0]])
    print(f"STGAT, eth split, {len(sizes)} scenes, {sizes.sum()} agent-windows, 64 scenes a step. {machine()}")
    print(
        f"torch {torch.__version__}, {torch.get_num_threads()} threads; best of 3 epochs, stage 3 with its validation"
    )
    speed = rate()
    print(f"one large matrix product: {2e-9 * speed:.0f} GFLOP/s")
    one, five = epochs(1), epochs(5)
    for stage in (1, 2, 3):
        floor = 3 * multiply_adds(sizes, stage) / speed
        print(
            f"stage {stage}: one seed {one[stage]:.2f} s (released program {RELEASED[stage]} s, floor {floor:.2f} s); "
            f"five seeds {five[stage]:.2f} s, {five[stage] / one[stage] / 5:.2f} of five single seeds"
        )
    if torch.cuda.is_available():
        one, five = epochs(1, "cuda"), epochs(5, "cuda")
        print("; ".join(f"cuda, stage {s}: one seed {one[s]:.2f} s, five {five[s]:.2f} s" for s in (1, 2, 3)))
    place = [motion_gym.domain(f"eth:alpha={alpha}") for alpha in (1, 2, 4, 8, 16, 32, 64)]
    for k in (1, 20):
        for domain in place:
            domain.windows("test")
        began = time.perf_counter()
        for domain in place:
            motion_gym.evaluate("erm", domain, k=k)
        print(f"one seed evaluated over seven alphas, k = {k}: {time.perf_counter() - began:.2f} s")
