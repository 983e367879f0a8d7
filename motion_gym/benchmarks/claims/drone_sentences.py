"""The claims of the documentation about drone video, with their tests; see ``sentences``."""

from __future__ import annotations

from collections.abc import Mapping

from motion_gym.benchmarks.claims.claim_tests import Test, lower, mean
from motion_gym.benchmarks.objects import FILTERS, NOWHERE

HEAT_ALL, HEAT_MODULATOR, HEAT_LOW_RANK, HEAT_LAST = HEAT_TUNED = [
    f"transfer:of=heatmap,parts={parts}" for parts in ("all", "modulator", "low_rank", "last_layer")
]
BATCHES = ("1", "2", "3", "4", "5")

SPEEDS: Mapping[str, Test] = {
    "Without transfer heatmap has a lower error in the fastest domain than the training-free rows": lower(
        ["heatmap"], FILTERS, ["0"], panel="2"
    ),
    "Low-rank adapters have a lower mean error than tuning everything at 1 to 5 batches": mean(
        [HEAT_LOW_RANK], [HEAT_ALL], BATCHES, panel="2"
    ),
    "At 5 batches the modulator is not better than tuning everything": lower(
        [HEAT_MODULATOR], [HEAT_ALL], ["5"], panel="2", where=NOWHERE
    ),
    "By the published protocol, best of 20, adapters have a lower error than tuning everything at 3 batches": lower(
        [HEAT_MODULATOR, HEAT_LOW_RANK], [HEAT_ALL], ["3"], panel="4, best of 20"
    ),
    "By the published protocol, best of 20, they have a lower mean error at 1 to 5 batches": mean(
        [HEAT_MODULATOR, HEAT_LOW_RANK], [HEAT_ALL], BATCHES, panel="4, best of 20"
    ),
    "By the published protocol, best of 20, no tuning lowers the mean error": mean(
        [HEAT_ALL, HEAT_MODULATOR, HEAT_LOW_RANK],
        ["heatmap"],
        BATCHES,
        panel="4, best of 20",
        where=NOWHERE,
    ),
    "By the published protocol, k = 1, adapters lower the mean error at 1 to 5 batches": mean(
        [HEAT_MODULATOR, HEAT_LOW_RANK], ["heatmap"], BATCHES, panel="4"
    ),
}
BIKERS: Mapping[str, Test] = {
    "Without transfer heatmap has a lower mean error on bikers than the training-free rows": mean(
        ["heatmap"], FILTERS, ["0"], panel="0"
    ),
    "Without transfer heatmap has a lower error on fast bikers than the training-free rows": lower(
        ["heatmap"], FILTERS, ["0"], panel="1"
    ),
    "With 30 scenes of bikers no adapter has a lower mean error than tuning everything": mean(
        [HEAT_MODULATOR, HEAT_LOW_RANK], [HEAT_ALL], ["30"], panel="0", where=NOWHERE
    ),
    "With 30 scenes of bikers tuning the last layer does not lower the mean error": mean(
        [HEAT_LAST], ["heatmap"], ["30"], panel="0", where=NOWHERE
    ),
    "With 20 scenes of fast bikers tuning any part lowers the mean error": mean(
        HEAT_TUNED, ["heatmap"], ["20"], panel="1"
    ),
}
