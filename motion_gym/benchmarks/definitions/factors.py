"""The benchmark of style factors: the side of passing and the distance, in combinations that were not trained on."""

from __future__ import annotations

from typing import Any

from motion_gym.benchmarks.objects import BASELINE, SEEDS, Benchmark, Part, Study
from motion_gym.benchmarks.row_specs import weighted
from motion_gym.training.plans import DISTANCES, SIDES, UNSEEN

REFERENCES = 64
"""Reference scenes of each style that is read."""
ONE_CODE, FACTORED = "modular", "modular_factors"
OTHER = {"left": "right", "right": "left"}


def _name(side: str | None, d: float) -> str:
    return f"{side or 'none'} {d:g}"


def _spec(side: str | None, d: float, more: str = "") -> str:
    return f"orca:d={d:g}{f',side={side}' if side else ''}{more}"


COMBINED = [(side, d) for side in SIDES for d in DISTANCES]
MIRRORED = [(OTHER[side], d) for side, d in UNSEEN]
"""The mirror images of the unseen combinations, which were trained on."""
POOLED = {
    "trained": tuple(_name(*one) for one in COMBINED if one not in UNSEEN),
    "unseen": tuple(_name(*one) for one in UNSEEN),
    "mirror images": tuple(_name(*one) for one in MIRRORED),
}


def _combinations(title: str, weights: str, more: str = "") -> Part:
    return Part(
        title,
        {_name(*one): _spec(*one, more) for one in COMBINED},
        (BASELINE, "linear", "orca_oracle"),
        (ONE_CODE, FACTORED),
        weights,
        references=REFERENCES,
        pooled=POOLED,
        samples=1,
    )


def _wrong(side: str, d: float) -> float:
    """Another d, which was trained on with the side."""
    return next(other for other in DISTANCES if other != d and (side, other) not in UNSEEN)


def _targets(more: str = "") -> dict[str, dict[str, str]]:
    """Domains that are scored with swapped codes; all codes but their own are read from styles of training."""
    return {
        _name(side, d): {
            "scored": _spec(side, d, more),
            "side": _spec(side, _wrong(side, d), more),
            "d": _spec(None, d, more),
            "wrong side": _spec(OTHER[side], _wrong(OTHER[side], 0.5), more),
            "wrong d": _spec(None, _wrong(side, d), more),
        }
        for side in ("left", "right")
        for d in DISTANCES
    }


def _swaps(name: str, title: str, weights: str, more: str = "") -> Study:
    arguments: dict[str, Any] = {
        "title": title,
        "rows": (ONE_CODE, FACTORED),
        "weights": weights,
        "targets": _targets(more),
        "seeds": SEEDS,
        "references": REFERENCES,
    }
    return Study(
        name,
        "motion_gym.benchmarks.studies.factor_studies:swaps",
        "motion_gym.benchmarks.reports.factor_tables:swaps",
        arguments=arguments,
        uses=weighted((ONE_CODE, FACTORED), weights),
        reads=tuple(dict.fromkeys(spec for target in _targets(more).values() for spec in target.values())),
    )


PLACES = ("eth6", "hotel", "univ", "zara1", "zara2")
REAL = {**{place: place for place in PLACES}, "sdd": "sdd:class=pedestrian,unit=m"}
"""Recordings of real people, in metres, by name."""

FACTORS = Benchmark(
    "factors",
    "Style factors: the side of passing and the distance, in combinations that were not trained on",
    (
        _combinations("Combinations of the side of passing and d", "factors"),
        _combinations("Blind: on a circle of 7 m agents meet after the observed steps", "factors/blind", ",radius=7"),
    ),
    studies=(
        _swaps("swaps", "Swaps of one factor", "factors"),
        _swaps("swaps_blind", "Swaps of one factor on the blind circle", "factors/blind", ",radius=7"),
        Study(
            "passing_sides",
            "motion_gym.benchmarks.studies.factor_studies:passing_sides",
            "motion_gym.benchmarks.reports.factor_tables:passing_sides",
            arguments={"domains": REAL},
            reads=tuple(REAL.values()),
        ),
    ),
    claims_over="side and d",
)
