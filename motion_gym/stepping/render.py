"""Pictures of an environment: histories (solid), ground truth (dotted) and forecasts (faint)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from motion_gym.contract import FUTURE, Domain, Forecast, Observation, Recording, SpecError, Truth
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.windows import frames_by_step
from motion_gym.specs import one_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODES = ("rgb_array", "human")
WINDOWLESS = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
SIZE = (7.2, 5.4)
"""Inches; 100 pixels each."""
GROUND_COLOR = "#a0aec0"
PALENESS = 0.6
"""Share of the contrast of an image of the ground that is left when it is drawn."""
LONGEST = 6
"""Length over width of roads from which on the axes of a picture have different scales."""
LABELLED = 12
"""Most agents that are labelled."""
HISTORY_COLOR, TRUTH_COLOR, FORECAST_COLOR = "#2b6cb0", "#2f855a", "#dd6b20"
SCORED_COLOR = "#805ad5"
"""On the stream clock: forecasts of earlier steps whose ground truth is now known."""


class Canvas:
    """Draws the last step of an environment, on a scale that is fixed for the whole episode.

    Args:
        mode: ``"rgb_array"``, ``"human"`` or None to draw nothing.
        domain: Gives the unit of the axes, and the origin that is added to the coordinates of the axes if all
            recordings of the split share it.
        split: The split that is played.
        title: Title of the picture.
        extent: [2, 2], lowest and highest x and y of the whole episode, metres.
        fps: Frames per second of ``human`` mode.

    Raises:
        SpecError: There is no such mode. If ``human`` mode cannot open a window, a warning says so.
    """

    def __init__(
        self, mode: str | None, domain: Domain, split: str, title: str, extent: np.ndarray, fps: float = 5
    ) -> None:
        if mode is not None:
            one_of("render_mode", mode, MODES)
        if mode == "human":
            import matplotlib.pyplot as plt

            if plt.get_backend().lower() in WINDOWLESS:
                warnings.warn(
                    f"render_mode `human` will show nothing: matplotlib's backend here is `{plt.get_backend()}`, which "
                    "opens no window. Use render_mode='rgb_array', or a screen and a toolkit (PySide6, tkinter).",
                    RuntimeWarning,
                    stacklevel=3,
                )
        self.mode, self.title, self.extent, self.fps = mode, title, extent, fps
        recordings = domain.recordings(split) if mode else ()
        origins = {tuple(recording.origin) for recording in recordings}
        self.unit, self.origin = domain.card.unit, np.array(origins.pop() if len(origins) == 1 else (0.0, 0.0))
        self.ground = domain.ground_lines() if mode and isinstance(domain, RecordedDomain) else ()
        if self.ground:
            points = np.concatenate([extent, *(line - self.origin for line, _ in self.ground)])
            self.extent = np.stack([points.min(axis=0), points.max(axis=0)])
        self._places = Places(domain, recordings)
        self._shown: tuple[Any, ...] | None = None
        self._figure: Figure | None = None

    def update(
        self,
        time: int,
        observation: Observation,
        truth: Truth | None,
        forecast: Forecast | None,
        paths: np.ndarray | None = None,
    ) -> None:
        """Store the last step, and in ``human`` mode draw it in a window and wait for one frame.

        Args:
            time: Step number for the title.
            observation: Agents whose histories are drawn.
            truth: Ground truth of the forecasts just settled, if any.
            forecast: The forecasts just settled, if any.
            paths: [A, K, 13, 2], forecasts that are not settled yet, each from its first position.
        """
        self._shown = time, observation, truth, forecast, paths
        if self.mode == "human":
            import matplotlib.pyplot as plt

            if self._figure is None:
                self._figure = plt.figure(figsize=SIZE)
            self._draw(self._figure, *self._shown)
            if plt.get_backend().lower() not in WINDOWLESS:
                plt.pause(1 / self.fps)

    def image(self) -> np.ndarray | None:
        """The picture, [H, W, 3] uint8; None in human mode.

        Raises:
            SpecError: No render_mode was chosen, or there was no step yet.
        """
        if self.mode is None:
            raise SpecError("The environment was made without a render_mode: make it with render_mode='rgb_array'.")
        if self._shown is None:
            raise SpecError("There is nothing to render yet: call reset() first.")
        if self.mode == "human":
            return None
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        if self._figure is None:
            self._figure = Figure(figsize=SIZE, dpi=100)
            FigureCanvasAgg(self._figure)
        self._draw(self._figure, *self._shown)
        canvas: Any = self._figure.canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._figure is not None and self._figure.canvas.manager is not None:
            import matplotlib.pyplot as plt

            plt.close(self._figure)
        self._figure = None

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_figure": None}

    def _draw(
        self,
        figure: Figure,
        time: int,
        observation: Observation,
        truth: Truth | None,
        forecast: Forecast | None,
        paths: np.ndarray | None,
    ) -> None:
        from matplotlib.lines import Line2D
        from matplotlib.patheffects import withStroke

        figure.clear()
        axes = figure.add_axes((0.09, 0.1, 0.88, 0.8))
        low, high = self.extent
        size = np.maximum(high - low, 1e-6)
        stretched = bool(self.ground) and size.max() > LONGEST * size.min()
        margin = 0.05 * (size if stretched else np.full(2, size.max())) + 0.5
        axes.set(
            xlim=(low[0] - margin[0], high[0] + margin[0]),
            ylim=(low[1] - margin[1], high[1] + margin[1]),
            xlabel=f"x [{self.unit}]",
            ylabel=f"y [{self.unit}]" + (", not to the scale of x" if stretched else ""),
            axisbelow=True,
        )
        axes.set_aspect("auto" if stretched else "equal", adjustable="box")
        axes.grid(color="#e2e8f0", linewidth=0.6)
        if self.origin.any():
            for axis, shift in zip((axes.xaxis, axes.yaxis), self.origin.tolist(), strict=True):
                axis.set_major_formatter(partial(_shifted, shift))
        axes.spines[["top", "right"]].set_visible(False)
        shown = observation if len(observation) or truth is None else truth.observation
        draw_ground(axes, self.ground, self.origin, self._places.image_of(shown))
        if paths is not None:
            _fan(axes, paths, FORECAST_COLOR)
        if truth is not None and forecast is not None:
            _settled(axes, truth, forecast, FORECAST_COLOR if paths is None else SCORED_COLOR)
        if now := len(observation):
            xy = observation.xy
            axes.plot(*xy.transpose(2, 1, 0), color=HISTORY_COLOR, linewidth=1.8, solid_capstyle="round")
            axes.plot(*xy[:, -1].T, "o", color=HISTORY_COLOR, markersize=5)
            label: Any = dict(textcoords="offset points", fontsize=8, color="#4a5568")
            label["path_effects"] = [withStroke(linewidth=2.5, foreground="white")]
            for number, place in zip(observation.agent, xy[:, -1], strict=True) if now <= LABELLED else ():
                axes.annotate(str(number), place, (5, 4), **label)
        # Above the axes, where they cover nothing.
        figure.text(0.03, 0.955, f"{self.title}, step {time}, {now} agent{'' if now == 1 else 's'}", fontsize=11)
        lines: dict[str, dict[str, Any]] = {
            "history": dict(color=HISTORY_COLOR),
            "forecast": dict(color=FORECAST_COLOR, alpha=0.6),
            "ground truth": dict(color=TRUTH_COLOR, linestyle=":"),
        }
        if paths is not None:
            # Forecasts are scored when their ground truth is complete, up to 12 steps after they were made.
            earlier = {"earlier forecast, scored now": dict(color=SCORED_COLOR, alpha=0.6)}
            lines |= {**earlier, "its ground truth": lines.pop("ground truth")}
        handles = [Line2D([], [], linewidth=1.8, label=name, **style) for name, style in lines.items()]
        figure.legend(
            handles=handles, loc="upper right", ncols=2 if paths is not None else 3, fontsize=8, frameon=False
        )


class Places:
    """Finds the image of the ground of an observation.

    Args:
        domain: The domain.
        recordings: Its recordings of the split that is shown.
    """

    def __init__(self, domain: Domain, recordings: Sequence[Recording]):
        self.domain, self.recordings = domain, recordings
        self.ends = np.cumsum([len(frames_by_step(recording)) for recording in recordings])

    def image_of(self, observation: Observation) -> SceneImage | None:
        """The ``ground_image`` of the first scene, relative to the origin of its recording; None if there is none."""
        if observation.time is None or not len(observation.time) or not isinstance(self.domain, RecordedDomain):
            return None
        number = int(np.searchsorted(self.ends, observation.time[0], side="right"))
        if number >= len(self.recordings):
            return None
        image = self.domain.ground_image(self.recordings[number])
        return None if image is None else image.relative_to(self.recordings[number].origin)


def draw_ground(
    axes: Any,
    lines: Sequence[tuple[np.ndarray, bool]],
    origin: np.ndarray,
    image: SceneImage | None = None,
) -> None:
    """Draw the ground below everything else, within the limits of the axes.

    Args:
        axes: Axes whose limits are set. If y grows downwards in the image, the y axis points downwards.
        lines: ``ground_lines`` of the domain.
        origin: [2] position that everything else is relative to.
        image: Image of the ground relative to the origin; it is drawn pale.
    """
    if image is not None:
        limits = np.array([axes.get_xlim(), axes.get_ylim()]).T
        if image.pixel[1] > 0:
            axes.set_ylim(limits[1, 1], limits[0, 1])
        height, width = image.photo.shape[:2]
        cells = np.sort((limits - image.corner) / image.pixel, axis=0)
        first = np.clip(np.floor(cells[0]), 0, (width, height)).astype(int)
        last = np.clip(np.ceil(cells[1]), 0, (width, height)).astype(int)
        if (first < last).all():
            (left, top), (right, bottom) = (image.corner + image.pixel * edge for edge in (first, last))
            photo = image.photo[first[1] : last[1], first[0] : last[0]]
            pale = (255 - (255 - photo.astype(np.float32)) * PALENESS).astype(np.uint8)
            axes.imshow(pale, extent=(left, right, bottom, top), zorder=0, aspect=axes.get_aspect())
    for points, dashed in lines:
        style = (0, (6, 9)) if dashed else "-"
        axes.plot(*(points - origin).T, color=GROUND_COLOR, linewidth=0.8, linestyle=style, zorder=1)


def _settled(axes: Any, truth: Truth, forecast: Forecast, color: str) -> None:
    """Forecasts with their ground truth."""
    last = truth.observation.xy[:, -1]
    samples = forecast.positions.shape[1]
    start = np.broadcast_to(last[:, None, None], (len(last), samples, 1, 2))
    _fan(axes, np.concatenate([start, forecast.positions], axis=2), color)
    for origin, future, known in zip(last, truth.future, truth.known, strict=True):
        path = np.concatenate([origin[None], future[known]])
        axes.plot(*path.T, ":", color=TRUTH_COLOR, linewidth=2.0)
        axes.plot(*path[-1:].T, "s", color=TRUTH_COLOR, markersize=3.5)


def _shifted(shift: float, value: float, _: Any) -> str:
    return f"{value + shift:.10g}"


def _fan(axes: Any, paths: np.ndarray, color: str) -> None:
    """All samples [A, K, 13, 2]; more samples are fainter."""
    alpha = max(0.12, 0.6 / np.sqrt(max(paths.shape[1], 1)))
    axes.plot(*paths.reshape(-1, FUTURE + 1, 2).transpose(2, 1, 0), color=color, alpha=alpha, linewidth=1.5)
