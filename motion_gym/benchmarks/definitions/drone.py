"""The benchmark on drone video: domains by speed, in pixels and in metres."""

from __future__ import annotations

from motion_gym.benchmarks.objects import FILTERS, Benchmark, Part

SPEEDS = ("0.25-0.75", "1.25-1.75", "2.25-2.75", "3.25-3.75")
PLAIN = (*FILTERS, "stand_still", "linear")

SDD = Benchmark(
    "sdd",
    "Drone video: people of one speed, forecast by what was learned from people of other speeds",
    tuple(
        Part(
            f"Stanford Drone Dataset, all windows of each speed domain, {said}",
            {speed: f"sdd:speed={speed},unit={unit}" for speed in SPEEDS},
            PLAIN,
            samples=1,
        )
        for unit, said in (("px", "in pixels"), ("m", "in metres by estimated scales"))
    ),
    short=(0, 1),
)
