"""Tables of the studies of style factors; see ``factor_studies``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from motion_gym.benchmarks.claims.panels import Panel
from motion_gym.benchmarks.reports.table import Code, Table, interval, number, spread
from motion_gym.benchmarks.studies.factor_studies import BOTH, OWN, WRONG_D, WRONG_SIDE
from motion_gym.contract import FUTURE
from motion_gym.metrics.passing import NEAR, SLOWEST

MEASURES = {"ADE": "ADE", "distance": "distance", "right": "share on the right"}


def swaps(study: Mapping[str, Any]) -> Table:
    """Errors with swapped codes, and what a swap changes."""
    rows = []
    targets = list(next(iter(study["rows"].values())))
    for row, by_target in study["rows"].items():
        for case in (OWN, BOTH, WRONG_SIDE, WRONG_D):
            cells = [spread(by_target[target]["values"][case]["ADE"]) for target in targets]
            rows.append([Code(row), "ADE", case, *cells])
        for factor in ("side", "d"):
            for measure, title in MEASURES.items():
                cells = [_change(by_target[target]["changes"][factor][measure]) for target in targets]
                rows.append([Code(row), title, f"wrong {factor} -> both right", *cells])
    caption = (
        f"ADE, {study['unit']}, k = 1, mean ± standard error over seeds, by the scenes that codes are read from "
        f"({study['references']} of each style). Own scenes: those of the scored style. Both right: the code of the "
        "side from scenes with another d, the code of d from scenes without a side; with a wrong side or d, one of the "
        "two is from scenes that do not have the scored value. A network with one code reads it from both sets "
        "together. Below: what changes when the wrong code is swapped for the right one, paired, with the 95 % "
        "interval over scenes and seeds: the error, the smallest distance between the forecasts of a scene (m), and "
        "the share of scenes whose forecasts pass on the right."
    )
    note = f"unit {study['unit']}, dt {study['dt']:g} s, horizon {FUTURE * study['dt']:g} s"
    return Table(study["title"], ["method", "measure", "codes from", *targets], rows, [note], caption)


def swap_panel(name: str, study: Mapping[str, Any]) -> Panel:
    """The panel of a study of swaps.

    Rows are such as ``modular_factors, wrong side``, and columns such as ``left 0.1, ADE``.
    """
    errors = {
        (f"{row}, {case}", f"{target}, {measure}"): np.array(values)
        for row, by_target in study["rows"].items()
        for target, stored in by_target.items()
        for case, by_measure in stored["values"].items()
        for measure, values in by_measure.items()
    }
    return Panel(name, errors, (), study["title"], "by codes")


def passing_sides(study: Mapping[str, Any]) -> Table:
    """The side on which people pass each other."""
    rows = [
        [
            Code(name),
            str(place["encounters"]),
            str(place["people"]),
            number(place["distance"]),
            interval(dict(zip(("mean", "low", "high"), place["right"], strict=True))),
        ]
        for name, place in study["places"].items()
    ]
    caption = (
        f"Encounters of two people who come within {NEAR:g} m of each other, walk at {SLOWEST:g} m/s or more in "
        "directions that differ by 120 degrees or more, and are seen one step before and after they are nearest. On "
        "the right: each has the other on its left, as in right-hand traffic. Intervals resample half-minutes of the "
        "recordings; SDD is in estimated metres."
    )
    columns = ["place", "encounters", "people", "median distance, m", "share on the right"]
    return Table("The side on which people pass each other", columns, rows, (), caption)


def _change(values: tuple[float, float, float]) -> str:
    mean, low, high = values
    return f"{mean:+.3f} ({low:+.3f} to {high:+.3f})"
