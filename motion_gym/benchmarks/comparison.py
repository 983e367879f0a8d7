"""Two predictors, or two files of results, compared in pairs: differences, intervals, effect sizes and p-values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.benchmarks.identity import OPTIONS, SCORING_VERSION, is_of_own_code, row_name
from motion_gym.benchmarks.reports.significance import holm
from motion_gym.benchmarks.reports.table import Code, Table, number, p_text, percent
from motion_gym.contract import MotionGymError, SpecError
from motion_gym.metrics.bootstrap import paired_difference

METRICS = ("ADE", "FDE")
ALIKE = tuple(option for option in OPTIONS if option != "seed")
"""Options that two runs share if they can be compared."""
PAIRED, FROM_SUMMARIES = "in pairs of agents", "from the stored intervals alone"


@dataclass(frozen=True)
class Comparison:
    """A minus B on one domain.

    Attributes:
        a: First predictor.
        b: Second predictor.
        domain: Spec of the domain.
        unit: Unit of the errors.
        metric: Name of the metric.
        mean_a: Mean of the first.
        mean_b: Mean of the second.
        mean: Difference, negative where the first is better.
        low: Lower end of its 95 % interval.
        high: Upper end.
        effect: Difference in standard deviations of the differences by agent-window; None without pairs.
        p: p-value of no difference.
        how: ``PAIRED`` or ``FROM_SUMMARIES``.
        n: Agent-windows.
    """

    a: str
    b: str
    domain: str
    unit: str
    metric: str
    mean_a: float
    mean_b: float
    mean: float
    low: float
    high: float
    effect: float | None
    p: float
    how: str
    n: int


def compare_predictors(a: Any, b: Any, domain: Any, **options: Any) -> list[Comparison]:
    """Score two predictors on the same windows, and compare them in pairs.

    Args:
        a: A name, a spec, ``"module:Class"`` or a predictor.
        b: Another.
        domain: A name, a spec or a domain.
        **options: Options of ``evaluate``.
    """
    from motion_gym.scoring.evaluation import evaluate

    first, second = evaluate(a, domain, **options), evaluate(b, domain, **options)
    agents, comparisons = first.truth.observation.agent, []
    for metric in METRICS:
        values = first.values[metric], second.values[metric]
        difference = paired_difference(*values, agents)
        differences = np.asarray(values[0] - values[1], dtype=float)
        deviation = float(np.nanstd(differences, ddof=1)) if len(agents) > 1 else 0.0
        comparisons.append(
            Comparison(
                first.predictor, second.predictor, first.spec, first.domain.unit, metric,
                first.metrics[metric].mean, second.metrics[metric].mean, difference.mean, difference.low,
                difference.high, difference.mean / deviation if deviation else 0.0, difference.p_value, PAIRED,
                difference.n,
            )
        )  # fmt: skip
    return comparisons


def compare_results(a: Sequence[Mapping[str, Any]], b: Sequence[Mapping[str, Any]]) -> list[Comparison]:
    """Compare the runs of windows of two files that were scored alike.

    A pair is scored again, and compared by agent, if both predictors and the domain are known and there; else it is
    compared by its stored intervals, as if the two had been scored on different people, which is cautious.

    Raises:
        SpecError: the files have several rows each, no run in common, or other scoring versions.
    """
    first, second = _by_condition(a, "A"), _by_condition(b, "B")
    shared = [key for key in first if key in second]
    if not shared:
        raise SpecError("The two files have no domain, split, protocol and k in common: score both on the same ones.")
    comparisons = []
    for key in shared:
        one, other = first[key], second[key]
        known = not (is_of_own_code(one["identity"]) or is_of_own_code(other["identity"]))
        options = {name: one["identity"][name] for name in ALIKE}
        try:
            if not known:
                raise SpecError("code of a user")
            comparisons += compare_predictors(
                one["predictor"], other["predictor"], one["identity"]["domain"], **options
            )
        except MotionGymError:
            comparisons += [_from_summaries(one, other, metric) for metric in METRICS]
    return comparisons


def _by_condition(runs: Sequence[Mapping[str, Any]], name: str) -> dict[tuple[Any, ...], Mapping[str, Any]]:
    windows = [run for run in runs if run["identity"]["kind"] == "windows"]
    rows = list(dict.fromkeys(row_name(run["predictor"]) for run in windows))
    if len(rows) > 1:
        others = [row for row in rows if row != "constant_velocity"]
        if len(others) > 1:
            raise SpecError(f"{name} has the rows {', '.join(rows)}: name one of them, as --row {others[0]}.")
        windows = [run for run in windows if row_name(run["predictor"]) == others[0]]
    versions = {run["identity"]["scoring_version"] for run in windows}
    if versions - {SCORING_VERSION}:
        raise SpecError(
            f"{name} has scoring versions {sorted(versions)}, and this is {SCORING_VERSION}: score it again."
        )
    return {tuple(run["identity"][key] for key in ("domain", *ALIKE)): run for run in windows}


def _from_summaries(one: Mapping[str, Any], other: Mapping[str, Any], metric: str) -> Comparison:
    first, second = one["metrics"][metric], other["metrics"][metric]
    mean = first["mean"] - second["mean"]
    error = math.hypot(*((s["high"] - s["low"]) / 2 / 1.96 for s in (first, second)))
    p = math.erfc(abs(mean) / error / math.sqrt(2)) if error else float(mean == 0)
    return Comparison(
        one["predictor"], other["predictor"], one["spec"], one["unit"], metric, first["mean"], second["mean"], mean,
        mean - 1.96 * error, mean + 1.96 * error, None, p, FROM_SUMMARIES, first["agent_windows"],
    )  # fmt: skip


def comparison_table(comparisons: Sequence[Comparison]) -> Table:
    """A row for each domain and metric."""
    corrected = holm([c.p for c in comparisons])
    rows = []
    for c, p in zip(comparisons, corrected, strict=True):
        share = percent(c.mean / c.mean_b) if c.mean_b else "-"
        difference = f"{number(c.mean, sign=True)} [{number(c.low, sign=True)}, {number(c.high, sign=True)}]"
        effect = "-" if c.effect is None else f"{c.effect:+.2f}"
        cells = [Code(c.domain), f"{c.metric}, {c.unit}", number(c.mean_a), number(c.mean_b), difference, share, effect]
        rows.append([*cells, p_text(c.p), p_text(p), c.how, str(c.n)])
    columns = ["domain", "metric", "A", "B", "A - B [95 %]", "of B", "effect", "p", "corrected", "compared", "n"]
    notes = ["negative: A is better", "corrected: p-value for the number of rows (Holm)"]
    if any(c.how == PAIRED for c in comparisons):
        notes += [
            f"{PAIRED}: intervals and p-values by bootstrap of whole agents, in pairs of the same agent-window",
            "effect: the mean difference in standard deviations of the differences",
        ]
    if any(c.how == FROM_SUMMARIES for c in comparisons):
        notes.append(
            f"{FROM_SUMMARIES}: the errors by agent are not stored, and could not be computed here; the interval is "
            "that of two independent errors, hence wider than one in pairs"
        )
    first = comparisons[0]
    return Table(f"A: {first.a}, B: {first.b}", columns, rows, notes)
