"""Benchmarks on simulated traffic: shifts of style, of driving side and of scenario, and a spurious feature."""

from __future__ import annotations

from motion_gym.benchmarks.objects import FILTERS, Benchmark, Drawing, Part, Study
from motion_gym.benchmarks.published import ALPHAS

STYLES = ("calm", "normal", "assertive", "brisk", "aggressive")
"""Driving styles; the first three are those of training, ``brisk`` lies between two of them, ``aggressive`` beyond."""
TRAINED_STYLES = STYLES[:3]
SCENARIOS = ("merge", "roundabout", "intersection")
"""Scenarios that are not trained on."""
MOTION = (*FILTERS, "constant_acceleration", "constant_turn")
"""Training-free rows."""
TRAINED = ("kalman_residual", "ego_erm", "ego_modular", "erm_no_sigma", "modular_stgat")
"""Rows with weights."""
WITH_SIGMA = ("erm", "invariant:penalty=0.01")
"""Rows with weights and sigma. The paper's lambda is 5; steps are 25 times as long here, see ``Invariant``."""
CODED = "modular_stgat:weights=vehicles,seed=0"
"""The row whose style codes are drawn."""
NOISY = "highway:style=normal"
"""The domain with sigma."""

_COLUMNS = {
    **{style: f"highway:style={style}" for style in STYLES},
    "left side": "highway:style=normal,side=left",
    **{scenario: f"highway:style=normal,scenario={scenario}" for scenario in SCENARIOS},
}
_COUNTED = {
    f"{scenario}, {style}": f"highway:style={style},scenario={scenario}" for scenario in SCENARIOS for style in STYLES
}

VEHICLES = Benchmark(
    "vehicles",
    "Traffic: driving styles, a driving side and roads other than those of training",
    (
        Part(
            "Traffic: trained with calm, normal and assertive drivers on a straight road",
            _COLUMNS,
            (*MOTION, "linear", "idm_oracle"),
            TRAINED,
            "vehicles",
            pooled={"IID": TRAINED_STYLES},
        ),
    ),
    studies=(
        Study(
            "driving_styles",
            "motion_gym.benchmarks.studies.driving_styles:driving_styles",
            "motion_gym.benchmarks.reports.traffic_tables:driving_styles",
            arguments={
                "domains": {style: _COLUMNS[style] for style in STYLES},
                "trained": TRAINED_STYLES,
                "lane_width": 4.0,
                "vehicle_length": 5.0,
                "following": 4.0,
                "counted": _COUNTED,
            },
            reads=(*(_COLUMNS[style] for style in STYLES), *_COUNTED.values()),
        ),
        Study(
            "style_codes",
            "motion_gym.benchmarks.studies.style_codes:style_codes",
            draw="motion_gym.benchmarks.reports.figures:style_codes",
            file="style_codes.svg",
            arguments={
                "row": CODED,
                "domains": {style: _COLUMNS[style] for style in STYLES},
                "trained": TRAINED_STYLES,
            },
            uses=(CODED,),
            reads=tuple(_COLUMNS[style] for style in STYLES),
        ),
    ),
)

VEHICLES_SPURIOUS = Benchmark(
    "vehicles_spurious",
    "Traffic: how far predictors trust sensor noise that correlates with braking",
    (
        Part(
            "Sensor noise that correlates with braking: trained with alpha 1, 2 and 4, each with another style",
            {str(alpha): f"{NOISY},alpha={alpha}" for alpha in ALPHAS},
            (*MOTION, "linear", "linear:sigma=true", "linear:sigma=relative"),
            WITH_SIGMA,
            "vehicles_spurious",
        ),
        Part(
            "Sensor noise from the past: no side channel",
            {str(alpha): f"{NOISY},alpha={alpha},sigma=past" for alpha in ALPHAS},
            (*FILTERS, "linear", "linear:sigma=true", "linear:sigma=relative"),
        ),
    ),
    drawings=(Drawing("ade.svg", "alpha (trained with 1, 2 and 4)", log=True),),
)
