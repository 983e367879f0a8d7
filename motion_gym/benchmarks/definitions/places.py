"""Benchmarks on ETH-UCY: spurious shifts of a feature, the original data, and the baselines."""

from __future__ import annotations

from typing import Any

from motion_gym.benchmarks.objects import FILTERS, SAMPLES, SEEDS, Benchmark, Drawing, Part, Study
from motion_gym.benchmarks.published import ALPHAS, ORIGINAL_WEIGHTS, PAPER, as_released
from motion_gym.benchmarks.row_specs import weighted
from motion_gym.data.sdd_files import VIDEOS
from motion_gym.training.plans import PLACES

PLAIN = (*FILTERS, "linear", "linear:sigma=true", "linear:sigma=relative")
DRAWN = ("erm_no_sigma", "erm", "counterfactual", "invariant", "vrex", "group_dro", "erm:sigma=relative")
"""Predictors of the figure of one scene."""
TRAINED = (
    "erm",
    "counterfactual",
    "invariant:penalty=1",
    "invariant:penalty=3",
    "invariant",
    "vrex",
    "group_dro",
)


def _alphas(place: str, more: str = "") -> dict[str, str]:
    return {str(alpha): f"{place}:alpha={alpha}{more}" for alpha in ALPHAS}


SPURIOUS = Benchmark(
    "spurious",
    "Spurious shift: how far predictors trust a feature whose link to the future changes",
    (
        Part(
            "Spurious shift: trained with alpha 1, 2, 4, 8 at four places, tested on eth",
            _alphas("eth"),
            PLAIN,
            ("erm_no_sigma", *TRAINED, "erm:sigma=relative"),
            "spurious",
        ),
        Part(
            "Sigma from the past: no side channel",
            _alphas("eth", ",sigma=past"),
            PLAIN,
            TRAINED,
            "spurious/past",
        ),
        Part(
            "Crossed: trained with alpha 1, 2, 4, 8 at each of the four places",
            _alphas("eth"),
            FILTERS,
            ("erm",),
            "spurious/crossed",
        ),
        *(
            Part(
                f"Spurious shift, tested on {place}",
                _alphas(place),
                PLAIN,
                TRAINED,
                f"spurious/{place}",
            )
            for place in PLACES[1:]
        ),
        Part(
            "Trained as in the paper: its epochs, one recording at a time, and its penalty; tested on eth",
            _alphas("eth"),
            FILTERS,
            tuple(as_released(row) for row in PAPER),
            "paper/eth",
        ),
    ),
    studies=(
        Study(
            "left_out",
            "motion_gym.benchmarks.studies.network_studies:left_out",
            "motion_gym.benchmarks.reports.study_tables:left_out",
            arguments={"rows": PLAIN[-2:], "domain": "eth:alpha=1"},
            uses=PLAIN[-2:],
            reads=("eth:alpha=1",),
        ),
        Study(
            "one_scene",
            "motion_gym.benchmarks.studies.network_studies:one_scene",
            draw="motion_gym.benchmarks.reports.figures:one_scene",
            file="scene.svg",
            arguments={"place": "eth", "alphas": (1, 8, 64), "rows": DRAWN, "weights": "spurious"},
            uses=weighted(DRAWN, "spurious"),
            reads=("eth:alpha=1",),
        ),
    ),
    tables=("motion_gym.benchmarks.reports.published_tables:spurious",),
    drawings=tuple(
        Drawing(f"{metric.lower()}.svg", "alpha (trained with 1 to 8)", metric=metric, log=True)
        for metric in ("ADE", f"JADE_{SAMPLES}")
    ),
)

ORIGINAL = Benchmark(
    "original",
    "Original data: every place of ETH-UCY, trained on the other four",
    (
        *(
            Part(
                f"Original data, tested on {place}",
                {place: place},
                (*FILTERS, "linear"),
                # The middle one of the penalties that the paper's authors tried.
                ("erm_no_sigma", "counterfactual:sigma=false", "invariant:sigma=false,penalty=0.125"),
                f"original/{place}",
            )
            for place in PLACES
        ),
        Part(
            "Original data, trained as in the paper: its epochs, 16 scenes of each recording a step; tested on hotel",
            {"hotel": "hotel"},
            FILTERS,
            tuple(as_released(row) for row in ORIGINAL_WEIGHTS),
            "paper/hotel",
        ),
    ),
    tables=(
        "motion_gym.benchmarks.reports.published_tables:original",
        "motion_gym.benchmarks.reports.published_tables:original_hotel",
    ),
    short=(),
)

FORECASTER = "kalman_residual"
LEFT_OUT = {"eth": "eth", "eth6": "eth", **{place: place for place in PLACES[1:]}}
"""Place that the weights have not seen, by test place; ``eth6`` is eth at its true rate."""
PLANS = {place: f"original/{plan}" for place, plan in LEFT_OUT.items()}
VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "as shipped": {},
    "without the filters": {"settings": {"bank": False}},
    "without neighbours": {"settings": {"neighbours": False}},
    "without the frame of the agent": {"settings": {"heading": False}},
    "without noise in training": {"options": {"noise": 0.0}},
    "without scaling in training": {"options": {"scale": 0.0}},
    "without fast people in training": {"options": {"fast": 0.0}},
    "neighbours at any distance, none hidden": {"options": {"reach": None, "hidden": 0.0}},
    "squared loss": {"options": {"squared": True}},
}
"""Settings of the predictor and options of its training, by variant of the ablation."""

UNSEEN = Benchmark(
    "places",
    "Real places that were not trained on: filters, and forecasters trained at the other places",
    tuple(
        Part(
            f"Trained on the other places, tested on {place}",
            {place: place},
            (*FILTERS, "linear"),
            ("erm_no_sigma", FORECASTER),
            plan,
        )
        for place, plan in PLANS.items()
    ),
    studies=(
        Study(
            "against_filters",
            "motion_gym.benchmarks.studies.forecaster_study:against_filters",
            "motion_gym.benchmarks.reports.study_tables:against_filters",
            arguments={"row": FORECASTER, "places": PLANS, "filters": FILTERS, "seeds": SEEDS},
            uses=(*FILTERS, *(weighted((FORECASTER,), plan)[0] for plan in dict.fromkeys(PLANS.values()))),
            reads=tuple(PLANS),
        ),
        Study(
            "ablations",
            "motion_gym.benchmarks.studies.forecaster_study:ablations",
            "motion_gym.benchmarks.reports.study_tables:ablations",
            arguments={"row": FORECASTER, "places": PLANS, "variants": VARIANTS, "seeds": SEEDS},
            uses=(FORECASTER,),
            reads=tuple(PLANS),
        ),
        Study(
            "coverage",
            "motion_gym.benchmarks.studies.forecaster_study:coverage",
            "motion_gym.benchmarks.reports.study_tables:coverage",
            arguments={
                "rows": ("kalman_velocity",),
                "trained": (FORECASTER,),
                "places": PLANS,
                "samples": 200,
                "shares": (0.5, 0.9),
            },
            uses=("kalman_velocity", *(weighted((FORECASTER,), plan)[0] for plan in dict.fromkeys(PLANS.values()))),
            reads=tuple(PLANS),
        ),
    ),
    tables=("motion_gym.benchmarks.reports.published_tables:by_place",),
    short=(),
)

WALKERS = {
    "stand": "walkers:speed=0",
    "0.5 m/s": "walkers:speed=0.5",
    "1.3 m/s": "walkers:speed=1.3",
    "3 m/s": "walkers:speed=3",
    "6 m/s": "walkers:speed=6",
    "noise 0.1 m": "walkers:noise=0.1",
    "two, 2 m apart": "walkers:people=2",
    "two, 50 m apart": "walkers:people=2,gap=50",
    "six, 1 m apart": "walkers:people=6,gap=1",
}
"""People who walk straight on: alone, at a speed; or in company, at 1.3 m/s. The noise is 0.02 m unless named."""
WALKED = {
    "original/all": ("at all places of ETH-UCY", (FORECASTER,)),
    "original/hotel": ("at four places of ETH-UCY", ("erm_no_sigma",)),
    "style/crowd": ("on simulated crowds of ten", ("ego_erm", FORECASTER, "modular_stgat")),
}
"""What they were trained on, and rows that are tested on ``WALKERS``, by their weights."""

ELSEWHERE = Benchmark(
    "elsewhere",
    "Away from the training data: drone video of a campus with cyclists, and people who walk straight on",
    (
        Part(
            "Trained at the places of ETH-UCY, tested on the Stanford Drone Dataset, in metres by estimated scales",
            {place: f"sdd:scene={place},unit=m" for place in VIDEOS},
            FILTERS,
            (FORECASTER,),
            "original/all",
            samples=1,
        ),
        *(
            Part(
                f"Trained {where}, tested on simulated people who walk straight on; noise 0.02 m unless named",
                WALKERS,
                FILTERS,
                rows,
                weights,
                references=0,
                samples=1,
            )
            for weights, (where, rows) in WALKED.items()
        ),
    ),
    short=(0, 1),
)

FITTED = (*FILTERS, "stand_still", "linear")
ALONE = {place: f"{place}:min_agents=1" for place in PLACES}

BASELINES = Benchmark(
    "baselines",
    "Baselines on simulated crowds and on ETH-UCY",
    (
        Part(
            "Simulated crowds",
            {f"d = {d}": f"orca:d={d}" for d in (0.1, 0.3, 0.6)},
            (*FITTED, "orca_oracle"),
            samples=1,
        ),
        Part("ETH-UCY, windows of at least two complete agents", {p: p for p in PLACES}, FITTED, samples=1),
        Part("ETH-UCY, all complete agents", ALONE, FITTED, samples=1),
        Part(
            "ETH-UCY with sigma, windows of at least two complete agents",
            {f"eth, alpha = {a}": f"eth:alpha={a}" for a in (8, 64)},
            (*FILTERS, "linear", "linear:sigma=true"),
            samples=1,
        ),
        Part(
            "ETH-UCY with sigma, all complete agents",
            {f"eth, alpha = {a}": f"eth:alpha={a},min_agents=1" for a in (8, 64)},
            (*FILTERS, "linear", "linear:sigma=true"),
            samples=1,
        ),
    ),
    short=(0, 1, 2, 3, 4),
)
