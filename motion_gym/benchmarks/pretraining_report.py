"""What the pre-training of the style encoder is worth: errors during the last stage, with it and without it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from motion_gym import catalog
from motion_gym.benchmarks import figures
from motion_gym.benchmarks.seed_tables import spread
from motion_gym.benchmarks.shipped import REFERENCES
from motion_gym.benchmarks.style_report import p_text, paired_p

CURVES = "motion_gym.predictors.training.pretraining:curves"
"""What trains."""
EPOCHS = (1, 3, 10, 30, 100)
"""Epochs of the last stage in the table."""


def write(folder: Path, report: Callable[[int, int, str], None]) -> tuple[str, list[Path]]:
    """Table, and a figure for each watched domain in ``folder``.

    Raises:
        SpecError: PyTorch is not installed.
    """
    made = catalog.load_class(CURVES, "training")(folder, report)
    seeds = next(iter(next(iter(made.values())).values())).shape[1]
    lines = [
        "### With and without pre-training of the style encoder",
        "",
        "ADE in metres on the validation windows of a domain after so many epochs of the last stage, mean ± standard "
        f"error over {seeds} seeds; the style is read from {REFERENCES} reference scenes. Both are "
        "trained with d = 0.1, 0.3 and 0.5 in the same stages, but for the second one. p: two-sided t-test of the "
        "difference in pairs of seeds.",
        "",
        f"| domain | variant | {' | '.join(map(str, EPOCHS))} |",
        f"|---|---|{'---|' * len(EPOCHS)}",
    ]
    paths = []
    for domain, table in made.items():
        for name, values in table.items():
            lines.append(f"| `{domain}` | {name} | {' | '.join(spread(values[e - 1]) for e in EPOCHS)} |")
        first, second = table.values()
        p = [p_text(paired_p(first[e - 1] - second[e - 1])) for e in EPOCHS]
        lines.append(f"| `{domain}` | p | {' | '.join(p)} |")
        name, parameters = catalog.parse_spec(domain)
        paths.append(folder / f"{name}_{parameters['d']}.svg")
        drawn = {name: {float(e): v for e, v in enumerate(values, 1)} for name, values in table.items()}
        figures.curves(drawn, paths[-1], "epoch of the last stage", "ADE, metres", domain, "log", EPOCHS)
    return "\n".join(lines), paths
