"""The verb of the command line that draws one scene with the forecasts of predictors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from motion_gym import catalog
from motion_gym.cli.output import say
from motion_gym.contract import SpecError
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ask, ready, windows_of_domain

FORMATS = (".svg", ".png", ".pdf")
COLORS = ("#dd6b20", "#2f855a", "#805ad5", "#b83280", "#2b6cb0")
"""One for each predictor, in turn."""


def draw(
    domain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="DOMAIN")],
    predictor: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PREDICTOR")],
    scene: int = 0,
    split: str = "test",
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("scene.svg"),
) -> None:
    """Draw one scene: what was observed, what happened, and what predictors forecast.

    Args:
        domain: Name or spec, as orca:d=0.6 or zara1.
        predictor: Name, spec or your own (module:Class); again for each one.
        scene: Number of the scene in the split.
        split: Split of the domain.
        out: Picture file: .svg, .png or .pdf.
    """
    if out.suffix not in FORMATS:
        raise SpecError(f"`--out {out}` must end in one of {', '.join(FORMATS)}.")
    place = catalog.domain(domain)
    windows = windows_of_domain(place, split)
    scene = catalog.whole_number("scene", scene, 0, windows.observation.scenes - 1)
    truth = pick_scenes(windows, [scene])
    forecasts = {name: ask(ready(name, place), truth.observation).most_likely() for name in predictor}

    from matplotlib.figure import Figure  # takes half a second

    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.subplots()
    last = truth.observation.xy[:, -1:]
    for agent, (history, future, known) in enumerate(zip(truth.observation.xy, truth.future, truth.known, strict=True)):
        path = np.concatenate([history[-1:], future[known]])
        labels = (None, None) if agent else ("history", "ground truth")
        axes.plot(*history.T, color="0.55", linewidth=2.5, solid_capstyle="round", label=labels[0])
        axes.plot(*history[-1], "o", color="0.55", markersize=5)
        axes.plot(*path.T, color="black", linewidth=1.8, label=labels[1])
    for number, (name, positions) in enumerate(forecasts.items()):
        color = COLORS[number % len(COLORS)]
        for agent, path in enumerate(np.concatenate([last, positions], axis=1)):
            axes.plot(*path.T, "--", color=color, linewidth=1.6, label=None if agent else name)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel(f"x [{place.card.unit}]")
    axes.set_ylabel(f"y [{place.card.unit}]")
    axes.grid(color="0.92")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2 + len(forecasts), frameon=False)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, metadata={"Date": None} if out.suffix == ".svg" else None)
    say(f"Written: {out}")
