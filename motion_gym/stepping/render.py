"""Pictures of an environment: what was observed (solid), what happened (dotted) and what was forecast (faint)."""

from __future__ import annotations

import warnings
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from motion_gym.catalog import suggest
from motion_gym.contract import FUTURE, Domain, Forecast, Observation, SpecError, Truth

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODES = ("rgb_array", "human")
WINDOWLESS = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
SIZE = (7.2, 5.4)
"""Inches; 100 pixels each."""
LABELLED = 12
"""More agents than this are not labelled."""
HISTORY_COLOR, TRUTH_COLOR, FORECAST_COLOR = "#2b6cb0", "#2f855a", "#dd6b20"


def check_render_mode(mode: str | None) -> None:
    """Raise SpecError for a mode that does not exist; warn about ``human`` where no window can be opened."""
    if mode is not None and mode not in MODES:
        raise SpecError(f"There is no render_mode `{mode}`.{suggest(str(mode), MODES)}")
    if mode == "human":
        import matplotlib.pyplot as plt

        if plt.get_backend().lower() in WINDOWLESS:
            warnings.warn(
                f"render_mode `human` will show nothing: matplotlib's backend here is `{plt.get_backend()}`, which "
                "opens no window. Use render_mode='rgb_array', or a screen and a window toolkit (PySide6, tkinter).",
                RuntimeWarning,
                stacklevel=3,
            )


def origin_of(domain: Domain, split: str) -> np.ndarray:
    """[2], the origin that all recordings of a split share; zeros where they have different ones."""
    origins = np.unique([recording.origin for recording in domain.recordings(split)], axis=0)
    return origins[0] if len(origins) == 1 else np.zeros(2)


class Canvas:
    """Draws the last step of an environment, on a scale that is fixed for the whole episode.

    Args:
        title: Shown above the picture.
        extent: [2, 2], lowest and highest x and y of the whole episode, metres.
        unit: Unit of the axes.
        fps: Frames per second of ``human`` mode.
        origin: [2], added to the coordinates that the axes show; None for zeros.
    """

    def __init__(
        self, title: str, extent: np.ndarray, unit: str = "m", fps: float = 5, origin: np.ndarray | None = None
    ):
        self.origin = np.zeros(2) if origin is None else origin
        self.title, self.extent, self.unit, self.fps = title, extent, unit, fps
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
        """Remember what to draw.

        Args:
            time: Step number for the title.
            observation: Who is shown with a history.
            truth: Of the forecasts just settled, if any.
            forecast: The forecasts just settled, if any.
            paths: [A, K, 13, 2], further forecasts, not settled yet, each from where it started.
        """
        self._shown = time, observation, truth, forecast, paths

    def image(self, mode: str | None) -> np.ndarray | None:
        """The picture, [H, W, 3] uint8; None in human mode.

        Raises:
            SpecError: no render_mode was chosen, or nothing has happened yet.
        """
        if mode is None:
            raise SpecError("The environment was made without a render_mode: make it with render_mode='rgb_array'.")
        if self._shown is None:
            raise SpecError("There is nothing to render yet: call reset() first.")
        if mode == "human":
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

    def show(self) -> None:
        """Draw in a window, and wait for one frame."""
        import matplotlib.pyplot as plt

        if self._figure is None:
            self._figure = plt.figure(figsize=SIZE)
        self._draw(self._figure, *(self._shown or ()))
        if plt.get_backend().lower() not in WINDOWLESS:
            plt.pause(1 / self.fps)

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
        margin = 0.05 * float((high - low).max()) + 0.5
        axes.set_xlim(low[0] - margin, high[0] + margin)
        axes.set_ylim(low[1] - margin, high[1] + margin)
        axes.set_aspect("equal", adjustable="box")
        axes.grid(color="#e2e8f0", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.set_xlabel(f"x [{self.unit}]")
        axes.set_ylabel(f"y [{self.unit}]")
        if self.origin.any():
            for axis, shift in zip((axes.xaxis, axes.yaxis), self.origin.tolist(), strict=True):
                axis.set_major_formatter(partial(_shifted, shift))
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        if paths is not None:
            _fan(axes, paths)
        if truth is not None and forecast is not None:
            _settled(axes, truth, forecast)
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
        handles = [
            Line2D([], [], color=HISTORY_COLOR, linewidth=1.8, label="history"),
            Line2D([], [], color=TRUTH_COLOR, linestyle=":", linewidth=2.0, label="truth"),
            Line2D([], [], color=FORECAST_COLOR, alpha=0.6, linewidth=1.5, label="forecast"),
        ]
        figure.legend(handles=handles, loc="upper right", ncols=3, fontsize=9, frameon=False)


def _settled(axes: Any, truth: Truth, forecast: Forecast) -> None:
    """Forecasts with what came of them."""
    last = truth.observation.xy[:, -1]
    samples = forecast.positions.shape[1]
    start = np.broadcast_to(last[:, None, None], (len(last), samples, 1, 2))
    _fan(axes, np.concatenate([start, forecast.positions], axis=2))
    for origin, future, known in zip(last, truth.future, truth.known, strict=True):
        path = np.concatenate([origin[None], future[known]])
        axes.plot(*path.T, ":", color=TRUTH_COLOR, linewidth=2.0)
        axes.plot(*path[-1:].T, "s", color=TRUTH_COLOR, markersize=3.5)


def _shifted(shift: float, value: float, _: Any) -> str:
    return f"{value + shift:.10g}"


def _fan(axes: Any, paths: np.ndarray) -> None:
    """All samples [A, K, 13, 2], the fainter the more there are."""
    alpha = max(0.12, 0.6 / np.sqrt(max(paths.shape[1], 1)))
    axes.plot(*paths.reshape(-1, FUTURE + 1, 2).transpose(2, 1, 0), color=FORECAST_COLOR, alpha=alpha, linewidth=1.5)
