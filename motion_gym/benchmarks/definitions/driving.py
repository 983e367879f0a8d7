"""The benchmark of planning: a planner drives with the forecasts of each predictor."""

from __future__ import annotations

from motion_gym.benchmarks.definitions.traffic import MOTION, STYLES
from motion_gym.benchmarks.drives import Drives
from motion_gym.benchmarks.objects import Benchmark

SCENARIO = "roundabout"
"""Where the paths of vehicles cross, so that forecasts decide."""
ROWS = ("stand_still", *MOTION, "linear", "kalman:of=linear", "hedge:of=linear", "oracle")
"""From no forecast, as the others stand still, to an oracle."""
TRAINED = ("kalman_residual", "erm_no_sigma")
"""Rows with weights that were trained on a straight road."""
_COLUMNS = {style: f"highway:style={style},scenario={SCENARIO}" for style in STYLES}

PLANNING = Benchmark(
    "planning",
    "Planning: how well a planner drives with the forecasts of each predictor",
    drives=(
        Drives("A roundabout, the others react", _COLUMNS, ROWS, TRAINED, "vehicles"),
        Drives("A roundabout, the others drive as recorded", _COLUMNS, ROWS, TRAINED, "vehicles", others="replay"),
    ),
)
