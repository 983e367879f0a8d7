"""What the benchmarks of low-shot transfer and of refinement show besides their tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks import figures
from motion_gym.benchmarks.report import number
from motion_gym.benchmarks.seed_tables import Result, over_seeds
from motion_gym.benchmarks.shipped import REFERENCES, TRIED, TUNED, Part
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ask

TRANSFER_CLAIMS: Sequence[tuple[str, str, str]] = (
    ("transfer:parts=all", "transfer:parts=modulator", "tuning f alone is better than tuning everything"),
    ("transfer:parts=style", "transfer:parts=modulator", "tuning f alone is better than tuning psi, f and g"),
    ("modular_invariant", "transfer:parts=modulator", "tuning f is better than reading the style alone"),
    ("transfer:parts=modulator", "refine:of=transfer", "refinement lowers the error after tuning f"),
    ("modular_invariant", "refine", "refinement lowers the error without tuning"),
)
REFINEMENT_CLAIMS: Sequence[tuple[str, str, str]] = (
    ("modular_invariant", "refine", "refinement by 3 steps lowers the error"),
    ("modular", "refine:of=modular", "refinement by 3 steps lowers the error"),
)
STEPS = (0, 3, 10, 30)
"""Numbers of steps in the figure of two agents."""
RIGHT, WRONG = "0.6", "0.1"
"""Styles that a scene of the first one is refined towards there."""


def schedules(part: Part, results: Sequence[Result]) -> str:
    """Which schedule is best on the style that was left out, for each choice of what is tuned."""
    values = over_seeds(part, results, "ADE")
    columns = list(part.domains)
    untuned = float(np.mean([values["modular_invariant", column].mean() for column in columns]))
    lines = [
        "### Which schedule",
        "",
        f"ADE in metres on a style that was left out ({part.title}), mean over seeds and over {', '.join(columns)} "
        f"batches of 64 scenes. Without tuning it is {number(untuned)}. The best schedule of each row is what "
        "`transfer` takes by default.",
        "",
        f"| tuned | {' | '.join(f'{epochs} epochs, {rate:g}' for epochs, rate in TRIED)} |",
        f"|---|{'---|' * len(TRIED)}",
    ]
    for parts in TUNED:
        rows = [f"transfer:parts={parts},epochs={epochs},rate={rate:g}" for epochs, rate in TRIED]
        means = [float(np.mean([values[row, column].mean() for column in columns])) for row in rows]
        best = int(np.argmin(means))
        cells = [f"**{number(m)}**" if place == best else number(m) for place, m in enumerate(means)]
        tuned: Any = catalog.predictor("transfer", parts=parts)
        taken = tuned.schedule()
        note = "" if TRIED[best] == taken else f" (`transfer` takes {taken[0]} epochs, {taken[1]:g})"
        lines.append(f"| {parts}{note} | {' | '.join(cells)} |")
    return "\n".join(lines)


def two_agents(part: Part, path: Path) -> None:
    """Draw how forecasts of one scene change as they are refined towards references of its own and of another style.

    Forecasts begin in the mean style of training. The scene is the one in the middle by how close its agents come to
    each other in that forecast.
    """
    right = catalog.domain(part.domains[RIGHT])
    truth = right.windows("test")
    spec = next(iter(part.seeds_of("modular_invariant").values()))

    def forecast(style: str, steps: int, scenes: Any) -> np.ndarray:
        made: Any = catalog.predictor("refine", of=spec, steps=steps)
        made.observe(pick_scenes(catalog.domain(part.domains[style]).reference(), slice(0, REFERENCES)))
        made.inner.reset()
        return ask(made, scenes.observation).most_likely()

    apart = np.linalg.norm(np.diff(forecast(RIGHT, 0, truth).reshape(-1, 2, 12, 2), axis=1)[:, 0], axis=-1).min(axis=1)
    scene = pick_scenes(truth, [int(np.argsort(apart)[len(apart) // 2])])
    panels = {
        f"towards scenes of d = {style} (the scene has {RIGHT})": {n: forecast(style, n, scene) for n in STEPS}
        for style in (RIGHT, WRONG)
    }
    figures.two_agents(panels, scene, path)
