"""The command that draws one scene with the forecasts of predictors."""

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


def draw(
    domain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="DOMAIN")],
    predictor: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PREDICTOR")],
    scene: int = 0,
    split: str = "test",
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("scene.svg"),
) -> None:
    """Draw one scene: histories, ground truth and forecasts.

    Args:
        domain: Name or spec, as orca:d=0.6 or zara1.
        predictor: Name, spec or your own (module:Class); give it once for each predictor.
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
    from motion_gym.benchmarks.reports import figures  # matplotlib takes half a second

    known_future = np.where(truth.known[..., None], truth.future, np.nan)
    scene_drawn = {
        "history": truth.observation.xy,
        "future": known_future,
        "panels": {
            f"{domain}, scene {scene}": {
                name: ask(ready(name, place), truth.observation).most_likely() for name in predictor
            }
        },
        "unit": place.card.unit,
    }
    figures.one_scene(scene_drawn, out)
    say(f"Written: {out}")
