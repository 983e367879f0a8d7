"""Curves of the benchmarks: numbers over an x axis, for figures and for the results page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.benchmarks.objects import Part
from motion_gym.benchmarks.reports.conditions import Result, measured, unit_of
from motion_gym.benchmarks.reports.seed_tables import over_seeds

POINTS = 100
"""Points of a curve over the time of a stream."""
MARKED = 0.1
"""The start of a segment is marked if the segment is longer than this share of the stream."""

Study = Mapping[str, Any]


@dataclass(frozen=True)
class Line:
    """One method: mean over seeds, and the standard deviation over seeds.

    Attributes:
        x: [N] places on the x axis.
        mean: [N] means over seeds.
        deviation: [N] standard deviations over seeds; zeros for one seed.
        seeds: Number of seeds.
    """

    x: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    seeds: int


@dataclass(frozen=True)
class Curves:
    """Curves that share their axes.

    Attributes:
        title: Heading.
        x_label: Label of the x axis.
        y_label: Label of the y axis, with the unit.
        lines: Lines by method.
        scale: Scale of the x axis: ``linear``, ``log``, or ``symlog``, which has a place for 0.
        ticks: Places on the x axis that are labelled; none for any.
        marks: Places on the x axis with a text, such as the starts of segments.
    """

    title: str
    x_label: str
    y_label: str
    lines: Mapping[str, Line]
    scale: str = "linear"
    ticks: Sequence[float] = ()
    marks: Sequence[tuple[float, str]] = ()


def error_over(part: Part, results: Sequence[Result], metric: str, label: str, log: bool) -> Curves:
    """Error by a parameter of the domains.

    Args:
        part: A part whose domains are named by the value of the parameter.
        results: Results of its runs.
        metric: Name of the metric.
        label: The parameter, and its values in training.
        log: Whether the axis of the parameter is logarithmic.
    """
    measured(results)  # refuses to mix units or versions
    values = over_seeds(part, results, metric)
    rows = dict.fromkeys(row for row, _ in values)
    lines = {row: _line({float(n): values[row, n] for n in part.domains if (row, n) in values}) for row in rows}
    ticks = [float(n) for n in part.domains]
    y_label = f"{metric}, {unit_of(results)}"
    return Curves(part.title, label, y_label, lines, "log" if log else "linear", ticks)


def by_references(study: Study) -> list[Curves]:
    """The error by the number of reference scenes; see ``studies.by_references``."""
    lines = {
        f"{row}, d = {name}": _line(dict(zip(map(float, study["counts"]), by_count, strict=True)))
        for name, by_row in study["ade"].items()
        for row, by_count in by_row.items()
    }
    title = "The style is read from reference scenes"
    ticks = [float(count) for count in study["counts"]]
    return [Curves(title, "reference scenes", f"ADE, {study['unit']}", lines, "symlog", ticks)]


def pretraining(study: Study) -> list[Curves]:
    """Errors over the epochs of the last stage, one for each domain; see ``pretraining.curves``."""
    return [
        Curves(
            domain,
            "epoch of the last stage",
            f"ADE, {study['unit']}",
            {name: _line({float(n): v for n, v in enumerate(values, 1)}) for name, values in variants.items()},
            "log",
            (1, 3, 10, 30, 100),
        )
        for domain, variants in study["ade"].items()
    ]


def over_time(panels: Mapping[str, Mapping[str, Sequence[Result]]], title: str) -> list[Curves]:
    """Trailing means over the time of streams, one for each kind.

    Args:
        panels: Online results of all seeds, by kind and row.
        title: Heading.
    """
    everything = [result for rows in panels.values() for results in rows.values() for result in results]
    measured(everything)
    y_label = f"ADE over the last 50 forecasts, {unit_of(everything)}"
    return [
        Curves(
            f"{title}: {kind}",
            "seconds",
            y_label,
            _trailing(rows),
            marks=_starts(next(iter(rows.values()))[0]),
        )
        for kind, rows in panels.items()
    ]


def _trailing(rows: Mapping[str, Sequence[Result]]) -> dict[str, Line]:
    """The trailing means of all rows and seeds at the same times."""
    curves = {row: [np.array(result["curve"]) for result in results] for row, results in rows.items()}
    everything = [curve for by_seed in curves.values() for curve in by_seed]
    at = np.linspace(max(c[0, 0] for c in everything), min(c[-1, 0] for c in everything), POINTS)
    lines = {}
    for row, by_seed in curves.items():
        values = np.array([np.interp(at, c[:, 0], c[:, 1]) for c in by_seed])
        lines[row] = Line(at, values.mean(axis=0), _deviation(values), len(values))
    return lines


def _starts(result: Result) -> list[tuple[float, str]]:
    """Starts of the long segments of a stream, with their domains."""
    end = result["segments"][-1]["stop"]
    return [(s["start"], s["domain"]) for s in result["segments"] if s["stop"] - s["start"] > MARKED * end]


def _line(points: Mapping[float, Any]) -> Line:
    columns = [np.asarray(column, dtype=float) for column in points.values()]
    mean = np.array([column.mean() for column in columns])
    deviation = np.array([float(_deviation(column)) for column in columns])
    return Line(np.array(list(points)), mean, deviation, max(len(column) for column in columns))


def _deviation(values: np.ndarray) -> np.ndarray:
    """Standard deviation over the first axis, the seeds; 0 for one seed."""
    return np.std(values, axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1:])
