"""What the benchmark of style shifts shows besides its tables: the paper's numbers and claims, the reference scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks import figures, published
from motion_gym.benchmarks.report import number
from motion_gym.benchmarks.seed_tables import over_seeds, spread
from motion_gym.benchmarks.shipped import Found, Part
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import score
from motion_gym.stepping.harness import ask, ready, tell

NUMBERS = (0, 1, 4, 16, 64, 256)
"""Numbers of reference scenes of the figure."""
SHOWN = ("0.4", "0.6")
"""Styles of that figure."""
CLAIMS: Sequence[tuple[str, str, str]] = (
    ("style_erm", "style_invariant", "the invariance penalty alone gives no clear advantage"),
    ("style_erm", "modular", "a style lowers the error"),
    ("modular", "modular_invariant", "an invariant encoder helps out of distribution"),
    ("ego_erm", "ego_modular", "a style lowers the error, in each agent's own frame"),
)
"""Rows B and A, and what is claimed of them: that A has the lower error, except in the first. The last one is ours."""
CROWD_CLAIMS: Sequence[tuple[str, str, str]] = (("erm_no_sigma", "modular_stgat", "a style lowers the error of STGAT"),)


def beside_published(found: Found) -> str:
    """ADE of our rows under both protocols beside the paper's."""
    lines = [
        "### Beside the paper's table",
        "",
        "ADE in metres, k = 1, mean ± standard error over seeds. The paper's modular rows read the style from the "
        "future of the scenes that are scored (protocol `paper`), ours by that protocol from the same and the mean of "
        "training; without a style both protocols are one. Gap is ours by that protocol against the paper.",
        "",
        "| method | d | ours, honest | ours, `paper` | the paper | gap |",
        "|---|---|---|---|---|---|",
    ]
    by_protocol = {
        part.protocol: over_seeds(part, results, "ADE") for part, results in found if part.weights == "style"
    }
    for row, cells in published.STYLE.items():
        for column, theirs in cells.items():
            honest = by_protocol["honest"][row, column]
            paper = by_protocol["paper"].get((row, column), honest)  # the same without a style
            gap = f"{100 * (paper.mean() / theirs - 1):+.0f} %"
            lines.append(f"| `{row}` | {column} | {spread(honest)} | {spread(paper)} | {number(theirs)} | {gap} |")
    return "\n".join(lines)


def claims(found: Found, claimed: Sequence[tuple[str, str, str]], heading: str = "d") -> str:
    """Which claims hold, by the paired differences of the seeds, under the honest protocol.

    Args:
        found: The parts with their results.
        claimed: Rows B and A, and what is claimed of them.
        heading: What the columns of the parts are.
    """
    lines = [
        "### Claims, tested in pairs of seeds",
        "",
        "Difference in ADE, metres, A minus B (negative: A is better), mean ± standard error over pairs of the same "
        "seed, the p-value of a two-sided t-test, and that corrected for the number of tests (Holm). Seeds differ in "
        "first weights, those of `ego` rows in the order of the scenes too; all see the same training and test scenes.",
        "",
        f"| claim | A - B | weights | {heading} | difference | of B | seeds where A is better | p | corrected |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    tested: list[tuple[str, float]] = []
    for part, results in found:
        values = over_seeds(part, results, "ADE")
        for first, second, claim in claimed:
            if part.protocol != "honest" or not {first, second} <= set(part.trained):
                continue
            for column in (*part.pooled, *(part.shots or part.domains)):
                off = values[second, column] - values[first, column]
                agree = f"{int((off < 0).sum())} of {len(off)}"
                share = f"{100 * off.mean() / values[first, column].mean():+.0f} %"
                cells = (claim, f"`{second}` - `{first}`", part.weights, column, spread(off), share, agree)
                tested.append((" | ".join(cells), paired_p(off)))
    corrected = holm([p for _, p in tested])
    lines += [f"| {cells} | {p_text(p)} | {p_text(more)} |" for (cells, p), more in zip(tested, corrected, strict=True)]
    return "\n".join(lines)


def p_text(value: float) -> str:
    """A p-value for a table."""
    return "< .001" if value < 0.001 else number(value)


def holm(values: Sequence[float]) -> list[float]:
    """p-values of several tests, corrected for their number (Holm, 1979)."""
    order = np.argsort(values)
    raised = np.maximum.accumulate(np.array(values)[order] * np.arange(len(values), 0, -1))
    found = np.empty(len(values))
    found[order] = np.minimum(raised, 1)
    return found.tolist()


def paired_p(off: np.ndarray) -> float:
    """Two-sided p-value of Student's t-test that differences [N >= 2] have the mean 0."""
    count = len(off)
    error = off.std(ddof=1) / np.sqrt(count)
    if error == 0:
        return 1.0 if off.mean() == 0 else 0.0
    # With t = sqrt(N - 1) tan(a) the density of t is that of cos(a) to the power N - 2.
    angle = np.arctan(abs(off.mean()) / error / np.sqrt(count - 1))
    grid = np.linspace(0, np.pi / 2, 20_001)
    density = np.cos(grid) ** (count - 2)
    area = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2)])
    return float(1 - np.interp(angle, grid, area) / area[-1])


def by_references(part: Part, path: Path) -> str:
    """How the error falls with the number of reference scenes: a table, and a figure at ``path``."""
    rows = [row for row in part.trained if hasattr(catalog.predictor(row), "observe")]
    lines: dict[str, dict[float, np.ndarray]] = {}
    for style in SHOWN:
        place = catalog.domain(part.domains[style])
        truth, reference = place.windows("test"), place.reference()
        for row in rows:
            points = lines.setdefault(f"{row}, d = {style}", {})
            predictors: dict[int, Any] = {seed: ready(spec, place) for seed, spec in part.seeds_of(row).items()}
            for count in NUMBERS:
                errors = []
                for seed, made in predictors.items():
                    drawn = np.random.default_rng(seed).permutation(reference.observation.scenes)[:count]
                    made.reset()
                    tell(made, pick_scenes(reference, drawn))
                    errors.append(np.mean(score(ask(made, truth.observation), truth)["ADE"]))
                points[count] = np.array(errors)
    figures.curves(lines, path, "reference scenes", "ADE, metres", "The style is read from reference scenes", "symlog")
    text = [
        "### How many reference scenes it takes",
        "",
        "ADE in metres, k = 1, mean ± standard error over seeds, each with reference scenes of its own, by their "
        "number. With none, `modular` takes the mean style of training, and `ego_modular` forecasts without a style.",
        "",
        f"| method | {' | '.join(map(str, NUMBERS))} |",
        f"|---|{'---|' * len(NUMBERS)}",
    ]
    text += [f"| {name} | {' | '.join(spread(v) for v in points.values())} |" for name, points in lines.items()]
    return "\n".join(text)
