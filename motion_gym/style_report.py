"""What the benchmark of style shifts shows besides its tables: the paper's numbers and claims, the reference scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from motion_gym import catalog, figures, published
from motion_gym.benchmarks import Found, Part
from motion_gym.harness import ask, ready, tell
from motion_gym.metrics import score
from motion_gym.report import number
from motion_gym.seed_tables import over_seeds, spread
from motion_gym.windows import pick_scenes

NUMBERS = (0, 1, 4, 16, 64, 256)
"""Numbers of reference scenes of the figure."""
SHOWN = ("0.4", "0.6")
"""Styles of that figure."""
CLAIMS: Sequence[tuple[str, str, str]] = (
    ("style_erm", "modular", "a style lowers the error"),
    ("modular", "modular_invariant", "an invariant encoder helps out of distribution"),
    ("ego_erm", "ego_modular", "a style lowers the error, in each agent's own frame"),
)
"""Pairs of rows, and what is claimed: that the second has the lower error. The last one is ours."""


def beside_published(found: Found) -> str:
    """ADE of our rows under both protocols beside the paper's."""
    lines = [
        "### Beside the paper's table",
        "",
        "ADE in metres, k = 1, mean ± standard error over seeds. The paper's modular rows read the style from the "
        "future of the scenes that are scored (protocol `paper`); gap is ours by that protocol against the paper.",
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


def claims(found: Found) -> str:
    """Which claims hold, by the paired differences of the seeds, under the honest protocol."""
    lines = [
        "### Claims, tested in pairs of seeds",
        "",
        "Difference in ADE, metres, the second row minus the first, mean ± standard error over pairs of the same seed, "
        "and the p-value of a two-sided t-test.",
        "",
        "| claim | rows | weights | d | difference | of the first | seeds that agree | p |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for part, results in found:
        values = over_seeds(part, results, "ADE")
        for first, second, claim in CLAIMS:
            if not {first, second} <= set(part.trained):
                continue
            for column in (*part.pooled, *part.domains):
                off = values[second, column] - values[first, column]
                agree = f"{int((off < 0).sum())} of {len(off)}"
                share = f"{100 * off.mean() / values[first, column].mean():+.0f} %"
                cells = (claim, f"`{second}` - `{first}`", part.weights, column, spread(off), share, agree)
                lines.append(f"| {' | '.join(cells)} | {paired_p(off):.3f} |")
    return "\n".join(lines)


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
    from motion_gym.weight_files import locate, read

    rows = [row for row in part.trained if hasattr(catalog.predictor(row), "observe")]
    lines: dict[str, dict[float, np.ndarray]] = {}
    for style in SHOWN:
        place = catalog.domain(part.domains[style])
        truth, reference = place.windows("test"), place.reference()
        for row in rows:
            _, card = read(locate(part.weights, row))
            name, parameters = catalog.parse_spec(row)
            specs = [
                catalog.format_spec(name, {**parameters, "weights": part.weights, "seed": seed})
                for seed in card["seeds"]
            ]
            points = lines.setdefault(f"{row}, d = {style}", {})
            for count in NUMBERS:
                errors = []
                for spec in specs:
                    made = ready(spec, place)
                    tell(made, pick_scenes(reference, slice(0, count)))
                    errors.append(np.mean(score(ask(made, truth.observation), truth)["ADE"]))
                points[count] = np.array(errors)
    figures.curves(lines, path, "reference scenes", "ADE, metres", "The style is read from reference scenes", "symlog")
    text = [
        "### How many reference scenes it takes",
        "",
        "ADE in metres, k = 1, mean ± standard error over seeds, by the number of reference scenes. With none, the "
        "style is the mean of those in training.",
        "",
        f"| method | {' | '.join(map(str, NUMBERS))} |",
        f"|---|{'---|' * len(NUMBERS)}",
    ]
    text += [f"| {name} | {' | '.join(spread(v) for v in points.values())} |" for name, points in lines.items()]
    return "\n".join(text)
