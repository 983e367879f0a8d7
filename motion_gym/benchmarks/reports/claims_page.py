"""The page that holds every sentence about results, with its numbers, its test, and whether it holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym.benchmarks.reports.claims import (
    EVERYWHERE,
    NOWHERE,
    Claim,
    Comparison,
    Panel,
    compare,
    part_panels,
    pretraining_panel,
    reference_panel,
    verdict,
)
from motion_gym.benchmarks.reports.online_tables import Rows, shift_panel
from motion_gym.benchmarks.reports.published_tables import original_panel, spurious_panel
from motion_gym.benchmarks.reports.seed_tables import Found
from motion_gym.benchmarks.reports.table import Table, p_text

INTRODUCTION = (
    "Every sentence about results, the numbers behind it, the test, and whether it holds, made from the stored runs. A "
    "ratio is the mean ADE of a row over the mean ADE of the row that it is compared with. p-values are of two-sided "
    "paired t-tests over seeds, corrected for the number of distinct tests in each table (Holm). A sentence that does "
    "not hold is followed by a sentence that does, where there is one."
)


def panels_of(
    name: str, found: Found, studies: Mapping[str, Any], shifts: Mapping[str, tuple[str, Mapping[str, Rows]]]
) -> list[Panel]:
    """All panels of a benchmark.

    Args:
        name: Name of the benchmark.
        found: Its parts with the results of their runs.
        studies: Its stored studies, by name.
        shifts: Title and rows by kind of stream of each sort of shift, by name.
    """
    panels = [*part_panels(found), *(shift_panel(shift, *streams) for shift, streams in shifts.items())]
    published = {"spurious": spurious_panel, "original": original_panel}
    panels += [published[name](found)] if found and name in published else []
    if found and "by_references" in studies:
        panels.append(reference_panel(studies["by_references"], panels[0].errors))
    return panels + ([pretraining_panel(studies["pretraining"])] if "pretraining" in studies else [])


def page(claims: Mapping[str, Sequence[Claim]], panels: Mapping[str, Sequence[Panel]]) -> str:
    """The page, as Markdown.

    Args:
        claims: Claims by the name of their benchmark.
        panels: Panels of stored runs by the name of the benchmark; claims about a benchmark without are not tested.
    """
    tables = [verdict_table(name, own, compare(own, panels.get(name, ()))).markdown(2) for name, own in claims.items()]
    return "\n\n".join(["# Claims", INTRODUCTION, *tables]) + "\n"


def verdict_table(title: str, claims: Sequence[Claim], comparisons: Sequence[Comparison]) -> Table:
    """Every claim, a row each: sentence, numbers, test, and whether it holds."""
    rows = [[c.sentence, _numbers(c, comparisons), c.test, verdict(c, comparisons)] for c in claims]
    return Table(title, ["claim", "numbers", "test", "verdict"], rows)


def _numbers(claim: Claim, comparisons: Sequence[Comparison]) -> str:
    """Ratios and p-values of a claim, and where it is not so."""
    own = [c for c in comparisons if c["sentence"] == claim.sentence]
    if not own:
        return "no runs of these rows are stored"
    ratios = [c["ratio"] for c in own if c["ratio"] is not None]
    text = f"ratio {_range(map('{:.2f}'.format, sorted(ratios)))}"
    if claim.each_seed:
        pairs = (np.broadcast_arrays(c["values"], c["than_values"]) for c in own)
        text += f" (seeds {_range(map('{:.2f}'.format, sorted(np.concatenate([a / b for a, b in pairs]))))})"
    kind = "p_corrected" if claim.where == EVERYWHERE else "p"
    p_values = sorted(c[kind] for c in own if c[kind] is not None)
    text += f"; p {_range(map(p_text, p_values))}" if claim.significant and p_values else ""
    off = [c for c in own if c["so"] is (claim.where == NOWHERE)]
    if off and len(off) < len(own):
        text += f"; {'but' if claim.where == EVERYWHERE else 'so'} at {'; '.join(map(_place, off[:4]))}"
        text += f" and {len(off) - 4} more" if len(off) > 4 else ""
    return text


def _place(comparison: Comparison) -> str:
    ratio = "-" if comparison["ratio"] is None else f"{comparison['ratio']:.2f}"
    p = comparison["p_corrected"]
    return f"{comparison['row']}, {comparison['column']} ({ratio}{'' if p is None else f', p {p_text(p)}'})"


def _range(texts: Iterable[str]) -> str:
    several = list(dict.fromkeys(texts))
    return several[0] if len(several) == 1 else f"{several[0]} to {several[-1]}" if several else "-"
