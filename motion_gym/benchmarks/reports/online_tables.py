"""Tables of online adaptation, from the results of runs on streams.

``Rows`` are the results of all seeds by row. Row ``none`` is the predictor that never learns; row ``oracle`` may be
missing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from motion_gym.benchmarks.claims.panels import Panel
from motion_gym.benchmarks.objects import FILTERS, NONE, ORACLE
from motion_gym.benchmarks.reports.conditions import Result, intervals, leaks, measured, unit_of
from motion_gym.benchmarks.reports.online_scores import (
    first_shift,
    gain_of,
    growth_on_return,
    on_domain,
    on_the_same_stream,
    recovered,
)
from motion_gym.benchmarks.reports.seed_tables import SEEDS, Errors
from motion_gym.benchmarks.reports.table import Code, Strong, Table, interval, number, span, spread
from motion_gym.online.continual import backward_transfer, forward_transfer, regret
from motion_gym.online.evaluation import LABELS
from motion_gym.online.scores import BLOCK, PHASE, TRAIL, after_first

Rows = Mapping[str, Sequence[Result]]
MILESTONES = (50, 100, 150, 200, 250, 300)
"""Matured forecasts after a shift."""
REGRET = 0.02
"""Regret against the best expert that counts as none."""
LEGEND = {
    "gain": "(none - adapted) / (none - oracle), of the mean ADE after the first shift",
    "recovered after": f"matured forecasts (and seconds) after the first change of domain, from which on every later "
    f"block of {BLOCK} forecasts is within 10 % of the oracle's block of the same time; median over runs, with the "
    f"number of runs that recovered; censored where most runs did not recover before the phase ended, or where the "
    f"phase has fewer than {PHASE} forecasts",
    "on return": "by how much more than that of `none` the ADE of the first domain has grown when this domain comes "
    f"back, where at least {TRAIL} forecasts matured in each visit",
    "BWT": f"backward transfer: ADE / ADE of `none` over the last {TRAIL} forecasts of a visit, minus the same over "
    f"the first {TRAIL} forecasts when the domain comes back; negative if the domain was forgotten",
    "FWT": f"forward transfer: 1 - ADE / ADE of `none` over the first {TRAIL} forecasts in each new domain; positive "
    "if what was learned before helps",
    "ms per observe": "median / 95th percentile of all calls, including those that only remember",
    "ms per step": "95th percentile of the update and the forecasts together, on a machine that did other work too",
}


def stream_table(title: str, rows: Rows, settings: Mapping[str, str] | None = None) -> Table:
    """The table of one kind of stream.

    Args:
        title: Heading.
        rows: Results of all seeds by row.
        settings: Spec of each row, where the spec is not the name.
    """
    everything = [result for results in rows.values() for result in results]
    ordered = {row: rows[row] for row in sorted(rows, key=lambda row: (row == ORACLE, row not in (*FILTERS, NONE)))}
    names = list(dict.fromkeys(segment["domain"] for segment in everything[0]["segments"]))
    single = all(len(results) == 1 for results in rows.values())
    cells = {
        row: {
            **(
                {"ADE [95 %]": interval(results[0]["ade"])}
                if single
                else {"ADE": spread(result["ade"]["mean"] for result in results)}
            ),
            **({f"ADE on {name}": on_domain(results[0], name) for name in names} if single and len(names) > 1 else {}),
            **_adaptation(results, rows),
        }
        for row, results in ordered.items()
    }
    columns = list(next(iter(cells.values())))
    # The table of single runs has no empty columns.
    shown = [name for name in columns if not single or any(cell[name] != "-" for cell in cells.values())]
    table = [
        [Code((settings or {}).get(row, row)), *(by_column[name] for name in shown)] for row, by_column in cells.items()
    ]
    notes = [*stream_notes(everything), *(f"{name}: {text}" for name, text in LEGEND.items() if name in shown)]
    if len(everything[0]["segments"]) > 1 and ORACLE not in rows:
        notes.append("no oracle was named, so that there is no gain")
    return Table(title, ["method", *shown], table, notes, f"ADE, {unit_of(everything)}, k = 1; lower is better")


def _adaptation(results: Sequence[Result], rows: Rows) -> dict[str, str]:
    """Cells about adaptation by the names of their columns."""
    share = gain_of(results, rows[NONE], rows.get(ORACLE))
    pairs = on_the_same_stream(results, rows[NONE])
    growth = growth_on_return(results, rows[NONE])
    update = np.median([r["update_seconds"] for r in results], axis=0) * 1000
    tick = np.median([r["tick_seconds"][1] for r in results]) * 1000
    rolled, skipped = (sum(r[name] for r in results) for name in ("rolled_back", "skipped"))
    updates = f"{np.mean([r['updates'] for r in results]):.0f}" + (f" ({rolled} taken back)" if rolled else "")
    updates += f" ({skipped} skipped)" if any(r["realtime"] for r in results) else ""
    several = len(results[0]["segments"]) > 1
    return {
        "ADE after the first shift": spread(after_first(r) for r in results) if several else "-",
        "gain": "-" if share is None else f"{share:.2f}",
        "recovered after": recovered(results, rows.get(ORACLE)),
        "on return": f"{100 * np.mean(growth):+.1f} %" if growth else "-",
        "BWT": _percent([backward_transfer(*pair) for pair in pairs]),
        "FWT": _percent([forward_transfer(*pair) for pair in pairs]),
        "updates": updates,
        "ms per observe": f"{update[0]:.1f} / {update[1]:.1f}" if results[0]["updates"] else "-",
        "ms per step": f"{tick:.1f}",
    }


def _percent(values: Sequence[float | None]) -> str:
    """Mean of the values that are known, in percent."""
    known = [value for value in values if value is not None]
    return f"{100 * np.mean(known):+.1f} %" if known else "-"


def stream_notes(results: Sequence[Result]) -> list[str]:
    """Notes on all rows of a stream."""
    first = results[0]
    matured, agents = (span(r["ade"][name] for r in results) for name in ("agent_windows", "agents"))
    single = len({r["row"] for r in results}) == len(results)
    return [
        f"protocol honest, k = 1; {measured(results)}; {matured} matured forecasts of {agents} agents, "
        f"{span(r['censored'] for r in results)} censored (their agents left before the horizon)",
        intervals(results) if single else SEEDS,
        f"labels {first['labels']}: {LABELS[first['labels']]}; reset for each {first['scope']}",
        *leaks(results),
    ]


def choice_table(where: str, weights: str, tried: Mapping[str, Mapping[str, float]]) -> Table:
    """The settings that were compared on another shift, with the best ones first.

    Args:
        where: The domains of that shift.
        weights: Weights of the predictor on that shift.
        tried: ADE by row and spec; the row ``none`` has one value.
    """
    rows = []
    for row, values in tried.items():
        if row != NONE:
            best = min(values, key=lambda spec: values[spec])
            others = "; ".join(f"{_further(row, spec)}: {number(values[spec])}" for spec in values if spec != best)
            rows.append([Code(row), _further(row, best), Strong(number(values[best])), others or "-"])
    caption = (
        f"ADE, mean of both segments of {where} (weights {weights}, seed 0), where the row `none` has "
        f"{number(tried[NONE][NONE])}. The settings with the lowest ADE are taken."
    )
    return Table("Choice of settings", ["row", "chosen", "ADE", "other settings: ADE"], rows, (), caption)


def regret_table(titles: Mapping[str, str], runs: Mapping[tuple[str, str, str], Sequence[Result]]) -> Table:
    """Regret of rows that combine experts, a table row for each stream.

    Args:
        titles: Heading of each sort of shift.
        runs: Results of all seeds by sort of shift, kind of stream and row.
    """
    rows = []
    for (name, kind, row), results in runs.items():
        values = [value for value in map(regret, results) if value is not None]
        experts = [result["experts"] for result in results]
        if values:
            best = [min(errors, key=lambda expert: errors[expert]) for errors in experts]
            within = sum(value <= REGRET for value in values)
            often = Counter(best).most_common()
            rows.append(
                [
                    f"{titles[name]}: {kind}",
                    Code(row),
                    spread(result["ade"]["mean"] for result in results),
                    spread(min(errors.values()) for errors in experts),
                    f"{100 * np.mean(values):+.1f} %",
                    f"{100 * max(values):+.1f} %",
                    f"{within} of {len(values)}",
                    ", ".join(f"{expert} ({count})" for expert, count in often),
                ]
            )
    notes = [
        "best expert: the lowest ADE of a single expert on the same stream, known in hindsight; each seed has its own",
        "regret: ADE / ADE of the best expert - 1, for each seed; negative if the mean of experts is better than each",
        "seeds 0 to 9 of the stream, with the weights of seeds 0 to 4",
    ]
    head = ["stream", "method", "ADE", "best expert", "regret", "worst seed", f"within {100 * REGRET:.0f} %"]
    caption = "ADE and regret against the best fixed expert in hindsight, k = 1; lower is better"
    return Table("Regret", [*head, "which expert (seeds)"], rows, notes, caption)


def regret_panel(runs: Mapping[tuple[str, str, str], Sequence[Result]]) -> Panel:
    """Errors of rows that combine experts, and of row ``best expert``, for claims; a column such as ``style: sudden``.

    Args:
        runs: Results of all seeds by sort of shift, kind of stream and row.
    """
    errors: Errors = {}
    for (name, kind, row), results in runs.items():
        errors[row, f"{name}: {kind}"] = np.array([result["ade"]["mean"] for result in results])
        errors["best expert", f"{name}: {kind}"] = np.array([min(result["experts"].values()) for result in results])
    return Panel("regret", errors, tuple(dict.fromkeys(column for _, column in errors)), "Regret")


def milestones_table(title: str, rows: Rows) -> Table:
    """ADE over the last forecasts, at several numbers of matured forecasts after the first shift."""
    everything = [result for results in rows.values() for result in results]
    table = [
        [Code(row), *(spread(at) if at else "-" for at in _at_milestones(rs).values())] for row, rs in rows.items()
    ]
    caption = (
        f"ADE, {unit_of(everything)}, over the last {TRAIL} forecasts after so many have matured since the shift; "
        "lower is better"
    )
    return Table(title, ["method", *map(str, MILESTONES)], table, [measured(everything)], caption)


def summary_table(titles: Mapping[str, str], sudden: Mapping[str, Rows]) -> Table:
    """Errors after a sudden shift and the gain, a column for each sort of shift.

    Args:
        titles: Heading of each sort of shift.
        sudden: Rows of its sudden stream, by the same names.
    """
    cells: dict[str, dict[str, str]] = {}
    for name, rows in sudden.items():
        for row, results in rows.items():
            share = gain_of(results, rows[NONE], rows[ORACLE])
            after = spread(after_first(result) for result in results)
            text = after if share is None or row in (NONE, ORACLE) else f"{after} ({share:.2f})"
            cells.setdefault(row.replace(",every=4", ""), {})[name] = text
    order = sorted(cells, key=lambda row: (row == ORACLE, row not in (*FILTERS, NONE)))
    table = [[Code(row), *(cells[row].get(name, "-") for name in titles)] for row in order]
    everything = {name: [r for results in rows.values() for r in results] for name, rows in sudden.items()}
    together = [result for results in everything.values() for result in results]
    notes = [f"{title}: {stream_notes(everything[name])[0]}" for name, title in titles.items()]
    notes += [SEEDS, f"gain: {LEGEND['gain']}", "settings were chosen on another shift, on frames that are not scored"]
    caption = f"ADE, {unit_of(together)}, k = 1 (adaptation gain); lower is better"
    return Table("After a sudden shift", ["method", *titles.values()], table, notes, caption)


def shift_panel(name: str, title: str, kinds: Mapping[str, Rows]) -> Panel:
    """Errors of one sort of shift for claims.

    Columns are the kinds of stream (ADE after the first shift), ``on return`` (growth of the error of the first domain
    when it comes back, of the recurring stream), and for the sudden stream ``last 50 at N`` and ``from 90 on`` (mean
    of consecutive trailing means after the 90th matured forecast).
    """
    errors: Errors = {}
    for kind, rows in kinds.items():
        for row, results in rows.items():
            errors[row, kind] = np.array([after_first(result) for result in results])
            growth = growth_on_return(results, rows[NONE])
            if growth:
                errors[row, "on return"] = 1 + np.array(growth)
            if kind == "sudden":
                errors |= {(row, f"last {TRAIL} at {n}"): np.array(a) for n, a in _at_milestones(results).items() if a}
                errors[row, "from 90 on"] = np.array([_after(result, 90 + TRAIL) for result in results])
    return Panel(name, errors, tuple(kinds), title)


def _after(result: Result, start: int) -> float:
    """Mean of the trailing means at ``start`` and every 50 forecasts later, which do not overlap."""
    shift = first_shift(result) or {"after": []}
    after = [ade for n, _, ade in shift["after"] if (n - start) % TRAIL == 0 <= n - start]
    return float(np.mean(after)) if after else float("nan")


def _at_milestones(results: Sequence[Result]) -> dict[int, list[float]]:
    """Trailing means of all seeds at each milestone; empty if a seed does not reach the milestone."""
    after = [{int(n): ade for n, _, ade in (first_shift(r) or {"after": []})["after"]} for r in results]
    return {n: [by_count[n] for by_count in after] if all(n in a for a in after) else [] for n in MILESTONES}


def _further(row: str, spec: str) -> str:
    """The parameters that a spec adds to its row."""
    return spec[len(row) :].lstrip(":,") or "defaults"
