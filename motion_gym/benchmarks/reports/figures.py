"""Figures of the benchmarks, drawn from stored results and studies."""

from __future__ import annotations

import io
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from motion_gym.benchmarks.drives import Drives
from motion_gym.benchmarks.objects import ORACLE, Part
from motion_gym.benchmarks.reports import drive_tables
from motion_gym.benchmarks.reports.conditions import Result, measured, unit_of
from motion_gym.benchmarks.reports.seed_tables import over_seeds
from motion_gym.data.storage import write_atomic

MARKED = 0.1
"""The start of a segment is marked if the segment is longer than this share of the stream."""

Study = Mapping[str, Any]
Lines = Mapping[str, Mapping[float, Any]]
"""Values of all seeds, by row and position on the x axis."""


def error_over(part: Part, results: Sequence[Result], metric: str, path: Path, label: str, log: bool) -> None:
    """Mean error over seeds by a parameter of the domains, with a band of one standard deviation.

    Args:
        part: A part whose domains are named by the value of the parameter.
        results: Results of its runs.
        metric: Name of the metric.
        path: File of the SVG.
        label: The parameter, and its values in training.
        log: Whether the axis of the parameter is logarithmic.
    """
    measured(results)  # refuses to mix units or versions
    values = over_seeds(part, results, metric)
    rows = dict.fromkeys(row for row, _ in values)
    lines = {row: {float(n): values[row, n] for n in part.domains if (row, n) in values} for row in rows}
    figure, (axes,) = _figure(1)
    y_label = f"{metric}, {unit_of(results)}"
    _draw_lines(axes, lines, x_label=label, y_label=y_label, title=part.title, scale="log" if log else "linear")
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
    for color, row in zip(_colors("tab20"), rows, strict=False):
        values = [
            [drive_tables.means(cells, row, column, metric).mean() for column in drives.domains]
            for metric in ("ADE", "score")
        ]
        axes.plot(*values, "o", color=color, label=row, markersize=5)
    if (ORACLE, next(iter(drives.domains))) in cells:
        scores = [drive_tables.means(cells, ORACLE, column, "score").mean() for column in drives.domains]
        axes.axhline(float(np.mean(scores)), color="0.5", linestyle="--", linewidth=1, label="oracle, mean")
    axes.set_xscale("log")
    axes.set(xlabel=f"ADE of the forecasts, {unit_of(results)}", ylabel="score of the planner")
    axes.set_title(f"{drives.title}: a point for each predictor and style", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    _write(figure, path)


def style_codes(study: Study, path: Path) -> None:
    """Style codes of scenes on their two principal axes, a colour for each style; see ``style_codes.style_codes``."""
    figure, (axes,) = _figure(1)
    for color, (name, codes) in zip(_colors("tab10"), study["codes"].items(), strict=False):
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


def by_references(study: Study, path: Path) -> None:
    """The error by the number of reference scenes; see ``studies.by_references``."""
    lines = {
        f"{row}, d = {name}": dict(zip(map(float, study["counts"]), by_count, strict=True))
        for name, by_row in study["ade"].items()
        for row, by_count in by_row.items()
    }
    figure, (axes,) = _figure(1)
    title, y_label = "The style is read from reference scenes", f"ADE, {study['unit']}"
    _draw_lines(axes, lines, x_label="reference scenes", y_label=y_label, title=title, scale="symlog")
    _write(figure, path)


def pretraining(study: Study, path: Path) -> None:
    """Errors over the epochs of the last stage, a panel for each domain; see ``pretraining.curves``."""
    figure, panels = _figure(len(study["ade"]))
    for axes, (domain, variants) in zip(panels, study["ade"].items(), strict=True):
        lines = {name: {float(n): v for n, v in enumerate(values, 1)} for name, values in variants.items()}
        label = "epoch of the last stage"
        _draw_lines(axes, lines, x_label=label, y_label=f"ADE, {study['unit']}", title=domain, scale="log")
        ticks = [1, 3, 10, 30, 100]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
    _write(figure, path)


def over_time(panels: Mapping[str, Mapping[str, Sequence[Result]]], path: Path, title: str) -> None:
    """Trailing means over the time of streams, a panel for each kind, the mean over seeds.

    Args:
        panels: Online results of all seeds, by kind and row.
        path: File of the SVG.
        title: Heading.
    """
    everything = [result for rows in panels.values() for results in rows.values() for result in results]
    measured(everything)
    figure, all_axes = _figure(len(panels), 9, 3.2)
    for axes, (kind, rows) in zip(all_axes, panels.items(), strict=True):
        for color, (row, results) in zip(_colors("tab20"), rows.items(), strict=False):
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
        y_label = f"ADE over the last 50 forecasts, {unit_of(everything)}"
        axes.set(xlabel="seconds", ylabel=y_label, title=f"{title}: {kind}")
        axes.title.set_fontsize(9)
        axes.grid(alpha=0.3)
        axes.set_ylim(0, None)
    all_axes[-1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    _write(figure, path)


def one_scene(study: Study, path: Path) -> None:
    """One scene forecast by several predictors, a panel for each alpha; see ``studies.one_scene``."""
    rows = list(next(iter(study["panels"].values())))
    _scene_panels(study, path, dict(zip(rows, itertools.cycle(_colors("tab10")), strict=False)))


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


def _draw_lines(axes: Any, lines: Lines, *, x_label: str, y_label: str, title: str, scale: str) -> None:
    """A line for each row through the means over seeds, with a band of one standard deviation.

    ``scale`` is that of the x axis: ``linear``, ``log``, or ``symlog``, which has a place for 0.
    """
    for color, (row, points) in zip(_colors("tab20"), lines.items(), strict=False):
        places, columns = list(points), [np.asarray(column) for column in points.values()]
        mean = np.array([column.mean() for column in columns])
        deviation = np.array([column.std(ddof=1) if len(column) > 1 else 0.0 for column in columns])
        style = "--" if len(columns[0]) == 1 else "o-" if len(places) < 20 else "-"
        axes.plot(places, mean, style, color=color, label=row, markersize=4, linewidth=1.4)
        axes.fill_between(places, mean - deviation, mean + deviation, color=color, alpha=0.15, linewidth=0)
    if scale != "linear":
        axes.set_xscale(scale, base=2)
    ticks = sorted({place for points in lines.values() for place in points})
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set(xlabel=x_label, ylabel=y_label)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)


def _figure(panels: int, width: float = 8, height: float = 4.8) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height * panels), layout="constrained")
    return figure, figure.subplots(panels, squeeze=False)[:, 0]


def _colors(name: str) -> Sequence[Any]:
    return matplotlib.colormaps[name].colors  # type: ignore[attr-defined, no-any-return]


def _write(figure: Figure, path: Path) -> None:
    buffer = io.BytesIO()
    # Without the date and with ids that are not random, so that the same results give the same file.
    with matplotlib.rc_context({"svg.hashsalt": "motion_gym"}):
        figure.savefig(buffer, format=path.suffix[1:], metadata={"Date": None} if path.suffix == ".svg" else None)
    write_atomic(path, buffer.getvalue())
