"""The tables of the study of driving styles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from motion_gym.benchmarks.reports.table import Code, Table
from motion_gym.benchmarks.studies.driving_styles import MEASURES


def driving_styles(study: Mapping[str, Any]) -> Table:
    """How vehicles of each style drive, with 95 % intervals; see ``driving_styles.driving_styles``."""
    rows = [[Code(style), *map(_interval, measures.values())] for style, measures in study["measures"].items()]
    caption = (
        "Measured from the positions of the test split on the straight road, mean and 95 % interval by the bootstrap "
        f"of whole vehicles. Time headway and gap, bumper to bumper, of vehicles that follow another one in less than "
        f"{study['following']:g} s."
    )
    notes = [f"unit {study['unit']}, dt {study['dt']:g} s", *_counts(study["counts"])]
    return Table("Driving styles are visible in the data", ["style", *MEASURES.values()], rows, notes, caption)


def _interval(values: list[float]) -> str:
    mean, low, high = (f"{value:.2f}" for value in values)
    return f"{mean} [{low}, {high}]"


def _counts(counts: Mapping[str, Mapping[str, Mapping[str, int]]]) -> list[str]:
    """The smallest number of agent-windows of a style by split, and the vehicles that crashed."""
    notes = []
    for split in ("train", "test"):
        windows = {name: splits[split] for name, splits in counts.items() if split in splits}
        fewest = min(windows, key=lambda name: windows[name]["agent_windows"])
        crashed = {name: counted["crashed_agents"] for name, counted in windows.items() if counted["crashed_agents"]}
        listed = ", ".join(f"{number} in {name}" for name, number in crashed.items()) or "none"
        notes.append(
            f"{split}: at least {windows[fewest]['agent_windows']} agent-windows of {windows[fewest]['agents']} agents "
            f"({fewest}); crashed vehicles, which are left out: {listed}"
        )
    return notes
