"""Figures of the benchmarks."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from motion_gym import catalog
from motion_gym.benchmarks.seed_tables import over_seeds
from motion_gym.benchmarks.shipped import Part
from motion_gym.contract import FUTURE, SpecError, Truth
from motion_gym.data.storage import write_atomic
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ask, ready

MARKED = 0.1
"""Share of a stream from which on the beginning of a segment is marked."""
SCENE_ALPHAS = (1, 8, 64)
"""Alphas of the figure of one scene."""


def error_over(
    part: Part, results: Sequence[Mapping[str, Any]], metric: str, path: Path, label: str, log: bool
) -> None:
    """Mean error over seeds by a parameter of the domains, with a band of one standard deviation.

    Args:
        part: A part whose domains are named by the value of the parameter.
        results: Of its runs.
        metric: Name of the metric.
        path: Where the SVG goes.
        label: The parameter, and what it was in training.
        log: Whether its axis is logarithmic.
    """
    values = over_seeds(part, results, metric)
    places = {name: float(name) for name in part.domains}
    lines = {row: {places[name]: values[row, name] for name in places} for row in dict.fromkeys(r for r, _ in values)}
    curves(lines, path, label, f"{metric}, metres", part.title, "log" if log else "linear")


def curves(
    lines: Mapping[str, Mapping[float, np.ndarray]],
    path: Path,
    x_label: str,
    y_label: str,
    title: str,
    scale: str,
    ticks: Sequence[float] | None = None,
) -> None:
    """A line for each row through the means over seeds, with a band of one standard deviation.

    Args:
        lines: Values of the seeds, by row and place on the x axis.
        path: Where the SVG goes.
        x_label: Of the x axis.
        y_label: Of the y axis.
        title: Above the figure.
        scale: Of the x axis: ``linear``, ``log``, or ``symlog``, which has a place for 0.
        ticks: Of the x axis; by default all places.
    """
    figure = Figure(figsize=(8, 4.8), layout="constrained")
    axes = figure.subplots()
    colors = matplotlib.colormaps["tab20"].colors  # type: ignore[attr-defined]
    for color, (row, points) in zip(colors, lines.items(), strict=False):
        places, columns = list(points), list(points.values())
        mean, spread = (
            np.array([c.mean() for c in columns]),
            np.array([c.std(ddof=1) if len(c) > 1 else 0 for c in columns]),
        )
        style = "--" if len(columns[0]) == 1 else "o-" if len(places) < 20 else "-"
        axes.plot(places, mean, style, color=color, label=row, markersize=4, linewidth=1.4)
        axes.fill_between(places, mean - spread, mean + spread, color=color, alpha=0.15, linewidth=0)
    if scale != "linear":
        axes.set_xscale(scale, base=2)
    ticks = ticks or sorted({place for points in lines.values() for place in points})
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    _write(figure, path)


def over_time(panels: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]], path: Path, title: str) -> None:
    """Trailing means over the time of streams, a panel for each kind, the mean over seeds.

    Args:
        panels: Online results of the seeds, by row, by kind.
        path: Where the SVG goes.
        title: Above the figure.
    """
    figure = Figure(figsize=(9, 3.2 * len(panels)), layout="constrained")
    colors = matplotlib.colormaps["tab20"].colors  # type: ignore[attr-defined]
    for axes, (kind, rows) in zip(figure.subplots(len(panels), squeeze=False)[:, 0], panels.items(), strict=True):
        for color, (row, results) in zip(colors, rows.items(), strict=False):
            curves = [np.array(r["curve"]) for r in results]
            first, last = max(c[0, 0] for c in curves), min(c[-1, 0] for c in curves)
            at = np.linspace(first, last, 200)
            mean = np.mean([np.interp(at, c[:, 0], c[:, 1]) for c in curves], axis=0)
            axes.plot(at, mean, "--" if row == "constant_velocity" else "-", color=color, label=row, linewidth=1.3)
        for segment in next(iter(rows.values()))[0]["segments"]:
            if segment["stop"] - segment["start"] > MARKED * axes.get_xlim()[1]:
                axes.axvline(segment["start"], color="0.7", linewidth=0.8)
                place = (segment["start"], 0.97)
                axes.annotate(segment["domain"], place, xycoords=("data", "axes fraction"), fontsize=7, va="top")
        axes.set(xlabel="seconds", ylabel="ADE over the last 50 forecasts, m", title=f"{title}: {kind}")
        axes.title.set_fontsize(9)
        axes.grid(alpha=0.3)
        axes.set_ylim(0, None)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    _write(figure, path)


def one_scene(part: Part, rows: Sequence[str], path: Path) -> None:
    """One scene forecast by several predictors, a panel for each alpha.

    The scene is that of three to six agents who leave their straight way most (the largest final error of constant
    velocity), so that there is something to see.

    Args:
        part: A part whose domains are named by their alpha.
        rows: Predictors.
        path: Where the SVG goes.
    """
    truth = catalog.domain(next(iter(part.domains.values()))).windows("test")
    number = _scene_of_turns(truth)
    width, height = np.ptp(pick_scenes(truth, [number]).future.reshape(-1, 2), axis=0)
    wide = len(SCENE_ALPHAS) if height > width else 1
    figure = Figure(figsize=(10, 8 if wide == 1 else 5), layout="constrained")
    panels = figure.subplots(len(SCENE_ALPHAS) // wide, wide, sharex=True, sharey=True)
    colors = matplotlib.colormaps["tab10"].colors  # type: ignore[attr-defined]
    for axes, alpha in zip(panels, SCENE_ALPHAS, strict=True):
        place = catalog.domain(part.domains[str(alpha)])
        scene = pick_scenes(place.windows("test"), [number])
        _draw(axes, scene, f"alpha = {alpha}")
        for color, row in zip(colors, rows, strict=False):
            name, parameters = catalog.parse_spec(row)
            weights = {"weights": part.weights} if row in part.trained else {}
            made = ready(catalog.format_spec(name, {**parameters, **weights}), place)
            forecast = ask(made, scene.observation).most_likely()
            _draw_forecast(axes, scene, forecast, color, row)
    figure.legend(
        *panels[0].get_legend_handles_labels(), fontsize=7, loc="outside lower center", ncols=6, frameon=False
    )
    _write(figure, path)


def two_agents(panels: Mapping[str, Mapping[int, np.ndarray]], scene: Truth, path: Path) -> None:
    """Forecasts of one scene as they are refined step by step, a panel for each style that they are refined towards.

    Args:
        panels: Positions [agents, 12, 2] by number of steps, by the heading of the panel.
        scene: The scene.
        path: Where the SVG goes.
    """
    width, height = np.ptp(np.concatenate([scene.observation.xy, scene.future], axis=1).reshape(-1, 2), axis=0)
    wide = len(panels) if height > width else 1
    figure = Figure(figsize=(8, 5), layout="constrained")
    each = figure.subplots(len(panels) // wide, wide, sharex=True, sharey=True)
    colors = matplotlib.colormaps["viridis"]
    for axes, (title, forecasts) in zip(each, panels.items(), strict=True):
        _draw(axes, scene, title)
        for number, (steps, forecast) in enumerate(forecasts.items()):
            _draw_forecast(axes, scene, forecast, colors(number / max(len(forecasts) - 1, 1)), f"{steps} steps")
    figure.legend(*each[0].get_legend_handles_labels(), fontsize=8, loc="outside lower center", ncols=8, frameon=False)
    _write(figure, path)


def _draw(axes: Any, scene: Truth, title: str) -> None:
    for person, (past, then) in enumerate(zip(scene.observation.xy, scene.future, strict=True)):
        label = ("observed", "truth") if not person else (None, None)
        axes.plot(*past.T, "-", color="0.6", linewidth=2, label=label[0])
        axes.plot(*np.vstack([past[-1:], then]).T, "-", color="black", linewidth=2, label=label[1])
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x, metres")
    axes.set_ylabel("y, metres")
    axes.label_outer()


def _draw_forecast(axes: Any, scene: Truth, forecast: np.ndarray, color: Any, label: str) -> None:
    for person, (past, then) in enumerate(zip(scene.observation.xy, forecast, strict=True)):
        line = np.vstack([past[-1:], then])
        axes.plot(*line.T, "-", color=color, linewidth=1, label=None if person else label)


def _scene_of_turns(truth: Any) -> int:
    sizes = np.diff(truth.observation.scene)
    path = np.concatenate([truth.observation.xy[:, -2:], truth.future], axis=1)
    steps = np.diff(path, axis=1)
    straight = truth.observation.xy[:, -1] + FUTURE * steps[:, 0]
    off = np.linalg.norm(truth.future[:, -1] - straight, axis=-1)
    turned = np.array(
        [off[a:b].mean() for a, b in zip(truth.observation.scene[:-1], truth.observation.scene[1:], strict=True)]
    )
    fit = (sizes >= 3) & (sizes <= 6)
    if not fit.any():
        raise SpecError("No scene of three to six agents to draw.")
    return int(np.where(fit, turned, -1).argmax())


def _write(figure: Figure, path: Path) -> None:
    buffer = io.BytesIO()
    # Without the date and with ids that are not random, so that the same results give the same file.
    with matplotlib.rc_context({"svg.hashsalt": "motion_gym"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    write_atomic(path, buffer.getvalue())
