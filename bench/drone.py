"""Drone video: the time to read all windows of the Stanford Drone Dataset, and to score ``heatmap`` on them.

Needs the data and the weights of ``heatmap``, see docs/drone-video.md; without them it prints a line that says so.
"""

import time

import torch
from machine import machine

import motion_gym
from motion_gym.benchmarks.definitions.drone import GROUND, SPEEDS
from motion_gym.contract import MotionGymError


def main():
    torch.set_num_threads(1)
    print(f"Drone video. {machine()}; torch {torch.__version__}, 1 thread")
    try:
        start = time.perf_counter()
        domain = motion_gym.domain("sdd:class=all")
        count = sum(len(domain.windows(split).future) for split in ("train", "val", "test"))
        print(f"all {count} windows of the tables read in {time.perf_counter() - start:.2f} s")
        for k in (1, 20):
            start, count = time.perf_counter(), 0
            for speed in SPEEDS:
                card = motion_gym.evaluate("heatmap:weights=sdd", f"sdd:speed={speed},{GROUND}", k=k, verify=False)
                count += card.metrics["ADE"].agent_windows
            print(f"heatmap, k = {k}: {count} windows of all speeds scored in {time.perf_counter() - start:.1f} s")
    except MotionGymError as error:
        print(f"not measured: {error}")


if __name__ == "__main__":
    main()
