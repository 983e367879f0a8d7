"""The page of a benchmark: its tables and figures, made from stored runs and studies."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks import (
    figures,
    online_benchmark,
    online_tables,
    published_tables,
    seed_tables,
    studies,
    study_tables,
)
from motion_gym.benchmarks.claims import NOWHERE, Claim, claims_table, compare, part_panels
from motion_gym.benchmarks.shipped import PLAIN, Found
from motion_gym.benchmarks.table import Table
from motion_gym.data.storage import write_atomic

DRAWN = ("erm_no_sigma", "erm", "counterfactual", "invariant", "vrex", "group_dro", "erm:sigma=relative")
"""Predictors of the figure of one scene."""
OVER_D = "d in metres (trained with 0.1, 0.3 and 0.5)"

TABLE_CLAIMS: Mapping[str, Sequence[Claim]] = {
    "style": (
        Claim(
            "The invariance penalty alone gives no clear advantage", ["style_invariant"], ["style_erm"], where=NOWHERE
        ),
        Claim("A style lowers the error", ["modular"], ["style_erm"]),
        Claim("An invariant encoder helps out of distribution", ["modular_invariant"], ["modular"]),
        Claim("A style lowers the error, in each agent's own frame", ["ego_modular"], ["ego_erm"]),
    ),
    "crowd": (Claim("A style lowers the error of STGAT", ["modular_stgat"], ["erm_no_sigma"]),),
    "transfer": (
        Claim("Tuning f alone is better than tuning everything", ["transfer:parts=modulator"], ["transfer:parts=all"]),
        Claim(
            "Tuning f alone is better than tuning psi, f and g", ["transfer:parts=modulator"], ["transfer:parts=style"]
        ),
        Claim("Tuning f is better than reading the style alone", ["transfer:parts=modulator"], ["modular_invariant"]),
        Claim("Refinement lowers the error after tuning f", ["refine:of=transfer"], ["transfer:parts=modulator"]),
        Claim("Refinement lowers the error without tuning", ["refine"], ["modular_invariant"]),
    ),
    "refinement": (
        Claim("Refinement by 3 steps lowers the error of modular_invariant", ["refine"], ["modular_invariant"]),
        Claim("Refinement by 3 steps lowers the error of modular", ["refine:of=modular"], ["modular"]),
    ),
}
"""Claims that stand in the tables of a benchmark."""

Report = Callable[[int, int, str], None]
Page = tuple[list[Table], list[Path]]


def write(name: str, found: Found, folder: Path, report: Report = lambda done, of, what: None) -> list[Path]:
    """Write tables and figures of a benchmark into ``folder``; returns their paths."""
    parts = [seed_tables.part_tables(part, results) for part, results in found]
    further, written = PAGES[name](found, folder, report)
    tables = [*(parts[0] if parts else []), *further, *(table for part in parts[1:] for table in part)]
    path = folder / "tables.md"
    write_atomic(path, ("\n\n".join(table.markdown() for table in tables) + "\n").encode())
    return [path, *written]


def short(name: str, found: Found, folder: Path) -> str:
    """The table for a README, after ``write``."""
    if name == "original":
        return published_tables.original(found).markdown(0)
    if name == "pretraining":
        return study_tables.pretraining(study(folder, "pretraining", dict)).markdown(0)
    if name == "online":
        _, streams = online_benchmark.read(folder)
        sudden = {shift: online_rows(streams, shift, "sudden") for shift in online_benchmark.SHIFTS}
        titles = {shift: shifts.title for shift, shifts in online_benchmark.SHIFTS.items()}
        return online_tables.summary_table(titles, sudden).markdown(0)
    return seed_tables.short_table(*found[0]).markdown(0)


def study(folder: Path, name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """A study that is stored in a folder of results, or computed and stored now."""
    path = folder / "studies" / f"{name}.json"
    if not path.exists():
        write_atomic(path, json.dumps(compute()).encode())
    return json.loads(path.read_text())  # type: ignore[no-any-return]


def online_rows(streams: online_benchmark.Found, shift: str, kind: str) -> dict[str, list[dict[str, Any]]]:
    """Results of the seeds by row of one stream."""
    fixed = (online_tables.BASELINE, online_tables.NONE)
    rows = (*fixed, *online_benchmark.SHIFTS[shift].rows, online_tables.ORACLE)
    return {row: streams[shift, kind, row] for row in rows}


def _claims(name: str, found: Found, heading: str) -> Table:
    return claims_table(compare(TABLE_CLAIMS[name], part_panels(found)), heading)


def _spurious(found: Found, folder: Path, report: Report) -> Page:
    part, results = found[0]
    place = next(iter(part.domains.values()))
    choice = study(folder, "left_out", lambda: studies.left_out(PLAIN[2:], place))
    scene = study(folder, "one_scene", lambda: studies.one_scene("eth", (1, 8, 64), DRAWN, part.weights))
    paths = [folder / "ade.svg", folder / "jade_20.svg", folder / "scene.svg"]
    for metric, path in zip(("ADE", "JADE_20"), paths, strict=False):
        figures.error_over(part, results, metric, path, "alpha (trained with 1 to 8)", log=True)
    figures.one_scene(scene, paths[2])
    return [published_tables.spurious(found), study_tables.left_out(choice)], paths


def _style(found: Found, folder: Path, report: Report) -> Page:
    part, results = found[0]
    rows = [row for row in part.trained if hasattr(catalog.predictor(row), "observe")]
    domains = {style: part.domains[style] for style in ("0.4", "0.6")}
    curve = study(folder, "by_references", lambda: studies.by_references(rows, part.weights, domains))
    paths = [folder / "ade.svg", folder / "references.svg"]
    figures.error_over(part, results, "ADE", paths[0], OVER_D, log=False)
    figures.by_references(curve, paths[1])
    return [published_tables.style(found), _claims("style", found, "d"), study_tables.by_references(curve)], paths


def _crowd(found: Found, folder: Path, report: Report) -> Page:
    figures.error_over(*found[0], "ADE", folder / "ade.svg", OVER_D, log=False)
    return [_claims("crowd", found, "d")], [folder / "ade.svg"]


def _transfer(found: Found, folder: Path, report: Report) -> Page:
    paths = [folder / "honest.svg", folder / "paper.svg"]
    for (part, results), path in zip(found, paths, strict=False):
        figures.error_over(part, results, "ADE", path, "batches of 64 scenes of d = 0.6", log=False)
    return [_claims("transfer", found, "batches"), seed_tables.schedules(found)], paths


def _refinement(found: Found, folder: Path, report: Report) -> Page:
    part, results = found[0]
    right, wrong = part.domains["0.6"], part.domains["0.1"]
    scene = study(folder, "two_agents", lambda: studies.two_agents("modular_invariant", part.weights, right, wrong))
    paths = [folder / "ade.svg", folder / "two_agents.svg"]
    figures.error_over(part, results, "ADE", paths[0], OVER_D, log=False)
    figures.two_agents(scene, paths[1])
    return [_claims("refinement", found, "d")], paths


def _pretraining(found: Found, folder: Path, report: Report) -> Page:
    train = catalog.load_class("motion_gym.predictors.training.pretraining:curves", "training")
    curves = study(folder, "pretraining", lambda: train(report))
    figures.pretraining(curves, folder / "curves.svg")
    return [study_tables.pretraining(curves)], [folder / "curves.svg"]


def _online(found: Found, folder: Path, report: Report) -> Page:
    tried, streams = online_benchmark.run(folder, report)
    tables, paths = [], []
    for name, shifts in online_benchmark.SHIFTS.items():
        settings = {
            row: spec for row, spec in online_benchmark.chosen(tried[name]).items() if row != online_tables.NONE
        }
        where = " then ".join(shifts.chosen_on["domains"])
        tables.append(online_tables.choice_table(where, shifts.chosen_with, tried[name]))
        panels = {kind: online_rows(streams, name, kind) for kind in shifts.streams}
        for kind, rows in panels.items():
            tables.append(online_tables.stream_table(f"{shifts.title}: {kind}", rows, settings))
        tables.append(online_tables.milestones_table(f"{shifts.title}: after the sudden shift", panels["sudden"]))
        paths.append(folder / f"{name}.svg")
        figures.over_time(panels, paths[-1], shifts.title)
    return tables, paths


PAGES: dict[str, Callable[[Found, Path, Report], Page]] = {
    "spurious": _spurious,
    "original": lambda found, folder, report: ([published_tables.original(found)], []),
    "style": _style,
    "crowd": _crowd,
    "transfer": _transfer,
    "refinement": _refinement,
    "pretraining": _pretraining,
    "online": _online,
}
"""Tables after the first one, and figures, of each benchmark."""
