"""What a benchmark leaves besides its runs: tables and figures.

The tables are made from the results. The choice on the sources and the figures of one scene are made anew.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from motion_gym import catalog
from motion_gym.benchmarks import (
    adaptation_report,
    figures,
    online_report,
    pretraining_report,
    seed_tables,
    source_selection,
    style_report,
)
from motion_gym.benchmarks.shipped import PLAIN, SAMPLES, Found, Part
from motion_gym.contract import Domain
from motion_gym.data.storage import write_atomic

DRAWN = ("erm_no_sigma", "erm", "counterfactual", "invariant", "vrex", "group_dro", "erm:sigma=relative")
"""Predictors of the figure of one scene."""


Report = Callable[[int, int, str], None]


def write(name: str, found: Found, folder: Path, report: Report = lambda done, of, what: None) -> list[Path]:
    """Write tables and figures of a benchmark into ``folder``; returns their paths."""
    texts = [seed_tables.markdown(part, results) for part, results in found]
    more, written = REPORTS[name](found, folder, report)
    path = folder / "tables.md"
    write_atomic(path, ("\n\n".join(texts[:1] + more + texts[1:]) + "\n").encode())
    return [path, *written]


def _spurious(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    part, results = found[0]
    texts = [seed_tables.against_published(part, results)]
    texts.append(source_selection.markdown(source_selection.left_out(PLAIN[2:], _first_domain(part))))
    paths = [folder / "ade.svg", folder / f"jade_{SAMPLES}.svg", folder / "scene.svg"]
    for metric, path in zip(("ADE", f"JADE_{SAMPLES}"), paths, strict=False):
        figures.error_over(part, results, metric, path, "alpha (trained with 1 to 8)", log=True)
    figures.one_scene(part, DRAWN, paths[2])
    return texts, paths


def _original(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    return [seed_tables.original_beside_published(found)], []


def _style(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    part, results = found[0]
    texts = [style_report.beside_published(found), style_report.claims(found, style_report.CLAIMS)]
    path = folder / "ade.svg"
    figures.error_over(part, results, "ADE", path, "d in metres (trained with 0.1, 0.3 and 0.5)", log=False)
    curves = folder / "references.svg"
    texts.append(style_report.by_references(part, curves))
    return texts, [path, curves]


def _crowd(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    path = folder / "ade.svg"
    figures.error_over(*found[0], "ADE", path, "d in metres (trained with 0.1, 0.3 and 0.5)", log=False)
    return [style_report.claims(found, style_report.CROWD_CLAIMS)], [path]


def _transfer(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    texts = [
        style_report.claims(found, adaptation_report.TRANSFER_CLAIMS, "batches"),
        adaptation_report.schedules(*found[-1]),
    ]
    paths = []
    for (part, results), name in zip(found, ("honest", "paper"), strict=False):
        paths.append(folder / f"{name}.svg")
        figures.error_over(part, results, "ADE", paths[-1], "batches of 64 scenes of d = 0.6", log=False)
    return texts, paths


def _refinement(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    part, results = found[0]
    paths = [folder / "ade.svg", folder / "two_agents.svg"]
    figures.error_over(part, results, "ADE", paths[0], "d in metres (trained with 0.1, 0.3 and 0.5)", log=False)
    adaptation_report.two_agents(part, paths[1])
    return [style_report.claims(found, adaptation_report.REFINEMENT_CLAIMS)], paths


def _pretraining(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    text, paths = pretraining_report.write(folder, report)
    return [text], paths


def _online(found: Found, folder: Path, report: Report) -> tuple[list[str], list[Path]]:
    text, paths = online_report.write(folder, report)
    return [text], paths


REPORTS: dict[str, Callable[[Found, Path, Report], tuple[list[str], list[Path]]]] = {
    "spurious": _spurious,
    "original": _original,
    "style": _style,
    "crowd": _crowd,
    "transfer": _transfer,
    "refinement": _refinement,
    "pretraining": _pretraining,
    "online": _online,
}
"""What each benchmark has besides the tables of its parts: further tables, after the first one, and figures."""


SHORT: dict[str, Callable[[Found, Path], str]] = {
    "original": lambda found, folder: seed_tables.original_beside_published(found),
    "pretraining": lambda found, folder: (folder / "tables.md").read_text().strip(),
    "online": lambda found, folder: online_report.short(folder),
}
"""The table for a README where it is not that of the first part."""


def _first_domain(part: Part) -> Domain:
    return catalog.domain(next(iter(part.domains.values())))


def short(name: str, found: Found, folder: Path) -> str:
    """The table for a README, after ``write``."""
    return SHORT[name](found, folder) if name in SHORT else seed_tables.short(*found[0])
