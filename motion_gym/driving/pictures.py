"""Pictures and clips of an episode: the road, the vehicles, their forecasts and the plan of the ego vehicle."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D

from motion_gym.contract import SpecError
from motion_gym.driving.footprints import LENGTH, WIDTH
from motion_gym.driving.proposals import Plans
from motion_gym.driving.run import Run
from motion_gym.stepping.render import FORECAST_COLOR, GROUND_COLOR, HISTORY_COLOR

SIZE = (7.2, 3.6)
"""Inches; 100 pixels each."""
PLACE = (0.01, 0.01, 0.98, 0.9)
"""Place of the axes, as shares of the picture: left, bottom, width and height."""
REACH = 55.0
"""Metres that are shown to both sides of the ego vehicle."""
EGO_COLOR, PLAN_COLOR = "#c53030", "#2f855a"


class Picture:
    """Draws an episode at one step, around the ego vehicle.

    Args:
        domain: Gives the lines of the lanes.
    """

    def __init__(self, domain: Any):
        self.domain = domain
        self._figure: Figure | None = None

    def image(self, run: Run, plans: Plans | None, number: int, forecast: np.ndarray | None) -> np.ndarray:
        """[H, W, 3] uint8.

        Args:
            run: The episode.
            plans: The proposals of this step, if there are any.
            number: The chosen proposal.
            forecast: [N or more, 12, 2] forecast positions of the others, if there are any.
        """
        if self._figure is None:
            self._figure = Figure(figsize=SIZE, dpi=100)
            FigureCanvasAgg(self._figure)
        self._figure.clear()
        axes = self._figure.add_axes(PLACE)
        x, y = run.states[-1, :2]
        reach = REACH * PLACE[3] * SIZE[1] / (PLACE[2] * SIZE[0])  # the same scale along x and y
        axes.set(xlim=(x - REACH, x + REACH), ylim=(y - reach, y + reach), xticks=[], yticks=[])
        for points, dashed in self.domain.ground_lines():
            axes.plot(*points.T, color=GROUND_COLOR, linewidth=0.8, linestyle=(0, (6, 9)) if dashed else "-", zorder=1)
        for state in run.others[run.there]:
            _vehicle(axes, state, HISTORY_COLOR)
        paths = run.forecast_paths(forecast) if forecast is not None else ()
        for path in paths:
            axes.plot(*path.T, ".-", color=FORECAST_COLOR, linewidth=1.2, markersize=3, zorder=3)
        for index, states in enumerate(plans.states(run.episode.path) if plans is not None else ()):
            chosen = index == number
            color, width = (PLAN_COLOR, 2.5) if chosen else ("0.75", 0.7)
            axes.plot(*states[:, :2].T, color=color, linewidth=width, zorder=4 if chosen else 2)
        _vehicle(axes, run.states[-1], EGO_COLOR)
        handles = [
            Line2D([], [], color=color, linewidth=width, label=label)
            for label, color, width in (
                ("ego vehicle", EGO_COLOR, 5),
                ("others", HISTORY_COLOR, 5),
                ("forecast", FORECAST_COLOR, 1.2),
                ("proposals", "0.75", 0.7),
                ("plan", PLAN_COLOR, 2.5),
            )
        ]
        self._figure.legend(handles=handles, loc="upper right", ncols=5, fontsize=8, frameon=False)
        hit = ", collision" if run.collision else ""
        self._figure.text(0.02, 0.94, f"{0.4 * run.step:.1f} s, {run.ego.speed:.1f} m/s{hit}", fontsize=10)
        canvas: Any = self._figure.canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_figure": None}


def write_clip(images: Sequence[np.ndarray], path: str | os.PathLike[str], seconds: float = 0.4) -> None:
    """Write images [H, W, 3] as an animation, .gif.

    Raises:
        SpecError: There are no images, or the file does not end in .gif.
    """
    from PIL import Image  # comes with matplotlib

    file = File(path)
    if file.suffix != ".gif" or not len(images):
        raise SpecError(f"`{file}`: a clip needs at least one image and a file that ends in .gif.")
    frames = [Image.fromarray(image).quantize(64) for image in images]
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=int(1000 * seconds), loop=0)


def _vehicle(axes: Any, state: np.ndarray, color: str) -> None:
    x, y, heading, _ = state
    box = Rectangle((-LENGTH / 2, -WIDTH / 2), LENGTH, WIDTH, color=color, zorder=5)
    box.set_transform(Affine2D().rotate(heading).translate(x, y) + axes.transData)
    axes.add_patch(box)
