"""Benchmarks on simulated crowds, whose style is the separation distance d."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from motion_gym.benchmarks.objects import FILTERS, NOWHERE, Benchmark, Claim, Drawing, Part, Study
from motion_gym.benchmarks.row_specs import weighted

STYLES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Separation distances d that predictors are tested on."""
REFERENCES = 64
"""Reference scenes that predictors with a style receive in the tables."""
EGO = ("ego_erm", "ego_modular")
REFINED = ("modular", "refine:of=modular")
TUNED = ("all", "style", "modulator", "last_layer")
"""Every value of the parameter `parts` of `transfer`."""
TRIED = tuple((epochs, rate) for rate in (1e-4, 3e-4, 1e-3, 3e-3) for epochs in (10, 30, 100))
"""Epochs and learning rates that are compared on a held-out style."""
OVER_D = "d in metres (trained with 0.1, 0.3 and 0.5)"


def _styles(
    title: str,
    trained: Sequence[str],
    weights: str,
    more: str = "",
    plain: Sequence[str] = ("orca_oracle",),
    **how: Any,
) -> Part:
    domains = {str(d): f"orca:d={d}{more}" for d in STYLES}
    return Part(title, domains, plain, trained, weights, pooled={"IID": ("0.1", "0.3", "0.5")}, **how)


def _shots(title: str, d: float, batches: Sequence[int], trained: Sequence[str], weights: str, **how: Any) -> Part:
    domains = {str(n): f"orca:d={d}" for n in batches}
    shots = {str(n): 64 * n for n in batches if n}
    return Part(title, domains, FILTERS, trained, weights, references=0, shots=shots, **how)


STYLE = Benchmark(
    "style",
    "Style shift: crowds that keep another distance than those of training",
    (
        _styles(
            "Style shift: trained with d = 0.1, 0.3, 0.5",
            ("style_erm", "style_invariant", "modular", "modular_invariant", *EGO, "kalman_residual"),
            "style",
            plain=(*FILTERS, "linear", "orca_oracle"),
            references=REFERENCES,
        ),
        _styles(
            "Those with a style by the published protocol",
            ("modular", "modular_invariant", "ego_modular"),
            "style",
            protocol="paper",
        ),
        _styles(
            "Blind: on a circle of 7 m agents meet after the observed steps",
            EGO,
            "style/blind",
            ",radius=7",
            (*FILTERS, "linear", "orca_oracle"),
            references=REFERENCES,
        ),
    ),
    studies=(
        Study(
            "by_references",
            "motion_gym.benchmarks.studies.network_studies:by_references",
            "motion_gym.benchmarks.reports.study_tables:by_references",
            "motion_gym.benchmarks.reports.curves:by_references",
            file="references.svg",
            arguments={
                "rows": ("modular", "modular_invariant", "ego_modular"),
                "weights": "style",
                "domains": {d: f"orca:d={d}" for d in ("0.4", "0.6")},
            },
            uses=weighted(("modular", "modular_invariant", "ego_modular"), "style"),
            reads=("orca:d=0.4", "orca:d=0.6"),
        ),
    ),
    claims=(
        Claim(
            "The invariance penalty alone gives no clear advantage", ("style_invariant",), ("style_erm",), where=NOWHERE
        ),
        Claim("A style lowers the error", ("modular",), ("style_erm",)),
        Claim("An invariant encoder helps out of distribution", ("modular_invariant",), ("modular",)),
        Claim("A style lowers the error, in each agent's own frame", ("ego_modular",), ("ego_erm",)),
        Claim(
            "The closest approach as an input (ego_erm) lowers the error beyond the styles of training",
            ("ego_erm",),
            ("kalman_residual",),
            columns=("0.6", "0.7", "0.8"),
        ),
    ),
    tables=("motion_gym.benchmarks.reports.published_tables:style",),
    drawings=(Drawing("ade.svg", OVER_D),),
)

CROWD = Benchmark(
    "crowd",
    "Style shift in crowds of ten agents",
    (
        _styles(
            "Crowds of ten agents on the circle: trained with d = 0.1, 0.3, 0.5",
            ("erm_no_sigma", "modular_stgat", "ego_erm", "kalman_residual"),
            "style/crowd",
            ",agents=10,scenes=1000",
            (*FILTERS, "linear", "orca_oracle"),
            references=REFERENCES,
            samples=1,
        ),
    ),
    claims=(
        Claim("A style lowers the error of STGAT", ("modular_stgat",), ("erm_no_sigma",)),
        Claim(
            "Up to d = 0.7 a network in the frame of each agent has a lower error than STGAT with a style",
            ("ego_erm",),
            ("modular_stgat",),
            columns=("0.1", "0.2", "0.3", "0.4", "0.5", "0.6", "0.7"),
        ),
        Claim(
            "Up to d = 0.7, the filters with a small network have a lower error than STGAT with a style",
            ("kalman_residual",),
            ("modular_stgat",),
            columns=("IID", "0.1", "0.2", "0.3", "0.4", "0.5", "0.6", "0.7"),
        ),
        Claim(
            "Beyond d = 0.6 they have a lower error than the network that reads the closest approach",
            ("kalman_residual",),
            ("ego_erm",),
            columns=("0.7", "0.8"),
        ),
    ),
    drawings=(Drawing("ade.svg", OVER_D),),
)

REFINEMENT = Benchmark(
    "refinement",
    "Test-time refinement: forecasts drawn towards the style of reference scenes",
    (
        _styles(
            "Refinement towards 64 reference scenes, by the number of steps",
            ("modular_invariant", "refine:steps=1", "refine", "refine:steps=10", "refine:steps=30", *REFINED),
            "style",
            plain=FILTERS,
            references=REFERENCES,
        ),
        _styles(
            "Refinement by the published protocol",
            ("modular_invariant", "refine", *REFINED),
            "style",
            plain=FILTERS,
            protocol="paper",
        ),
    ),
    studies=(
        Study(
            "two_agents",
            "motion_gym.benchmarks.studies.network_studies:two_agents",
            draw="motion_gym.benchmarks.reports.figures:two_agents",
            file="two_agents.svg",
            arguments={"row": "modular_invariant", "weights": "style", "right": "orca:d=0.6", "wrong": "orca:d=0.1"},
            uses=weighted(("refine",), "style"),
            reads=("orca:d=0.6", "orca:d=0.1"),
        ),
    ),
    claims=(
        Claim("Refinement by 3 steps lowers the error of modular_invariant", ("refine",), ("modular_invariant",)),
        Claim("Refinement by 3 steps lowers the error of modular", ("refine:of=modular",), ("modular",)),
    ),
    drawings=(Drawing("ade.svg", OVER_D),),
)

_TRANSFERRED = ("modular_invariant", "refine", *(f"transfer:parts={parts}" for parts in TUNED), "refine:of=transfer")

TRANSFER = Benchmark(
    "transfer",
    "Low-shot transfer: tuned on a few batches of scenes of the new style",
    (
        _shots(
            "Low-shot transfer to d = 0.6, by the number of batches of 64 scenes",
            0.6,
            range(7),
            (*_TRANSFERRED, "ego_modular"),
            "style",
        ),
        _shots(
            "Low-shot transfer to d = 0.6 by the published protocol",
            0.6,
            range(7),
            _TRANSFERRED,
            "style",
            protocol="paper",
        ),
        _shots(
            "Schedules: trained with d = 0.1 and 0.3, tuned to d = 0.5",
            0.5,
            (1, 2, 6),
            [
                "modular_invariant",
                *(f"transfer:parts={parts},epochs={e},rate={r:g}" for parts in TUNED for e, r in TRIED),
            ],
            "style/held_out",
        ),
    ),
    claims=(
        Claim(
            "Tuning f alone is better than tuning everything", ("transfer:parts=modulator",), ("transfer:parts=all",)
        ),
        Claim(
            "Tuning f alone is better than tuning psi, f and g",
            ("transfer:parts=modulator",),
            ("transfer:parts=style",),
        ),
        Claim("Tuning f is better than reading the style alone", ("transfer:parts=modulator",), ("modular_invariant",)),
        Claim("Refinement lowers the error after tuning f", ("refine:of=transfer",), ("transfer:parts=modulator",)),
        Claim("Refinement lowers the error without tuning", ("refine",), ("modular_invariant",)),
    ),
    claims_over="batches",
    tables=("motion_gym.benchmarks.reports.seed_tables:schedules",),
    drawings=tuple(
        Drawing(f"{name}.svg", "batches of 64 scenes of d = 0.6", part) for part, name in enumerate(("honest", "paper"))
    ),
)

PRETRAINING = Benchmark(
    "pretraining",
    "What the pre-training of the style encoder is worth: errors during the last stage of training",
    studies=(
        Study(
            "pretraining",
            "motion_gym.predictors.training.pretraining:curves",
            "motion_gym.benchmarks.reports.study_tables:pretraining",
            "motion_gym.benchmarks.reports.curves:pretraining",
            file="curves.svg",
            uses=("modular",),
            reads=("orca:d=0.1", "orca:d=0.7"),
        ),
    ),
)
