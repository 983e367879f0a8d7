"""Our numbers beside the numbers of the paper and of its published weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from motion_gym.benchmarks import published
from motion_gym.benchmarks.claims.panels import Panel
from motion_gym.benchmarks.objects import Part
from motion_gym.benchmarks.reports.conditions import Result, measured, unit_of
from motion_gym.benchmarks.reports.seed_tables import SEEDS, Parts, further_notes, over_seeds
from motion_gym.benchmarks.reports.table import Code, Table, number, percent, spread

COUNTED = ("agent_windows", "agents", "scenes")


def spurious(parts: Parts) -> Table:
    """Errors on ``eth`` by alpha: of both trainings here, the paper's, and those of the published weights."""
    trained = _by_weights(parts)
    columns = ["method", "alpha", "k", "trained here", "trained as in the paper", "the paper, ADE", "published weights"]
    rows = []
    for k, metrics in ((1, ("ADE", "FDE")), (20, ("JADE_20", "JFDE_20"))):
        ours, as_paper = (_errors(trained, weights, metrics) for weights in ("spurious", "paper/eth"))
        paper = published.PAPER if k > 1 else {}
        for row in dict.fromkeys([*published.PAPER, *published.WEIGHTS[k]]):
            for alpha in published.ALPHAS:
                theirs, weights = paper.get(row, {}).get(alpha), published.WEIGHTS[k].get(row, {}).get(alpha)
                if theirs is None and weights is None:
                    continue
                again = _pair(as_paper, published.as_released(row), str(alpha))
                if again != "-":
                    mean = as_paper[0][published.as_released(row), str(alpha)].mean()
                    again += f" ({percent(mean / (theirs or weights or (1.0,))[0] - 1)})"
                first = "-" if theirs is None else number(theirs[0])
                second = "-" if weights is None else f"{number(weights[0])} / {number(weights[1])}"
                rows.append([Code(row), str(alpha), str(k), _pair(ours, row, str(alpha)), again, first, second])
    caption = (
        "ADE / FDE. The paper gives the best of 20 in its figure (no FDE). The published weights are of one seed. Ours "
        "are means over seeds. In brackets: the ADE against the paper's where it gives one, else against that of the "
        "published weights."
    )
    results = [result for _, part in trained.values() for result in part]
    return Table("Beside the published numbers", columns, rows, [measured(results)], caption)


def original(parts: Parts) -> Table:
    """Errors without the noise feature: a column for each test place."""
    return by_place([(part, results) for part, results in parts if part.weights.startswith("original/")])


def by_place(parts: Parts) -> Table:
    """Errors with a column for the place of each part, whose weights were trained on the other places."""
    places = [next(iter(part.domains)) for part, _ in parts]
    tables = [[over_seeds(part, results, metric) for metric in ("ADE", "FDE")] for part, results in parts]
    rows = [
        [Code(row), *(_pair(errors, row, place) for place, errors in zip(places, tables, strict=True))]
        for row in dict.fromkeys(row for ades, _ in tables for row, _ in ades)
    ]
    everything = [result for _, results in parts for result in results]
    notes = [f"protocol {parts[0][0].protocol}; {measured(everything)}; {SEEDS}"]
    who = dict.fromkeys(results[0]["scored"].split(":")[0] for _, results in parts)
    counts = [
        f"{place} {' / '.join(str(results[0]['metrics']['ADE'][name]) for name in COUNTED)}"
        for place, (_, results) in zip(places, parts, strict=True)
    ]
    notes += [f"means over {'; or '.join(who)}; agent-windows / agents / scenes: {', '.join(counts)}"]
    notes += dict.fromkeys(note for part, results in parts for note in further_notes(part, results))
    title = "Original ETH-UCY, no noise feature, trained on the other places"
    return Table(title, ["method", *places], rows, notes, f"ADE / FDE, {unit_of(everything)}, k = 1; lower is better")


def original_hotel(parts: Parts) -> Table:
    """Errors at ``hotel`` without the noise feature: of both trainings, the paper's, and of the published weights."""
    trained = _by_weights(parts)
    rows = []
    plans = ("original/hotel", "paper/hotel")
    for k, metrics in enumerate((("ADE", "FDE"), ("JADE_20", "JFDE_20"))):
        ours, as_paper = (_errors(trained, weights, metrics) for weights in plans)
        for row, weights in published.ORIGINAL_WEIGHTS.items():
            paper = published.ORIGINAL.get(row) if not k else None
            again = _pair(as_paper, published.as_released(row), "hotel")
            theirs = "-" if paper is None else " / ".join(map(number, paper))
            scored_here = " / ".join(map(number, weights[k]))
            rows.append([Code(row), ("1", "20")[k], _pair(ours, row, "hotel"), again, theirs, scored_here])
    columns = ["method", "k", "trained here", "trained as in the paper", "the paper", "published weights"]
    results = [result for weights in plans for result in trained[weights][1]]
    caption = (
        "ADE / FDE; at k = 20 the best sample of each scene. The paper does not say which of its three penalties its "
        "row has: it stands at the middle one. The published weights are of one seed, scored by this library."
    )
    return Table("Beside the published numbers at hotel", columns, rows, [measured(results)], caption)


def _by_weights(parts: Parts) -> dict[str, tuple[Part, Sequence[Result]]]:
    """The parts, with their results, by the name of their weights."""
    return {part.weights: (part, results) for part, results in parts}


def _errors(
    trained: Mapping[str, tuple[Part, Sequence[Result]]], weights: str, metrics: Sequence[str]
) -> list[dict[tuple[str, str], np.ndarray]]:
    """Values of all seeds by row and column, of each metric; empty without a part with these weights."""
    return [over_seeds(*trained[weights], metric) if weights in trained else {} for metric in metrics]


def _pair(errors: Sequence[Mapping[tuple[str, str], np.ndarray]], row: str, column: str) -> str:
    """Two errors of a cell, as ADE and FDE, or a dash."""
    return " / ".join(spread(error[row, column]) for error in errors) if (row, column) in errors[0] else "-"


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
    """The panel ``published`` for claims: JADE_20 by alpha.

    Its rows are ours, ``as in the paper: ROW``, ``the paper: ROW`` and ``published weights: ROW``.
    """
    trained = _by_weights(parts)
    errors = over_seeds(*trained["spurious"], "JADE_20")
    (again,) = _errors(trained, "paper/eth", ["JADE_20"])
    for row, cells in published.PAPER.items():
        released = published.as_released(row)
        errors |= {(f"as in the paper: {row}", c): values for (r, c), values in again.items() if r == released}
        errors |= {(f"the paper: {row}", str(alpha)): np.array([ade]) for alpha, (ade, _) in cells.items()}
    for row, cells in published.WEIGHTS[20].items():
        errors |= {(f"published weights: {row}", str(alpha)): np.array([ade]) for alpha, (ade, _) in cells.items()}
    return Panel("published", errors, tuple(map(str, published.ALPHAS)), "JADE_20 beside the paper", "published")


def original_panel(parts: Parts) -> Panel:
    """The panel ``published`` for claims: ADE at ``hotel``.

    Its rows are ours, ``as in the paper: ROW``, ``the paper: ROW`` and ``published weights: ROW``.
    """
    trained = _by_weights(parts)
    errors = {key: values for part, results in parts[:-1] for key, values in over_seeds(part, results).items()}
    (again,) = _errors(trained, "paper/hotel", ["ADE"])
    errors |= {(f"as in the paper: {row}", column): values for (row, column), values in again.items()}
    errors |= {(f"the paper: {row}", "hotel"): np.array([ade]) for row, (ade, _) in published.ORIGINAL.items()}
    weights = published.ORIGINAL_WEIGHTS
    errors |= {(f"published weights: {row}", "hotel"): np.array([ade[0][0]]) for row, ade in weights.items()}
    return Panel("published", errors, ("hotel",), "ADE beside the paper", "published")
