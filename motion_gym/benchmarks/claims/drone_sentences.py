"""The claims of the documentation about drone video, with their tests; see ``sentences``."""

from __future__ import annotations

from collections.abc import Mapping

from motion_gym.benchmarks.claims.claim_tests import Test, lower, mean
from motion_gym.benchmarks.definitions.drone import ADAPTERS, ALL, FEW, TRANSFERRED
from motion_gym.benchmarks.objects import FILTERS, NOWHERE

TUNED = TRANSFERRED[1:]
"""All rows that are tuned."""
MODULATOR, LOW_RANK = ADAPTERS
BATCHES = [str(number) for number in FEW if number]

SPEEDS: Mapping[str, Test] = {
    "Without transfer heatmap has a lower error in the fastest domain than the training-free rows": lower(
        ["heatmap"], FILTERS, ["0"], panel="2"
    ),
    "Low-rank adapters have a lower mean error than tuning everything at 1 to 5 batches": mean(
        [LOW_RANK], ALL, BATCHES, panel="2"
    ),
    "At 5 batches the modulator is not better than tuning everything": lower(
        [MODULATOR], ALL, ["5"], panel="2", where=NOWHERE
    ),
    "By the published protocol, best of 20, adapters have a lower error than tuning everything at 3 batches": lower(
        ADAPTERS, ALL, ["3"], panel="4, best of 20"
    ),
    "By the published protocol, best of 20, they have a lower mean error at 1 to 5 batches": mean(
        ADAPTERS, ALL, BATCHES, panel="4, best of 20"
    ),
    "By the published protocol, best of 20, no tuning lowers the mean error": mean(
        [*ALL, *ADAPTERS], ["heatmap"], BATCHES, panel="4, best of 20", where=NOWHERE
    ),
    "By the published protocol, k = 1, adapters lower the mean error at 1 to 5 batches": mean(
        ADAPTERS, ["heatmap"], BATCHES, panel="4"
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
        ADAPTERS, ALL, ["30"], panel="0", where=NOWHERE
    ),
    "With 30 scenes of bikers tuning the last layer does not lower the mean error": mean(
        TUNED[-1:], ["heatmap"], ["30"], panel="0", where=NOWHERE
    ),
    "With 20 scenes of fast bikers tuning any part lowers the mean error": mean(TUNED, ["heatmap"], ["20"], panel="1"),
}
