"""Our numbers beside the numbers of the paper and of its published weights."""

from __future__ import annotations

import numpy as np

from motion_gym.benchmarks import published
from motion_gym.benchmarks.reports.claims import Panel
from motion_gym.benchmarks.reports.conditions import measured, scored, unit_of
from motion_gym.benchmarks.reports.seed_tables import SEEDS, Parts, further_notes, over_seeds
from motion_gym.benchmarks.reports.table import Code, Table, number, percent, spread


def spurious(parts: Parts) -> Table:
    """Errors on ``eth`` by alpha: our numbers, the paper's, and those of the published weights."""
    part, results = parts[0]
    columns = ["method", "alpha", "k", "ours, ADE / FDE", "the paper, ADE", "published weights, ADE / FDE", "gap"]
    rows = []
    for k, (ade, fde) in ((1, ("ADE", "FDE")), (20, ("JADE_20", "JFDE_20"))):
        ades, fdes = over_seeds(part, results, ade), over_seeds(part, results, fde)
        paper = published.PAPER if k > 1 else {}
        for row in dict.fromkeys([*published.PAPER, *published.WEIGHTS[k]]):
            for alpha in published.ALPHAS:
                ours = ades.get((row, str(alpha)))
                theirs, weights = paper.get(row, {}).get(alpha), published.WEIGHTS[k].get(row, {}).get(alpha)
                if theirs is None and weights is None:
                    continue
                cell = gap = "-"
                if ours is not None:
                    cell = f"{spread(ours)} / {spread(fdes[row, str(alpha)])}"
                    gap = percent(ours.mean() / (theirs or weights or (1.0,))[0] - 1)
                first = "-" if theirs is None else number(theirs[0])
                second = "-" if weights is None else f"{number(weights[0])} / {number(weights[1])}"
                rows.append([Code(row), str(alpha), str(k), cell, first, second, gap])
    caption = (
        "The paper gives the best of 20 in its figure (no FDE). The published weights are of one seed. Ours are means "
        "over seeds. The gap is ours against the paper where it has a number, else against the published weights."
    )
    return Table("Beside the published numbers", columns, rows, [measured(results)], caption)


def original(parts: Parts) -> Table:
    """Errors without the noise feature: a column for each test place, and the paper's numbers for ``hotel``."""
    places = [next(iter(part.domains)) for part, _ in parts]
    tables = [(over_seeds(part, results, "ADE"), over_seeds(part, results, "FDE")) for part, results in parts]
    rows = []
    for row in dict.fromkeys(row for ades, _ in tables for row, _ in ades):
        cells = [
            f"{spread(ades[row, place])} / {spread(fdes[row, place])}" if (row, place) in ades else "-"
            for place, (ades, fdes) in zip(places, tables, strict=True)
        ]
        paper = published.ORIGINAL.get(row)
        rows.append([Code(row), *cells, "-" if paper is None else " / ".join(map(number, paper))])
    everything = [result for _, results in parts for result in results]
    notes = [f"protocol {parts[0][0].protocol}; {measured(everything)}; {SEEDS}"]
    notes += [f"{place}: {scored(results)}" for place, (_, results) in zip(places, parts, strict=True)]
    notes += dict.fromkeys(note for part, results in parts for note in further_notes(part, results))
    title = "Original ETH-UCY, no noise feature, trained on the other four places"
    columns = ["method", *places, "the paper, hotel"]
    return Table(title, columns, rows, notes, f"ADE / FDE, {unit_of(everything)}, k = 1")


def style(parts: Parts) -> Table:
    """ADE of style shifts: our numbers under both protocols, and the paper's."""
    errors = {part.protocol: over_seeds(part, results) for part, results in parts if part.weights == "style"}
    rows = []
    for row, cells in published.STYLE.items():
        for column, theirs in cells.items():
            honest = errors["honest"][row, column]
            paper = errors["paper"].get((row, column), honest)  # without a style both protocols are the same
            gap = percent(paper.mean() / theirs - 1)
            rows.append([Code(row), column, spread(honest), spread(paper), number(theirs), gap])
    caption = (
        "ADE in metres, k = 1, mean ± standard error over seeds. Under the protocol `paper` the style is read from the "
        "future of the scored scenes. The paper's modular rows were scored so. Without a style both protocols are the "
        "same. The gap is ours under the protocol `paper` against the paper."
    )
    columns = ["method", "d", "ours, honest", "ours, `paper`", "the paper", "gap"]
    notes = [measured([result for _, results in parts for result in results])]
    return Table("Beside the paper's table", columns, rows, notes, caption)


def spurious_panel(parts: Parts) -> Panel:
    """The panel ``published`` for claims: JADE_20 of our rows by alpha, and the paper's as ``the paper: ROW``."""
    errors = over_seeds(*parts[0], "JADE_20")
    for row, cells in published.PAPER.items():
        errors |= {(f"the paper: {row}", str(alpha)): np.array([ade]) for alpha, (ade, _) in cells.items()}
    return Panel("published", errors, tuple(parts[0][0].domains), "JADE_20 beside the paper", "published")


def original_panel(parts: Parts) -> Panel:
    """The panel ``published`` for claims: ADE of our rows at ``hotel``, and the paper's as ``the paper: ROW``."""
    errors = {key: values for part, results in parts for key, values in over_seeds(part, results).items()}
    errors |= {(f"the paper: {row}", "hotel"): np.array([ade]) for row, (ade, _) in published.ORIGINAL.items()}
    return Panel("published", errors, ("hotel",), "ADE beside the paper", "published")
