"""What a benchmark leaves besides its runs: tables and figures.

The tables are made from the results. The choice on the sources and the figure of one scene are made anew.
"""

from __future__ import annotations

from pathlib import Path

from motion_gym import catalog, figures, seed_tables, source_selection
from motion_gym.benchmarks import PLAIN, SAMPLES, Found, Part
from motion_gym.contract import Domain
from motion_gym.storage import write_atomic

DRAWN = ("erm_no_sigma", "erm", "counterfactual", "invariant", "vrex", "group_dro", "erm:sigma=relative")
"""Predictors of the figure of one scene."""


def write(name: str, found: Found, folder: Path) -> list[Path]:
    """Write tables and figures of a benchmark into ``folder``; returns their paths."""
    texts = [seed_tables.markdown(part, results) for part, results in found]
    written = []
    if name == "spurious":
        part, results = found[0]
        texts.insert(1, seed_tables.against_published(part, results))
        chosen = source_selection.left_out(PLAIN[2:], _first_domain(part))
        texts.insert(2, source_selection.markdown(chosen))
        for metric, file in (("ADE", "ade.svg"), (f"JADE_{SAMPLES}", f"jade_{SAMPLES}.svg")):
            figures.error_over_alpha(part, results, metric, folder / file)
            written.append(folder / file)
        figures.one_scene(part, DRAWN, folder / "scene.svg")
        written.append(folder / "scene.svg")
    else:
        texts.append(seed_tables.original_beside_published(found))
    path = folder / "tables.md"
    write_atomic(path, ("\n\n".join(texts) + "\n").encode())
    return [path, *written]


def _first_domain(part: Part) -> Domain:
    return catalog.domain(next(iter(part.domains.values())))


def short(name: str, found: Found) -> str:
    """The table for a README."""
    if name == "spurious":
        return seed_tables.short(*found[0])
    return seed_tables.original_beside_published(found)
