"""The page with every sentence about results, its numbers, its test, and whether it is true."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from motion_gym.benchmarks import running
from motion_gym.benchmarks.claims.panels import (
    HOLDS,
    Comparison,
    Panel,
    compare,
    part_panels,
    pretraining_panel,
    reference_panel,
    verdict,
)
from motion_gym.benchmarks.claims.sentences import CLAIMS
from motion_gym.benchmarks.objects import EVERYWHERE, NOWHERE, Claim
from motion_gym.benchmarks.reports.drive_tables import loss_panel
from motion_gym.benchmarks.reports.factor_tables import swap_panel
from motion_gym.benchmarks.reports.online_tables import regret_panel, shift_panel
from motion_gym.benchmarks.reports.published_tables import original_panel, spurious_panel
from motion_gym.benchmarks.reports.table import Table, p_text

INTRODUCTION = (
    "Every sentence about results, the numbers behind it, the test, and whether it holds, made from the stored runs. A "
    "ratio is the mean ADE of a row over the mean ADE of the row that it is compared with; in `planning`, of what the "
    "planner loses, 1 - score. `a / b, 16 (0.9)` is the ratio of row a to row b in column 16. A test must come out in "
    "every comparison (*everywhere*) or in none (*nowhere*). p-values are of two-sided paired t-tests over seeds, "
    "corrected for the number of distinct tests in each table (Holm). A sentence that does not hold is followed by a "
    "sentence that does, where there is one."
)
PUBLISHED = {"spurious": spurious_panel, "original": original_panel}
"""Panels with the paper's numbers, by benchmark."""


def page() -> str:
    """The page, made from the stored runs alone, as Markdown."""
    return "\n\n".join(["# Claims", INTRODUCTION, *(table.markdown(2) for table in tables())]) + "\n"


def tables() -> Iterator[Table]:
    """A table for each benchmark, made from the stored runs alone."""
    for name, further in CLAIMS.items():
        results = running.run(name, only=())
        claims = [*results.benchmark.claims, *further]
        yield verdict_table(name, claims, compare(claims, panels_of(results)))


def short(table: Table) -> Table:
    """The claims and verdicts of a table, with their counts in its title."""
    verdicts = [row[-1] for row in table.rows]
    title = f"{table.title}: {verdicts.count(HOLDS)} of {len(verdicts)} claims hold"
    return Table(title, [table.columns[-1], table.columns[0]], [[row[-1], row[0]] for row in table.rows])


def panels_of(results: running.Results) -> list[Panel]:
    """All panels of a benchmark."""
    panels = part_panels(results.parts)
    for name, shifts in results.benchmark.shifts.items():
        panels.append(
            shift_panel(name, shifts.title, {kind: results.stream_rows(name, kind) for kind in shifts.streams})
        )
    panels += [loss_panel(drives, runs) for drives, runs in results.drives if runs]
    if combined := results.with_experts():
        panels.append(regret_panel(combined))
    if results.benchmark.name in PUBLISHED:
        panels.append(PUBLISHED[results.benchmark.name](results.parts))
    if "by_references" in results.studies:
        panels.append(reference_panel(results.studies["by_references"], panels[0].errors))
    panels += [swap_panel(name, study) for name, study in results.studies.items() if name.startswith("swaps")]
    if "pretraining" in results.studies:
        panels.append(pretraining_panel(results.studies["pretraining"]))
    return panels


def verdict_table(title: str, claims: Sequence[Claim], comparisons: Sequence[Comparison]) -> Table:
    """Every claim, a row each: sentence, numbers, test, and whether it holds."""
    rows = [[claim.sentence, _numbers(claim, comparisons), claim.test, verdict(claim, comparisons)] for claim in claims]
    return Table(title, ["claim", "numbers", "test", "verdict"], rows)


def _numbers(claim: Claim, comparisons: Sequence[Comparison]) -> str:
    """Ratios and p-values of a claim, and the comparisons that contradict it."""
    own = [c for c in comparisons if c["claim"] == claim]
    if not own:
        return "no runs of these rows are stored"
    ratios = [c["ratio"] for c in own if c["ratio"] is not None]
    text = f"ratio {_range(map('{:.2f}'.format, sorted(ratios)))}"
    if claim.each_seed:
        by_seed = np.concatenate([c["values"] / c["than_values"] for c in own])
        text += f" (seeds {_range(map('{:.2f}'.format, sorted(by_seed)))})"
    kind = "p_corrected" if claim.where == EVERYWHERE else "p"
    p_values = sorted(c[kind] for c in own if c[kind] is not None)
    text += f"; p {_range(map(p_text, p_values))}" if claim.significant and p_values else ""
    off = [c for c in own if c["so"] is (claim.where == NOWHERE)]
    if off and len(off) < len(own):
        text += f"; {'but' if claim.where == EVERYWHERE else 'so'} at {'; '.join(map(_cell, off[:4]))}"
        text += f" and {len(off) - 4} more" if len(off) > 4 else ""
    return text


def _cell(comparison: Comparison) -> str:
    ratio = "-" if comparison["ratio"] is None else f"{comparison['ratio']:.2f}"
    p = comparison["p_corrected"]
    row, than = comparison["row"], comparison["than"]
    rows = row if row == than else f"{row} / {than}"
    return f"{rows}, {comparison['column']} ({ratio}{'' if p is None else f', p {p_text(p)}'})"


def _range(texts: Iterable[str]) -> str:
    several = list(dict.fromkeys(texts))
    return several[0] if len(several) == 1 else f"{several[0]} to {several[-1]}" if several else "-"
