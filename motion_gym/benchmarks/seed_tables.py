"""Tables of a benchmark over several seeds, as Markdown, from the results of its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks import published
from motion_gym.benchmarks.report import number
from motion_gym.benchmarks.shipped import SAMPLES, Part

Result = Mapping[str, Any]

SCORES = {
    "k = 1": ("ADE", "FDE"),
    f"k = {SAMPLES}, best sample of each agent": (f"minADE_{SAMPLES}", f"minFDE_{SAMPLES}"),
    f"k = {SAMPLES}, best sample of each scene": (f"JADE_{SAMPLES}", f"JFDE_{SAMPLES}"),
}
"""Names of the metrics by what they are."""
INTERVALS = "intervals of every run are in its file"


def row_of(result: Result) -> str:
    """Predictor without its weights and seed."""
    name, parameters = catalog.parse_spec(result["predictor"])
    return catalog.format_spec(name, {k: v for k, v in parameters.items() if k not in ("weights", "seed")})


def over_seeds(part: Part, results: Sequence[Result], metric: str) -> dict[tuple[str, str], np.ndarray]:
    """Values of the seeds by row and column, the pooled columns included."""
    found: dict[tuple[str, str], list[float]] = {}
    for result in results:
        found.setdefault((row_of(result), part.column_of(result)), []).append(result["metrics"][metric]["mean"])
    for row in dict.fromkeys(row for row, _ in found):
        for name, columns in part.pooled.items():
            found[row, name] = np.mean([found[row, column] for column in columns], axis=0).tolist()
    return {key: np.array(values) for key, values in found.items()}


def markdown(part: Part, results: Sequence[Result]) -> str:
    """Tables of one part: for each way to score, a row for each method and a column for each domain."""
    lines = [f"### {part.title}", ""]
    several = any(result["samples"] > 1 for result in results)
    for title, (ade, fde) in list(SCORES.items())[: None if several else 1]:
        lines += [f"**{ade} / {fde}** ({title}), metres, mean ± standard error over seeds", ""]
        lines += _table(part, results, ade, fde)
        lines.append("")
    return "\n".join(lines + [f"- {line}." for line in notes(part, results)])


def short(part: Part, results: Sequence[Result]) -> str:
    """The ADE at k = 1 alone."""
    lines = [f"**{part.title}.** ADE in metres, k = 1, mean ± standard error over seeds", ""]
    return "\n".join([*lines, *_table(part, results, "ADE"), "", *(f"- {line}." for line in notes(part, results))])


def _table(part: Part, results: Sequence[Result], ade: str, fde: str | None = None) -> list[str]:
    columns = [*part.pooled, *part.domains]
    lines = [f"| method | {' | '.join(columns)} | seeds |", f"|---|{'---|' * len(columns)}---|"]
    ades, fdes = over_seeds(part, results, ade), over_seeds(part, results, fde or ade)
    for row in dict.fromkeys(row for row, _ in ades):
        cells = []
        for column in columns:
            cell = spread(ades[row, column])
            cells.append(cell if fde is None else f"{cell} / {spread(fdes[row, column])}")
        seeds = len(ades[row, columns[0]])
        lines.append(f"| `{row}` | {' | '.join(cells)} | {seeds if seeds > 1 else '-'} |")
    return lines


def notes(part: Part, results: Sequence[Result]) -> list[str]:
    """What must be said of all cells."""
    return [f"protocol {part.protocol}; {scored(results)}; {INTERVALS}", *further_notes(part, results)]


def scored(results: Sequence[Result]) -> str:
    """What stands behind the cells, and which agents these are."""
    counted = {
        name: sorted({result["metrics"]["ADE"][name] for result in results})
        for name in ("agent_windows", "agents", "scenes")
    }
    windows, agents, scenes = (f"{c[0]} to {c[-1]}" if len(c) > 1 else str(c[0]) for c in counted.values())
    return f"means over {windows} agent-windows of {agents} agents in {scenes} scenes; {results[0]['scored']}"


def further_notes(part: Part, results: Sequence[Result]) -> list[str]:
    """What is behind the columns, what leaks, and how weights were selected."""
    given = {name: max([r["shots"] for r in results if part.column_of(r) == name], default=0) for name in part.domains}
    shown = max(result["reference_scenes"] for result in results)
    leaks = dict.fromkeys(leak for result in results for leak in result["leaks"])
    selections: dict[str, list[str]] = {}
    for result in results:
        rows = selections.setdefault(result["selection"], [])
        if row_of(result) not in rows:
            rows.append(row_of(result))
    return [
        *(f"{name}: mean of {', '.join(columns)}, each counting the same" for name, columns in part.pooled.items()),
        *([f"those with a style read it from {shown} reference scenes"] if shown else []),
        *(
            [f"scenes of the domain's training split that rows learn from: {', '.join(map(str, given.values()))}"]
            if any(given.values())
            else []
        ),
        *leaks,
        *(f"selection, {', '.join(rows)}: {text}" for text, rows in selections.items()),
    ]


def against_published(part: Part, results: Sequence[Result]) -> str:
    """Ours, the paper's and the published weights' numbers, each in its own column."""
    lines = [
        "### Beside the published numbers",
        "",
        "The paper gives the best of 20 in its figure (no FDE). The published weights are of one seed. Ours are means "
        "over seeds; the gap is ours against the paper where it has a number, else against the published weights.",
        "",
        "| method | alpha | k | ours, ADE / FDE | the paper, ADE | published weights, ADE / FDE | gap |",
        "|---|---|---|---|---|---|---|",
    ]
    for k, (ade, fde) in ((1, SCORES["k = 1"]), (SAMPLES, (f"JADE_{SAMPLES}", f"JFDE_{SAMPLES}"))):
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
                    reference = (theirs or weights or (np.nan,))[0]
                    gap = f"{100 * (ours.mean() / reference - 1):+.0f} %"
                there = "-" if weights is None else f"{number(weights[0])} / {number(weights[1])}"
                figure = "-" if theirs is None else number(theirs[0])
                lines.append(f"| `{row}` | {alpha} | {k} | {cell} | {figure} | {there} | {gap} |")
    return "\n".join(lines)


def original_beside_published(found: Sequence[tuple[Part, Sequence[Result]]]) -> str:
    """Original data: a row for each method, a column for each place, and the paper's numbers for ``hotel``."""
    places = [next(iter(part.domains)) for part, _ in found]
    lines = [
        "**Original ETH-UCY, no noise feature, trained on the other four places.** ADE / FDE in metres, k = 1, mean ± "
        "standard error over seeds",
        "",
        f"| method | {' | '.join(places)} | the paper, hotel |",
        f"|---|{'---|' * len(places)}---|",
    ]
    tables = [(over_seeds(part, results, "ADE"), over_seeds(part, results, "FDE")) for part, results in found]
    for row in dict.fromkeys(row for ades, _ in tables for row, _ in ades):
        cells = []
        for place, (ades, fdes) in zip(places, tables, strict=True):
            key = (row, place)
            cells.append(f"{spread(ades[key])} / {spread(fdes[key])}" if key in ades else "-")
        theirs = published.ORIGINAL.get(row)
        paper = "-" if theirs is None else f"{number(theirs[0])} / {number(theirs[1])}"
        lines.append(f"| `{row}` | {' | '.join(cells)} | {paper} |")
    notes = [f"protocol {found[0][0].protocol}; {INTERVALS}"]
    notes += [f"{place}: {scored(results)}" for place, (_, results) in zip(places, found, strict=True)]
    notes += dict.fromkeys(note for part, results in found for note in further_notes(part, results))
    return "\n".join([*lines, "", *(f"- {note}." for note in notes)])


def spread(values: np.ndarray) -> str:
    """Mean ± standard error, or the one value."""
    if len(values) == 1:
        return number(float(values[0]))
    return f"{number(float(values.mean()))} ± {number(float(values.std(ddof=1) / np.sqrt(len(values))))}"
