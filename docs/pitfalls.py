"""Writes docs/pitfalls.md: each pitfall with numbers from stored runs, or from a short computation on ETH-UCY.

Run it from anywhere, with ETH-UCY on this computer: python docs/pitfalls.py
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import motion_gym
from motion_gym import catalog
from motion_gym.benchmarks import running
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.objects import Part
from motion_gym.benchmarks.reports.table import Table, number
from motion_gym.benchmarks.store import Run
from motion_gym.data import datasets
from motion_gym.metrics.bootstrap import clustered_interval
from motion_gym.metrics.errors import ade
from motion_gym.stepping.harness import ask
from motion_gym.training.provenance import measurement_noise

PLACES = ("eth", "eth6", "hotel", "univ", "zara1", "zara2")
INTRODUCTION = (
    "Each section names a choice in the evaluation of trajectory forecasts, and what it does to the numbers. Errors "
    "are in metres, on ETH-UCY. `python docs/pitfalls.py` writes this page from stored runs and from the recordings."
)


def page() -> str:
    """The page, as Markdown."""
    return "\n\n".join(["# Pitfalls in trajectory evaluation", INTRODUCTION, *from_runs(), *from_recordings()]) + "\n"


def from_runs() -> Iterator[str]:
    """Sections whose numbers are in stored runs."""
    yield _best_of_20()
    yield _scene_minimum()
    yield _frame_rate()
    yield _future_leak()


def from_recordings() -> Iterator[str]:
    """Sections whose numbers are computed from the recordings, in seconds."""
    yield _clusters()
    yield _annotation_noise()
    yield _time_step()


def _best_of_20() -> str:
    rows = {
        "`constant_velocity`": "constant_velocity",
        "`kalman_velocity`, no learning": "kalman_velocity",
        "`kalman_residual`": "kalman_residual",
    }
    errors = {
        label: [_mean("places", row, place, metric) for place in ("hotel", "zara1") for metric in ("ADE", "minADE_20")]
        for label, row in rows.items()
    }
    one, twenty = errors["`kalman_velocity`, no learning"][2:]
    table = _table(
        ["method", "hotel, k = 1", "hotel, best of 20", "zara1, k = 1", "zara1, best of 20"],
        [[label, *map(number, values)] for label, values in errors.items()],
    )
    return _section(
        "Best of 20 against one forecast",
        "Best of 20 (minADE_20) takes, for each agent, the sample with the lowest error. The ground truth chooses the "
        "sample, which no robot can do.",
        table,
        f"At zara1 the samples of a filter lower its error by {100 * (1 - twenty / one):.0f} %; its one forecast is no "
        "better than constant velocity. A deterministic method has no such gain. Compare methods at the same k, and "
        "state k = 1.",
    )


def _scene_minimum() -> str:
    sizes: dict[str, float] = {}
    rows = {}
    for place in PLACES:
        (run,) = _runs("places", "kalman_velocity", place)
        agent, scene, count = (run["metrics"][name] for name in ("minADE_20", "JADE_20", "ADE"))
        sizes[place] = count["agent_windows"] / count["scenes"]
        one, of_agent, of_scene = (number(part["mean"]) for part in (count, agent, scene))
        rows[place] = [place, f"{sizes[place]:.1f}", one, of_scene, of_agent]
    ordered = [rows[place] for place in sorted(sizes, key=lambda place: sizes[place])]
    place, _, one, of_scene, _ = ordered[-1]
    return _section(
        "Minimum over the scene against minimum over agents",
        "minADE_20 chooses a sample for each agent; the chosen samples of two agents may collide. JADE_20 chooses one "
        "sample for the whole scene. Published programs report one or the other under the name ADE.",
        _table(
            ["`kalman_velocity` at", "agents in a scene", "k = 1", "scene minimum", "agent minimum"],
            ordered,
        ),
        "With many agents in a scene, the scene minimum hardly differs from the error of one forecast: at "
        f"{place} it is {of_scene} against {one}. State which minimum a table shows.",
    )


def _frame_rate() -> str:
    rows = []
    for row in ("constant_velocity", "constant_velocity:velocity=4", "kalman_residual"):
        rows.append([f"`{row}`", *(number(_mean("places", row, place, "ADE")) for place in ("eth", "eth6"))])
    slow, true = (_mean("places", "constant_velocity", place, "ADE") for place in ("eth", "eth6"))
    windows = [_runs("places", "constant_velocity", p)[0]["metrics"]["ADE"]["agent_windows"] for p in ("eth", "eth6")]
    return _section(
        "The frame rate of eth",
        "The file that published evaluations use for eth lists every 10th frame, which is 0.667 s in this recording. "
        "It is scored as 0.4 s, so that people seem to walk 1.67 times too fast. `eth6` is the same scene with steps "
        "of 0.4 s.",
        _table(["method", "eth", "eth6"], rows),
        f"The error of constant velocity at eth is {slow / true:.2f} times that at eth6, on {windows[0]} against "
        f"{windows[1]} agent-windows. A mean over the five places inherits it.",
    )


def _future_leak() -> str:
    rows = []
    for label, part in (("future, `sigma=paper`", 0), ("past, `sigma=past`", 1)):
        for row in ("linear", "linear:sigma=true"):
            errors = [_mean("spurious", row, column, "ADE", part) for column in ("8", "64")]
            rows.append([label, f"`{row}`", *map(number, errors)])
    plain, leaking = (_mean("spurious", row, "8", "ADE", 0) for row in ("linear", "linear:sigma=true"))
    return _section(
        "Inputs that read the future",
        "The noise feature sigma of the paper is computed from steps that are forecast. Predictors are trained with "
        "alpha up to 8 and tested at eth.",
        _table(["sigma reads the", "method", "alpha = 8", "alpha = 64"], rows),
        f"With the leak the error at alpha = 8 is {100 * (1 - leaking / plain):.0f} % lower, and the gain looks like "
        "that of a better model. Where sigma reads the past the gain is gone. [Protocols](protocols.md) says how leaks "
        "are found.",
    )


def _clusters() -> str:
    rows, ratios = [], {}
    for place in PLACES:
        truth = catalog.domain(place).windows("test")
        error = ade(ask(catalog.predictor("constant_velocity"), truth.observation), truth)
        intervals = [clustered_interval(error, each) for each in (truth.observation.agent, np.arange(len(error)))]
        widths = [interval.high - interval.low for interval in intervals]
        ratios[place] = widths[0] / widths[1]
        people = f"{len(error)} / {len(np.unique(truth.observation.agent))}"
        shown = [f"[{number(interval.low)}, {number(interval.high)}]" for interval in intervals]
        rows.append([place, people, *shown, f"{ratios[place]:.1f}"])
    widest = max(ratios, key=lambda place: ratios[place])
    return _section(
        "Intervals over windows against intervals over people",
        "Windows of one person overlap, so their errors are not independent. A bootstrap over windows is too narrow. "
        "motion-gym resamples people.",
        _table(["ADE of `constant_velocity` at", "windows / people", "over people", "over windows", "ratio"], rows),
        f"At {widest} the honest interval is {ratios[widest]:.1f} times as wide.",
    )


def _annotation_noise() -> str:
    rows = []
    for place in PLACES:
        last, mean = (
            _mean("places", row, place, "ADE") for row in ("constant_velocity", "constant_velocity:velocity=4")
        )
        noise = measurement_noise(catalog.domain(place).windows("test")) or 0.0
        rows.append([place, f"{1000 * noise:.2g}", number(last), number(mean), f"{100 * (mean / last - 1):+.0f} %"])
    return _section(
        "Annotation noise",
        "Positions of eth and hotel are raw annotations; those of univ and zara are splines through few points. The "
        "noise of a coordinate is estimated from third differences of positions.",
        _table(["place", "noise, mm (upper bound)", "velocity of the last step", "mean of the last 4", "change"], rows),
        "Averaging the velocity helps on raw positions and hurts on splines. A method that is tuned on one kind of "
        "annotation carries its memory length to the other. Report places one by one.",
    )


def _time_step() -> str:
    path = datasets.locate("eth_ucy", "crowds_zara01.txt")
    rows, found = [], {}
    for step in (0.4, 0.8):
        domain = motion_gym.domain("tracks", path=str(path), fps=25, step=step, split="0 0 1")
        card = motion_gym.evaluate("constant_velocity", domain)
        found[step] = card
        at = round(4.8 / step) - 1
        rows.append([f"{step} s", f"{12 * step:.1f} s", number(card.ade.mean), number(card.horizon[at])])
    ratio = found[0.8].ade.mean / found[0.4].ade.mean
    return _section(
        "The time step",
        "12 steps are 4.8 s at 0.4 s a step, and 9.6 s at 0.8 s. Tables that say only 8 and 12 steps hide this. The "
        "rows are the same recording, crowds_zara01.",
        _table(["step", "horizon", "ADE of `constant_velocity`", "error 4.8 s ahead"], rows),
        f"Twice the step makes the ADE {ratio:.1f} times as large. Compare errors at equal seconds ahead. Weights "
        "are trained at one step, and motion-gym refuses them at another.",
    )


@functools.cache
def _parts(benchmark: str) -> list[tuple[Part, list[Run]]]:
    return running.run(benchmark, only=()).parts


def _runs(benchmark: str, row: str, column: str, part: int | None = None) -> list[Run]:
    """Stored runs of a row at a column, one for each seed of its weights; of one part of a benchmark, or of all."""
    found = []
    for place, (table, runs) in enumerate(_parts(benchmark)):
        for run in runs if part in (None, place) else ():
            if row_name(run["predictor"]) == row and table.column_of(run) == column:
                found.append(run)
    return found


def _mean(benchmark: str, row: str, column: str, metric: str, part: int | None = None) -> float:
    """Mean of a metric over the seeds."""
    return float(np.mean([run["metrics"][metric]["mean"] for run in _runs(benchmark, row, column, part)]))


def _table(columns: list[str], rows: list[list[str]]) -> str:
    return Table("", columns, rows).markdown(heading=0)


def _section(title: str, what: str, table: str, then: str) -> str:
    return f"## {title}\n\n{what}\n\n{table}\n\n{then}"


if __name__ == "__main__":
    (Path(__file__).parent / "pitfalls.md").write_text(page())
