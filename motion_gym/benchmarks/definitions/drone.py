"""Benchmarks on drone video: domains by speed, and low-shot transfer to another speed or another class."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from motion_gym.benchmarks.objects import FILTERS, SAMPLES, Benchmark, Claim, Drawing, Part

SPEEDS = ("0.25-0.75", "1.25-1.75", "2.25-2.75", "3.25-3.75")
PLAIN = (*FILTERS, "stand_still", "linear")
GROUND = "image=true,background=labels"
"""Observations hold label maps of the ground, which show no people."""
PARTS_OF_TIME = "split=0.2 0.2 0.6"
"""A target domain is tuned on the first 20 % of the time of each clip, and scored on the last 60 %."""
BATCH = 8
"""Scenes of a batch, as in the released program of the paper's appendix."""
FEW = range(6)
"""Numbers of batches."""
UNITS = {"px": "in pixels", "m": "in metres by estimated scales"}
TUNED = ("all", "modulator", "low_rank", "last_layer")
"""Parts of ``heatmap`` that ``transfer`` tunes."""
TRANSFERRED = ("heatmap", *(f"transfer:of=heatmap,parts={parts}" for parts in TUNED))
ALL = TRANSFERRED[1:2]
"""Tunes all of ``heatmap``."""
ADAPTERS = TRANSFERRED[2:4]
"""The modulator of the paper, and the low-rank adapters of its successor."""
ADAPTED = ("kalman:of=heatmap", "hedge:of=heatmap", "finetune:of=heatmap,steps=30")
"""Online adapters that learn from all scenes at once. ``ekf`` learns from one scene at a time."""
TRIED = tuple((epochs, rate) for rate in (1e-4, 3e-4, 1e-3, 3e-3) for epochs in (10, 30))
"""Epochs and learning rates that are compared on a held-out speed domain."""
SCHEDULED = (
    "heatmap",
    *(f"transfer:of=heatmap,parts={parts},epochs={e},rate={r:g}" for parts in TUNED for e, r in TRIED),
)


def _shots(
    title: str, target: str, shots: Mapping[str, int], rows: Sequence[str], weights: str, unit: str = "px", **how: Any
) -> Part:
    """Rows that learn from the first scenes of a target domain; the number of scenes by column."""
    domain = f"{target},unit={unit},{GROUND},{PARTS_OF_TIME}"
    columns = dict.fromkeys(shots, domain)
    few = {name: count for name, count in shots.items() if count}
    return Part(title, columns, FILTERS, rows, weights, references=0, shots=few, **how)


def _batches(numbers: Sequence[int]) -> dict[str, int]:
    return {str(number): BATCH * number for number in numbers}


FAST, HELD_OUT = "sdd:speed=3.25-3.75", "sdd:speed=2.25-2.75"
_TO_FAST = "Low-shot transfer to 3.25-3.75, by the number of batches of 8 scenes"

SDD = Benchmark(
    "sdd",
    "Drone video: people of one speed, forecast by what was learned from people of other speeds",
    (
        *(
            Part(
                f"Stanford Drone Dataset, all windows of each speed domain, {said}",
                {speed: f"sdd:speed={speed},unit={unit}" for speed in SPEEDS},
                PLAIN,
                samples=1,
            )
            for unit, said in UNITS.items()
        ),
        _shots(f"{_TO_FAST}, in pixels", FAST, _batches(FEW), (*TRANSFERRED, *ADAPTED), "sdd", samples=1),
        _shots(
            f"{_TO_FAST}, in metres by estimated scales",
            FAST,
            _batches((0, 5)),
            (*TRANSFERRED, *ADAPTED),
            "sdd",
            "m",
            samples=1,
        ),
        _shots(
            f"{_TO_FAST}, by the published protocol",
            FAST,
            _batches(FEW),
            TRANSFERRED[:4],
            "sdd",
            protocol="paper",
            samples=SAMPLES,
        ),
        _shots(
            "Schedules: trained with 0.25-0.75 and 1.25-1.75, tuned to 2.25-2.75",
            HELD_OUT,
            _batches((1, 3, 5)),
            SCHEDULED,
            "sdd/held_out",
            samples=1,
        ),
    ),
    claims=(
        Claim("Tuning lowers the error at 5 batches", TRANSFERRED[1:], ("heatmap",), ("5",), "2"),
        Claim("At 5 batches adapters are better than tuning everything", ADAPTERS, ALL, ("5",), "2"),
        Claim("At 1 to 3 batches adapters are better, too", ADAPTERS, ALL, ("1", "2", "3"), "2"),
    ),
    claims_over="batches",
    tables=("motion_gym.benchmarks.reports.seed_tables:schedules",),
    drawings=(Drawing("honest.svg", "batches of 8 scenes of 3.25-3.75", 2),),
    short=(2,),
)

BIKERS = "sdd:scene=deathCircle,video=0,class=biker"
FAST_BIKERS = "sdd:scene=deathCircle,class=biker,speed=4-8"

SDD_STYLE = Benchmark(
    "sdd_style",
    "Drone video: from pedestrians to bikers, and from slow to fast bikers, with 30 and 20 scenes",
    tuple(
        _shots(f"{title}, {said}", target, {"0": 0, str(count): count}, TRANSFERRED, weights, unit, samples=1)
        for unit, said in UNITS.items()
        for title, target, count, weights in (
            ("deathCircle 0: trained with pedestrians, tuned to bikers", BIKERS, 30, "sdd/bikers"),
            ("deathCircle: trained with bikers of 0.5-3.5, tuned to bikers of 4-8", FAST_BIKERS, 20, "sdd/fast_bikers"),
        )
    ),
    claims=(
        Claim("Tuning on 30 scenes of bikers lowers the error", TRANSFERRED[1:], ("heatmap",), ("30",), "0"),
        Claim("Tuning on 20 scenes of fast bikers lowers the error", TRANSFERRED[1:], ("heatmap",), ("20",), "1"),
        Claim("On 30 scenes of bikers adapters are better than tuning everything", ADAPTERS, ALL, ("30",), "0"),
        Claim("On 20 scenes of fast bikers adapters are better, too", ADAPTERS, ALL, ("20",), "1"),
    ),
    claims_over="scenes",
    short=(0, 1),
)
