"""Claims about benchmarks: sentences, and the tests over pairs of seeds that decide them.

``compare`` computes the comparisons, which are stored; ``claims_table`` and ``claims_page`` show them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motion_gym.benchmarks.reports.conditions import measured
from motion_gym.benchmarks.reports.seed_tables import Errors, Found, over_seeds
from motion_gym.benchmarks.reports.significance import holm, paired_p
from motion_gym.benchmarks.reports.table import Code, Table, p_text, percent, spread
from motion_gym.contract import SpecError

LEVEL = 0.05
"""A corrected p-value below this is significant."""
EVERYWHERE, NOWHERE, NOT_EVERYWHERE = "everywhere", "nowhere", "not everywhere"
HOLDS, FAILS, UNTESTED = "holds", "does not hold", "not tested"

Comparison = dict[str, Any]
"""One row against another one in one column, in JSON types."""


@dataclass(frozen=True)
class Claim:
    """A sentence, and the test that decides it: rows have a lower error than other rows.

    Attributes:
        sentence: What is claimed.
        rows: Rows whose error is claimed to be lower.
        than: Rows with which each of them is compared; empty for the row itself in ``than_column``.
        columns: Columns that are tested; empty for all.
        panel: Name of the panel; empty for all panels of the honest protocol that have the rows.
        than_column: Column of the rows that are compared with, where it is another one.
        ratio: Range of (mean error of the row) / (mean error of the other row), compared to 1 %.
        significant: Whether the difference must be significant, too.
        each_seed: Whether the ratio must be in range for each seed.
        where: Where this must be so: ``everywhere``, ``nowhere`` or ``not everywhere``. The latter two are for
            sentences that deny a difference; their p-values are not corrected.
    """

    sentence: str
    rows: Sequence[str]
    than: Sequence[str] = ()
    columns: Sequence[str] = ()
    panel: str = ""
    than_column: str = ""
    ratio: tuple[float, float] = (0.0, 1.0)
    significant: bool = True
    each_seed: bool = False
    where: str = EVERYWHERE

    def __post_init__(self) -> None:
        if self.where not in (EVERYWHERE, NOWHERE, NOT_EVERYWHERE):
            choices = f"`{EVERYWHERE}`, `{NOWHERE}` or `{NOT_EVERYWHERE}`"
            raise SpecError(f"`where={self.where}` of the claim `{self.sentence}` is not known: it is {choices}.")
        if not self.than and not self.than_column:
            raise SpecError(f"The claim `{self.sentence}` compares with nothing: name `than` or `than_column`.")

    @property
    def test(self) -> str:
        """The test in words."""
        low, high = self.ratio
        span = f"at most {high:.2f}" if not low else f"{low:.2f} to {high:.2f}".replace(" to inf", " or more")
        text = "lower" if self.ratio == (0.0, 1.0) else f"ratio of means {span}"
        text += " for each seed" if self.each_seed else ""
        corrected = "corrected " if self.where == EVERYWHERE else ""
        text += f", paired t-test with {corrected}p < {LEVEL:g}" if self.significant else ""
        return f"{text}; {self.where}"


@dataclass(frozen=True)
class Panel:
    """Errors that claims are tested on: one part of a benchmark, or one sort of shift.

    Attributes:
        name: Name that claims refer to.
        errors: Values of the seeds by row and column.
        columns: Columns that are tested where a claim names none.
        title: Heading.
        protocol: Protocol of the runs.
    """

    name: str
    errors: Errors
    columns: Sequence[str] = field(default_factory=tuple)
    title: str = ""
    protocol: str = "honest"


def part_panels(found: Found, metric: str = "ADE") -> list[Panel]:
    """A panel for each part of a benchmark, named by its number: ``0``, ``1``, ...

    Raises:
        DataError: a part mixes units or scoring versions.
    """
    panels = []
    for name, (part, results) in enumerate(found):
        measured(results)
        columns = (*part.pooled, *(part.shots or part.domains))
        panels.append(Panel(str(name), over_seeds(part, results, metric), columns, part.title, part.protocol))
    return panels


def reference_panel(study: Mapping[str, Any], errors: Errors) -> Panel:
    """The panel ``references``: errors by the number of reference scenes, and those of rows without a style.

    Args:
        study: See ``studies.by_references``.
        errors: Errors of the rows of a part with the same columns.

    Returns:
        Columns are ``0.4, 16 references``; rows of the part have the same error at each number.
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
    """Test claims, all together: p-values are corrected for the number of their distinct tests (Holm).

    Returns:
        In JSON types, for each comparison: ``sentence``, ``panel``, ``row``, ``than``, ``column``, ``than_column``,
        ``values`` of the row and ``than_values`` by seed, ``difference`` and its standard ``error``, ``ratio`` of the
        means, ``better`` (seeds in which the row is lower), ``seeds``, ``p`` and ``p_corrected`` (None with one seed,
        and where the claim does not ask for significance), and ``so``: whether it is as the claim says.
    """
    comparisons = []
    for claim, panel in itertools.product(claims, panels):
        if claim.panel == panel.name or (not claim.panel and panel.protocol == "honest"):
            comparisons += _comparisons(claim, panel)
    p_values = {_question(c): c["p"] for _, c in comparisons if c["p"] is not None}
    corrected = dict(zip(p_values, holm(list(p_values.values())), strict=True))
    for _, comparison in comparisons:
        comparison["p_corrected"] = None if comparison["p"] is None else corrected[_question(comparison)]
    for claim, comparison in comparisons:
        comparison["so"] = _as_claimed(claim, comparison)
    return [comparison for _, comparison in comparisons]


def _comparisons(claim: Claim, panel: Panel) -> list[tuple[Claim, Comparison]]:
    comparisons = []
    for row, than, column in itertools.product(claim.rows, claim.than or [""], claim.columns or panel.columns):
        other, other_column = than or row, claim.than_column or column
        mine, theirs = panel.errors.get((row, column)), panel.errors.get((other, other_column))
        if mine is None or theirs is None or (other, other_column) == (row, column):
            continue
        off = mine - theirs
        seeds = len(off)
        comparison = {
            "sentence": claim.sentence,
            "panel": panel.title or panel.name,
            "row": row,
            "than": other,
            "column": column,
            "than_column": other_column,
            "values": mine.tolist(),
            "than_values": theirs.tolist(),
            "difference": float(off.mean()),
            "error": float(off.std(ddof=1) / np.sqrt(seeds)) if seeds > 1 else None,
            "ratio": float(mine.mean() / theirs.mean()) if theirs.mean() else None,
            "better": int((off < 0).sum()),
            "seeds": seeds,
            "p": paired_p(off) if seeds > 1 and claim.significant else None,
            "p_corrected": None,
        }
        comparisons.append((claim, comparison))
    return comparisons


def _question(comparison: Comparison) -> tuple[Any, ...]:
    """What a comparison tests, whichever of the two rows is claimed to be lower."""
    cells = (comparison["row"], comparison["column"]), (comparison["than"], comparison["than_column"])
    return comparison["panel"], frozenset(cells)


def _as_claimed(claim: Claim, comparison: Comparison) -> bool:
    low, high = claim.ratio
    pairs = np.broadcast_arrays(comparison["values"], comparison["than_values"])
    ratios = np.divide(*pairs) if claim.each_seed else [comparison["ratio"]]
    inside = all(ratio is not None and low <= round(float(ratio), 2) <= high for ratio in ratios)
    lower = high > 1 or comparison["difference"] < 0
    # A correction makes it harder to claim a difference, and must not make it easier to deny one.
    p = comparison["p_corrected" if claim.where == EVERYWHERE else "p"]
    significant = p is None or p < LEVEL  # with one value on each side there is nothing to test
    return bool(inside and lower and significant)


def verdict(claim: Claim, comparisons: Iterable[Comparison]) -> str:
    """``holds``, ``does not hold``, or ``not tested`` where a row was not run.

    Args:
        claim: The claim.
        comparisons: What ``compare`` returned; those of other claims are passed over.
    """
    own = [c for c in comparisons if c["sentence"] == claim.sentence]
    rows = {c["row"] for c in own} | {c["than"] for c in own}
    if not own or not {*claim.rows, *claim.than} <= rows:
        return UNTESTED
    so = [c["so"] for c in own]
    holds = {EVERYWHERE: all(so), NOWHERE: not any(so), NOT_EVERYWHERE: not all(so)}[claim.where]
    return HOLDS if holds else FAILS


def claims_table(comparisons: Sequence[Comparison], heading: str) -> Table:
    """Every comparison, a row each.

    Args:
        comparisons: What ``compare`` returned.
        heading: What the columns of the parts are, such as ``d`` or ``batches``.
    """
    rows = []
    for c in comparisons:
        compared = f"{c['row']} - {c['than']}"
        column = c["column"] if c["column"] == c["than_column"] else f"{c['column']} against {c['than_column']}"
        off = np.subtract(*np.broadcast_arrays(c["values"], c["than_values"]))
        share = "-" if c["ratio"] is None else percent(c["ratio"] - 1)
        agree = f"{c['better']} of {c['seeds']}"
        p = [p_text(c["p"]), p_text(c["p_corrected"])]
        rows.append([c["sentence"], Code(compared), c["panel"], column, spread(off, sign=True), share, agree, *p])
    caption = (
        "Difference of ADE, A minus B (negative: A is better), mean ± standard error over pairs of the same seed, the "
        "p-value of a two-sided paired t-test, and the p-value corrected for the number of tests (Holm). Seeds differ "
        "in the initial weights, those of `ego` rows in the order of the scenes too. All see the same scenes."
    )
    columns = ["claim", "A - B", "part", heading, "difference", "of B", "seeds where A is better", "p", "corrected"]
    return Table("Claims, tested in pairs of seeds", columns, rows, (), caption)
