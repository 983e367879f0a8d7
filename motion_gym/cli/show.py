"""The verb of the command line that draws one scene with the forecasts of predictors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from motion_gym.cli.output import say


def show(
    domain: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="DOMAIN")],
    predictor: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PREDICTOR")],
    scene: Annotated[int | None, tyro.conf.arg(metavar="N")] = None,
    time: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None,
    split: str = "test",
    k: int = 1,
    seed: int = 0,
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("scene.png"),
) -> None:
    """Draw one scene: its history, its ground truth, and what predictors forecast.

    Args:
        domain: Name or spec, as orca:d=0.6 or zara1.
        predictor: Name, spec or your own (module:Class); repeat it for several. The legend gives their errors.
        scene: Number of the scene in the split; the first by default.
        time: Seconds since the beginning of the split, instead of a number: the first scene from then on.
        split: Split of the domain.
        k: Samples of each predictor; all but the most likely one are drawn faint.
        seed: Seed of the samples.
        out: File to write: .png, .svg or .pdf, or an animation of the 20 steps, .gif or .mp4.
    """
    from motion_gym.scoring.show import show  # matplotlib takes half a second

    show(domain, predictor, scene=scene, time=time, split=split, k=k, seed=seed, out=out)
    say(f"Written: {out}")
