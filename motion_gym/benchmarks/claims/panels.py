"""Tests of claims: panels of errors, and comparisons of rows over pairs of seeds."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.benchmarks.objects import EVERYWHERE, LEVEL, NOT_EVERYWHERE, NOWHERE, Claim
from motion_gym.benchmarks.reports.conditions import measured
from motion_gym.benchmarks.reports.seed_tables import Errors, Parts, over_seeds
from motion_gym.benchmarks.reports.significance import holm, paired_p
from motion_gym.benchmarks.reports.table import Code, Table, p_text, percent, spread

HOLDS, FAILS, UNTESTED = "holds", "does not hold", "not tested"

Comparison = dict[str, Any]
"""One row against another row in one column."""


@dataclass(frozen=True)
class Panel:
    """Errors that claims are tested on: one part of a benchmark, or one sort of shift.

    Attributes:
        name: Name that claims refer to.
        errors: Values of all seeds by row and column.
        columns: Columns that are tested where a claim names none.
        title: Heading.
        protocol: Protocol of the runs.
    """

    name: str
    errors: Errors
    columns: Sequence[str]
    title: str
    protocol: str = "honest"


def part_panels(parts: Parts) -> list[Panel]:
    """A panel for each part with runs, named by the number of the part: ``0``, ``1``, ...

    A part by the published protocol has a second one, with the error of the best sample: ``4, best of 20``.

    Raises:
        DataError: a part mixes units or scoring versions.
    """
    panels = []
    for number, (part, results) in enumerate(parts):
        if results:
            measured(results)
            columns = (*part.pooled, *(part.shots or part.domains))
            panels.append(Panel(str(number), over_seeds(part, results), columns, part.title, part.protocol))
            best = f"minADE_{part.samples}"
            if part.protocol == "paper" and all(best in result["metrics"] for result in results):
                name, title = f"{number}, best of {part.samples}", f"{part.title}, best of {part.samples}"
                panels.append(Panel(name, over_seeds(part, results, best), columns, title, part.protocol))
    return panels


def reference_panel(study: Mapping[str, Any], errors: Errors) -> Panel:
    """The panel ``references``: errors by the number of reference scenes.

    Args:
        study: See ``studies.by_references``.
        errors: Errors of a part with the same columns. Its rows that are not in the study have no style: their error is
            the same for each number of reference scenes.

    Returns:
        A panel with columns such as ``0.4, 16 references``.
    """
    columns = {f"{name}, {n} references": (name, n) for name in study["ade"] for n in study["counts"]}
    by_count: Errors = {}
    for column, (name, n) in columns.items():
        by_count |= {(row, column): values for (row, other), values in errors.items() if other == name}
        for row, values in study["ade"][name].items():
            by_count[row, column] = np.array(values[study["counts"].index(n)])
    return Panel("references", by_count, tuple(columns), "By the number of reference scenes", "by references")


def pretraining_panel(study: Mapping[str, Any]) -> Panel:
    """The panel ``pretraining``: errors after epochs of the last stage, in columns such as ``orca:d=0.1, 10 epochs``.

    Args:
        study: See ``predictors.training.pretraining.curves``.
    """
    errors = {
        (variant, f"{domain}, {epoch} epochs"): np.array(values)
        for domain, variants in study["ade"].items()
        for variant, by_epoch in variants.items()
        for epoch, values in enumerate(by_epoch, 1)
    }
    return Panel("pretraining", errors, (), "By epochs of the last stage", "by epochs")


def compare(claims: Sequence[Claim], panels: Sequence[Panel]) -> list[Comparison]:
    """Test claims together: p-values are corrected for the number of distinct tests (Holm).

    Returns:
        For each comparison: ``claim``, ``panel``, ``row``, ``than``, ``column``, ``than_column``, ``values`` of the row
        and ``than_values`` by seed, ``differences`` by seed, ``ratio`` of the means, ``cells`` that are compared, ``p``
        and ``p_corrected`` (None with one seed, and where the claim does not ask for significance), and ``so``: whether
        the claim is true here.
    """
    comparisons = [
        comparison
        for claim, panel in itertools.product(claims, panels)
        if claim.panel == panel.name or (not claim.panel and panel.protocol == "honest")
        for comparison in _comparisons(claim, panel)
    ]
    p_values = {c["cells"]: c["p"] for c in comparisons if c["p"] is not None}
    corrected = dict(zip(p_values, holm(list(p_values.values())), strict=True))
    for comparison in comparisons:
        comparison["p_corrected"] = None if comparison["p"] is None else corrected[comparison["cells"]]
        comparison["so"] = _is_so(comparison)
    return comparisons


def _comparisons(claim: Claim, panel: Panel) -> Iterator[Comparison]:
    for row, than, column in itertools.product(claim.rows, claim.than or [""], claim.columns or panel.columns):
        first, second = (row, column), (than or row, claim.than_column or column)
        values, than_values = panel.errors.get(first), panel.errors.get(second)
        if values is None or than_values is None or first == second:
            continue
        differences = values - than_values
        yield {
            "claim": claim,
            "panel": panel.title,
            "row": row,
            "than": second[0],
            "column": column,
            "than_column": second[1],
            "values": values,
            "than_values": than_values,
            "differences": differences,
            "ratio": float(values.mean() / than_values.mean()) if than_values.mean() else None,
            # The same test, whichever of the two rows is claimed to have the lower error.
            "cells": (panel.title, frozenset((first, second))),
            "p": paired_p(differences) if len(differences) > 1 and claim.significant else None,
        }


def _is_so(comparison: Comparison) -> bool:
    claim = comparison["claim"]
    low, high = claim.ratio
    ratios = comparison["values"] / comparison["than_values"] if claim.each_seed else [comparison["ratio"]]
    inside = all(ratio is not None and low <= round(float(ratio), 2) <= high for ratio in ratios)
    lower = high > 1 or comparison["differences"].mean() < 0
    # A correction makes it harder to claim a difference, and must not make it easier to deny one.
    p = comparison["p_corrected" if claim.where == EVERYWHERE else "p"]
    significant = p is None or p < LEVEL  # one value on each side cannot be tested
    return bool(inside and lower and significant)


def verdict(claim: Claim, comparisons: Iterable[Comparison]) -> str:
    """``holds``, ``does not hold``, or ``not tested`` if a row was not run.

    Args:
        claim: The claim.
        comparisons: Result of ``compare``; comparisons of other claims are ignored.
    """
    own = [c for c in comparisons if c["claim"] == claim]
    rows = {c["row"] for c in own} | {c["than"] for c in own}
    if not own or not {*claim.rows, *claim.than} <= rows:
        return UNTESTED
    so = [c["so"] for c in own]
    holds = {EVERYWHERE: all(so), NOWHERE: not any(so), NOT_EVERYWHERE: not all(so)}[claim.where]
    return HOLDS if holds else FAILS


def claims_table(comparisons: Sequence[Comparison], heading: str) -> Table:
    """Every comparison, a row each.

    Args:
        comparisons: Result of ``compare``.
        heading: What the columns of the parts are, such as ``d`` or ``batches``.
    """
    rows = []
    for c in comparisons:
        column = c["column"] if c["column"] == c["than_column"] else f"{c['column']} against {c['than_column']}"
        share = "-" if c["ratio"] is None else percent(c["ratio"] - 1)
        better = f"{(c['differences'] < 0).sum()} of {len(c['differences'])}"
        cells = [c["claim"].sentence, Code(f"{c['row']} - {c['than']}"), c["panel"], column]
        p = [p_text(c["p"]), p_text(c["p_corrected"])]
        rows.append([*cells, spread(c["differences"], sign=True), share, better, *p])
    caption = (
        "Difference of ADE, A minus B (negative: A is better), mean ± standard error over pairs of the same seed, the "
        "p-value of a two-sided paired t-test, and the p-value corrected for the number of tests (Holm). Seeds differ "
        "in the initial weights, those of `ego` rows in the order of the scenes too. All see the same scenes."
    )
    columns = ["claim", "A - B", "part", heading, "difference", "of B", "seeds where A is better", "p", "corrected"]
    return Table("Claims, tested in pairs of seeds", columns, rows, (), caption)
