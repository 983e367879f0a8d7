"""Figures of the benchmarks, drawn from stored results and studies."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from motion_gym.benchmarks.drives import Drives
from motion_gym.benchmarks.objects import ORACLE
from motion_gym.benchmarks.reports import drive_tables
from motion_gym.benchmarks.reports.colors import PALETTE, color_of, styles_of
from motion_gym.benchmarks.reports.conditions import Result, unit_of
from motion_gym.benchmarks.reports.curves import Curves, Study
from motion_gym.data.storage import write_atomic

MARKERS = "osD^vP*X"
"""Markers of points, so that rows of one color can be told apart."""


def draw(curves: Sequence[Curves], path: Path) -> None:
    """Draw curves, a panel each, with a band of one standard deviation over seeds.

    Args:
        curves: Curves of one figure.
        path: File of the SVG.
    """
    over_time = any(panel.marks for panel in curves)
    figure, all_axes = _figure(len(curves), *((9, 3.2) if over_time else ()))
    for axes, panel in zip(all_axes, curves, strict=True):
        styles = styles_of(panel.lines)
        for row, line in panel.lines.items():
            color, dashes = styles[row]
            few = len(line.x) < 20
            axes.plot(
                line.x, line.mean, color=color, dashes=dashes, marker="o" if few and line.seeds > 1 else None,
                label=row, markersize=4, linewidth=1.4,
            )  # fmt: skip
            low, high = line.mean - line.deviation, line.mean + line.deviation
            axes.fill_between(line.x, low, high, color=color, alpha=0.15, linewidth=0)
        if panel.scale != "linear":
            axes.set_xscale(panel.scale, base=2)
        if panel.ticks:
            axes.set_xticks(panel.ticks, [f"{tick:g}" for tick in panel.ticks])
        for start, text in panel.marks:
            axes.axvline(start, color="0.7", linewidth=0.8)
            axes.annotate(text, (start, 0.97), xycoords=("data", "axes fraction"), fontsize=7, va="top")
        if panel.marks:
            axes.set_ylim(0, None)
        axes.set(xlabel=panel.x_label, ylabel=panel.y_label)
        axes.set_title(panel.title, fontsize=10)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    _write(figure, path)


def score_by_error(drives: Drives, results: Sequence[Result], path: Path) -> None:
    """The score of the planner over the error of the forecasts, a point for each row and column.

    Args:
        drives: Driven episodes.
        results: Results of their runs.
        path: File of the SVG.
    """
    cells = drive_tables.by_cell(drives, results)
    figure, (axes,) = _figure(1)
    rows = [row for row in dict.fromkeys(row for row, _ in cells) if row != ORACLE]
    for place, row in enumerate(rows):
        values = [
            [drive_tables.means(cells, row, column, metric).mean() for column in drives.domains]
            for metric in ("ADE", "score")
        ]
        axes.plot(*values, MARKERS[place % len(MARKERS)], color=color_of(row), label=row, markersize=6)
    if (ORACLE, next(iter(drives.domains))) in cells:
        scores = [drive_tables.means(cells, ORACLE, column, "score").mean() for column in drives.domains]
        axes.axhline(float(np.mean(scores)), color="0.5", linestyle="--", linewidth=1, label="oracle, mean")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.set(xlabel=f"ADE of the forecasts, {unit_of(results)}", ylabel="score of the planner")
    axes.set_title(f"{drives.title}: a point for each predictor and style", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    _write(figure, path)


def style_codes(study: Study, path: Path) -> None:
    """Style codes of scenes on their two principal axes, a colour for each style; see ``style_codes.style_codes``."""
    figure, (axes,) = _figure(1)
    for color, (name, codes) in zip(PALETTE, study["codes"].items(), strict=False):
        trained = name in study["trained"]
        label = f"{name}{'' if trained else ' (held out)'}: {100 * study['recognised'][name]:.0f} % recognised"
        points = np.array(codes)
        axes.plot(*points.T, "o" if trained else "^", color=color, markersize=4, alpha=0.5)
        axes.plot(*points.mean(axis=0), "o" if trained else "^", color=color, markersize=11, mec="black", label=label)
    title = f"Style codes of single scenes; {100 * study['share']:.0f} % of their variance is on these two axes"
    axes.set(xlabel="first axis", ylabel="second axis")
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    _write(figure, path)


def one_scene(study: Study, path: Path) -> None:
    """One scene forecast by several predictors, a panel for each alpha; see ``studies.one_scene``."""
    rows = next(iter(study["panels"].values()))
    _scene_panels(study, path, {row: color_of(row) for row in rows})


def two_agents(study: Study, path: Path) -> None:
    """Forecasts of one scene as they are refined, a panel for each style; see ``studies.two_agents``."""
    steps = list(next(iter(study["panels"].values())))
    shades = matplotlib.colormaps["viridis"](np.linspace(0, 1, len(steps)))
    _scene_panels(study, path, dict(zip(steps, shades, strict=True)))


def _scene_panels(study: Study, path: Path, colors: Mapping[str, Any]) -> None:
    """A scene in several panels, in each with forecasts of its own, a colour for each name."""
    history, future = np.array(study["history"]), np.array(study["future"])
    points = np.concatenate([history, future], axis=1).reshape(-1, 2)
    width, height = np.nanmax(points, axis=0) - np.nanmin(points, axis=0)
    across = len(study["panels"]) if height > width else 1
    single = len(study["panels"]) == 1
    size = (7, 6) if single else (10, 5 if across > 1 else 2.7 * len(study["panels"]))
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(len(study["panels"]) // across, across, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, (title, forecasts) in zip(panels, study["panels"].items(), strict=True):
        _draw_agents(axes, history, "observed", color="0.6", linewidth=2)
        _draw_agents(
            axes, np.concatenate([history[:, -1:], future], axis=1), "ground truth", color="black", linewidth=2
        )
        for name, positions in forecasts.items():
            lines = np.concatenate([history[:, -1:], np.array(positions)], axis=1)
            _draw_agents(axes, lines, name, color=colors[name], linewidth=1.8 if single else 1)
        axes.set_title(title, fontsize=10)
        axes.set_aspect("equal", adjustable="box")
        axes.set(xlabel=f"x, {study['unit']}", ylabel=f"y, {study['unit']}")
        axes.label_outer()
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, fontsize=7, loc="outside lower center", ncols=8, frameon=False)
    _write(figure, path)


def _draw_agents(axes: Any, lines: np.ndarray, label: str, **style: Any) -> None:
    """A line for each agent, the first one with the label."""
    for agent, line in enumerate(lines):
        axes.plot(*line.T, "-", label=None if agent else label, **style)


def _figure(panels: int, width: float = 8, height: float = 4.8) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height * panels), layout="constrained")
    return figure, figure.subplots(panels, squeeze=False)[:, 0]


def _write(figure: Figure, path: Path) -> None:
    buffer = io.BytesIO()
    # Without the date and with ids that are not random, so that the same results give the same file.
    with matplotlib.rc_context({"svg.hashsalt": "motion_gym"}):
        figure.savefig(buffer, format=path.suffix[1:], metadata={"Date": None} if path.suffix == ".svg" else None)
    write_atomic(path, buffer.getvalue())
