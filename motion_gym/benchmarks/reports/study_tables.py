"""Tables of stored studies. They show values of ``studies`` and compute no forecasts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from motion_gym.benchmarks.reports.significance import paired_p
from motion_gym.benchmarks.reports.table import Code, Strong, Table, interval, number, p_text, spread
from motion_gym.contract import FUTURE

EPOCHS = (1, 3, 10, 30, 100)
"""Epochs of the last stage in the table of pre-training."""

Study = Mapping[str, Any]


def by_references(study: Study) -> Table:
    """Errors by the number of reference scenes; see ``studies.by_references``."""
    rows = [
        [Code(row), name, *(spread(values) for values in by_count)]
        for name, by_row in study["ade"].items()
        for row, by_count in by_row.items()
    ]
    caption = (
        f"ADE, {study['unit']}, k = 1, mean ± standard error over {len(study['seeds'])} seeds, by the number of "
        "reference scenes. Each seed has reference scenes of its own. With none, `modular` takes the mean style of "
        "training, and `ego_modular` forecasts without a style."
    )
    columns = ["method", "d", *map(str, study["counts"])]
    return Table("How many reference scenes it takes", columns, rows, [_steps(study)], caption)


def left_out(study: Study) -> Table:
    """Errors on each source that is left out of the fit; see ``studies.left_out``."""
    columns = list(next(iter(study["ade"].values())))
    rows = []
    for row, errors in study["ade"].items():
        chosen = row == study["chosen"]
        cells = [Strong(number(errors[c])) if chosen and c == "mean" else number(errors[c]) for c in columns]
        rows.append([Code(row), *cells, "chosen" if chosen else ""])
    caption = (
        f"ADE, {study['unit']}, k = 1, on the validation windows of one source, after fitting to the train windows of "
        "the others. Each place comes with its own alpha, so that leaving out a place leaves out an alpha."
    )
    heads = ["setting", *columns, ""]
    return Table("A setting chosen by leave-one-place-out validation", heads, rows, [_steps(study)], caption)


def pretraining(study: Study) -> Table:
    """Errors with and without pre-training of the style encoder; see ``predictors.training.pretraining.curves``."""
    rows = []
    for domain, variants in study["ade"].items():
        epochs = [epoch for epoch in EPOCHS if epoch <= min(map(len, variants.values()))]
        for name, values in variants.items():
            rows.append([Code(domain), name, *(spread(values[epoch - 1]) for epoch in epochs)])
        first, second = (np.array(values) for values in variants.values())
        p = [p_text(paired_p(first[epoch - 1] - second[epoch - 1])) for epoch in epochs]
        rows.append([Code(domain), "p", *p])
    caption = (
        f"ADE, {study['unit']}, on the validation windows of a domain after so many epochs of the last stage, mean ± "
        f"standard error over {len(study['seeds'])} seeds. The style is read from {study['references']} reference "
        "scenes. Both variants are trained with d = 0.1, 0.3 and 0.5 in the same stages, except that one skips the "
        "pre-training. p: two-sided t-test of the difference in pairs of seeds."
    )
    columns = ["domain", "variant", *map(str, epochs)]
    return Table("With and without pre-training of the style encoder", columns, rows, [_steps(study)], caption)


def against_filters(study: Study) -> Table:
    """A forecaster against filters at each place; see ``forecaster_study.against_filters``."""
    chosen = "; ".join(f"{place}: {name}" for place, name in study["chosen"].items())
    caption = (
        f"ADE, {study['unit']}, k = 1, mean ± standard error over seeds. In brackets: the ADE of `{study['row']}` "
        "minus that of the row, paired, with its 95 % interval over whole agents and seeds. The filter chosen on the "
        f"sources is the best one at the other places ({chosen})."
    )
    return _by_place("A forecaster against filters, at places it was not trained on", study, caption)


def ablations(study: Study) -> Table:
    """Variants of a forecaster, each trained anew; see ``forecaster_study.ablations``."""
    caption = (
        f"ADE, {study['unit']}, k = 1, mean ± standard error over seeds. In brackets: the ADE of the variant minus "
        f"that of `{study['row']}` as shipped, paired, with its 95 % interval over whole agents and seeds."
    )
    return _by_place("What the parts of the forecaster contribute", study, caption)


def _by_place(title: str, study: Study, caption: str) -> Table:
    places = study["places"]
    rows = []
    for row in next(iter(places.values())):
        cells = []
        for by_row in places.values():
            mean, low, high = by_row[row]["difference"]
            same = mean == low == high == 0
            cells.append(spread(by_row[row]["ade"]) + ("" if same else f" ({mean:+.3f}, {low:+.3f} to {high:+.3f})"))
        rows.append([Code(row) if ":" in row or "_" in row else row, *cells])
    return Table(title, ["row", *places], rows, [_steps(study)], caption)


def _steps(study: Study) -> str:
    return f"unit {study['unit']}, dt {study['dt']:g} s, horizon {FUTURE * study['dt']:g} s"


def coverage(study: Mapping[str, Any]) -> Table:
    """How often the ground truth lies in the regions that samples span; see ``forecaster_study.coverage``."""
    rows = [
        [Code(row), f"{100 * float(share):.0f} %", str(step)]
        + [
            interval(dict(zip(("mean", "low", "high"), by_place[place][share][str(step)], strict=True)))
            for place in by_place
        ]
        for row, by_place in study["coverage"].items()
        for share in map(str, study["shares"])
        for step in study["steps"]
    ]
    places = list(next(iter(study["coverage"].values())))
    caption = (
        "Share of the ground truth in the region that holds 50 % and 90 % of the samples, with 95 % intervals over "
        f"whole agents; {study['samples']} samples of each forecast, weights of seed 0 that have not seen the place"
    )
    return Table("Coverage of samples", ["method", "region", "step", *places], rows, (), caption)
