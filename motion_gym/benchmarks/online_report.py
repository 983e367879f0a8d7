"""Tables and figures of online adaptation, from the results of its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.benchmarks import online_benchmark
from motion_gym.benchmarks.online_benchmark import BASELINE, NONE, ORACLE, SHIFTS, Found
from motion_gym.benchmarks.report import number
from motion_gym.benchmarks.seed_tables import spread
from motion_gym.online.evaluation import LABELS, Report
from motion_gym.online.scores import EVERY, TRAIL, after_first, gain, recovery, returns_of

Result = Mapping[str, Any]
COLUMNS = (
    "method",
    "ADE",
    "ADE after the first shift",
    "gain",
    "recovered after",
    "on return",
    "updates",
    "ms per observe",
    "ms per step",
)
MILESTONES = (50, 100, 150, 200, 250, 300)
"""Matured forecasts after a shift."""
FEW, MANY = "finetune:parts=modulator", "finetune:parts=all"
"""Rows of which the first one is claimed to need fewer labels."""


def table(rows: Mapping[str, Sequence[Result]], settings: Mapping[str, str]) -> list[str]:
    """A table of one kind of stream.

    Args:
        rows: Results of the seeds by row; constant velocity, none and oracle are among them, the last one if there is
            one.
        settings: Spec of each row, where it is not its name.
    """
    lines = [f"| {' | '.join(COLUMNS)} |", f"|{'---|' * len(COLUMNS)}"]
    for row, results in rows.items():
        cells = cells_of(results, rows[NONE], rows.get(ORACLE))
        lines.append(f"| `{settings.get(row, row)}` | {' | '.join(cells)} |")
    return lines


def cells_of(results: Sequence[Result], none: Sequence[Result], oracle: Sequence[Result] | None) -> list[str]:
    """Cells of a row, behind its name."""
    ade = np.array([r["ade"]["mean"] for r in results])
    after = np.array([after_first(r) for r in results])
    share = gain_of(results, none, oracle)
    update = np.median([r["update_seconds"] for r in results], axis=0) * 1000
    tick = np.median([r["tick_seconds"][1] for r in results]) * 1000
    rolled = sum(r["rolled_back"] for r in results)
    updates = f"{np.mean([r['updates'] for r in results]):.0f}" + (f" ({rolled} taken back)" if rolled else "")
    updates += f" ({sum(r['skipped'] for r in results)} skipped)" if any(r["realtime"] for r in results) else ""
    return [
        spread(ade),
        spread(after) if len(results[0]["segments"]) > 1 else "-",
        "-" if share is None else f"{share:.2f}",
        recovered(results, oracle),
        returned(results, none),
        updates,
        f"{update[0]:.1f} / {update[1]:.1f}" if results[0]["updates"] else "-",
        f"{tick:.1f}",
    ]


def on_domain(result: Result, domain: str) -> str:
    """ADE over all segments of a domain."""
    own = [s["ade"] for s in result["segments"] if s["domain"] == domain and s["ade"]["agent_windows"]]
    total = sum(ade["agent_windows"] for ade in own)
    return number(sum(ade["mean"] * ade["agent_windows"] for ade in own) / total if total else None)


def gain_of(results: Sequence[Result], none: Sequence[Result], oracle: Sequence[Result] | None) -> float | None:
    """Adaptation gain over the segments after the first one, of means over seeds; None without a better oracle."""
    if oracle is None:
        return None
    found = gain(*(float(np.mean([after_first(r) for r in rows])) for rows in (none, results, oracle)))
    return None if np.isnan(found) else found


def recovered(results: Sequence[Result], oracle: Sequence[Result] | None) -> str:
    """Median matured forecasts and seconds until the first change of domain is recovered from, and in how many runs."""
    found = []
    for index, result in enumerate(results):
        shift = first_shift(result)
        if shift is None:
            return "-"
        if oracle is None:
            levels = [shift["before"]] * len(shift["after"])
        else:
            theirs = first_shift(oracle[index])
            levels = [] if theirs is None else [ade for _, _, ade in theirs["after"]]
        found.append(recovery(shift, levels))
    there = [f for f in found if f is not None]
    if not there:
        return "never" + (f" (0 of {len(found)})" if len(found) > 1 else "")
    forecasts, seconds = np.median(there, axis=0)
    return f"{forecasts:.0f} ({seconds:.0f} s" + (f"; {len(there)} of {len(found)})" if len(found) > 1 else ")")


def first_shift(result: Result) -> dict[str, Any] | None:
    """The first change of domain, if at least 50 forecasts matured right before it and right after it."""
    segments = result["segments"]
    number = next((n for n, s in enumerate(segments) if s["domain"] != segments[0]["domain"]), None)
    shift = next((s for s in result["shifts"] if s["segment"] == number), None)
    return None if shift is None or segments[shift["segment"] - 1]["ade"]["agent_windows"] < TRAIL else shift


def returned(results: Sequence[Result], none: Sequence[Result]) -> str:
    """By how much the error of the first domain has grown when it comes back, more than that of ``none``."""

    def growth(result: Result) -> list[float]:
        visits = [(s["domain"], s["ade"]["mean"], s["ade"]["agent_windows"]) for s in result["segments"]]
        own = result["segments"][0]["domain"]
        return [later / first for domain, first, later in returns_of(visits) if domain == own and first]

    pairs = zip(results, none, strict=True)
    found = [mine / theirs - 1 for r, n in pairs for mine, theirs in zip(growth(r), growth(n), strict=False) if theirs]
    return f"{100 * np.mean(found):+.1f} %" if found else "-"


def notes(results: Sequence[Result]) -> list[str]:
    """What is true of a table."""
    first = results[0]
    matured = sorted({r["ade"]["agent_windows"] for r in results})
    censored = sorted({r["censored"] for r in results})
    agents = sorted({r["ade"]["agents"] for r in results})
    single = len({r["row"] for r in results}) == len(results)
    spread_is = "mean ± standard error over seeds, the interval of every run is in its file"
    lines = [
        f"protocol honest, k = 1; {_span(matured)} matured forecasts of {_span(agents)} agents, {_span(censored)} "
        "censored (whose people left before 4.8 s were over); "
        + ("[95 %]: bootstrap of whole agents" if single else spread_is),
        f"labels {first['labels']}: {LABELS[first['labels']]}; reset for each {first['scope']}",
    ]
    return lines + [leak for leak in dict.fromkeys(leak for r in results for leak in r["leaks"])]


LEGEND = (
    "gain: (none - adapted) / (none - oracle), of the mean ADE after the first shift",
    f"recovered after: matured forecasts (and seconds) from the first change of domain until the mean over the last "
    f"{TRAIL} is at most 10 % above the oracle's of the same time (without an oracle: above the ADE before); looked at "
    f"every {EVERY} forecasts, so at least {TRAIL}; median of the runs that did; - where fewer matured in a visit",
    "on return: by how much more than that of `none` the ADE of the first domain has grown when it comes back, where "
    f"at least {TRAIL} forecasts matured in each visit",
    "ms per observe: median / 95th percentile of all calls, also those that only remember; ms per step: 95th "
    "percentile of that and the forecasts together; of a machine that did other things as well",
)


def choice(name: str, tried: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Which settings were tried on the shift among sources, and which are best."""
    shifts = SHIFTS[name]
    where = " then ".join(shifts.chosen_on["domains"])
    lines = [
        f"Settings, chosen by the mean ADE of both segments of {where} (weights `{shifts.chosen_with}`, seed 0), where "
        f"`none` has {number(tried[NONE][NONE])}:",
        "",
        "| row | settings: ADE, metres |",
        "|---|---|",
    ]
    best = online_benchmark.chosen(tried)
    for row, values in tried.items():
        if row != NONE:
            cells = [
                f"{'**' if spec == best[row] else ''}{_more(row, spec)}: {number(v)}{'**' if spec == best[row] else ''}"
                for spec, v in values.items()
            ]
            lines.append(f"| `{row}` | {'; '.join(cells)} |")
    return lines


def milestones(rows: Mapping[str, Sequence[Result]]) -> list[str]:
    """ADE over the last forecasts after so many labels from the first shift."""
    lines = [
        f"ADE over the last {TRAIL} forecasts after so many have matured since the shift:",
        "",
        f"| method | {' | '.join(map(str, MILESTONES))} |",
        f"|---|{'---|' * len(MILESTONES)}",
    ]
    for row, results in rows.items():
        after = [{int(n): ade for n, _, ade in (first_shift(r) or {"after": []})["after"]} for r in results]
        cells = [spread(np.array([a[n] for a in after])) if all(n in a for a in after) else "-" for n in MILESTONES]
        lines.append(f"| `{row}` | {' | '.join(cells)} |")
    return lines


def fewer_labels(rows: Mapping[str, Sequence[Result]], one: str, other: str) -> str:
    """At how many numbers of labels after the shift one row has the lower trailing mean than another, over seeds."""
    rows = {row: rows[row] for row in (one, other)}
    means = {row: np.mean([[e for _, _, e in r["shifts"][0]["after"]] for r in of], axis=0) for row, of in rows.items()}
    below = int((means[one] < means[other]).sum())
    return (
        f"The error of `{one}` is below that of `{other}` at {below} of {len(means[one])} numbers of labels after the "
        f"shift (every {EVERY} from {TRAIL} on)."
    )


def write(folder: Path, report: Report) -> tuple[str, list[Path]]:
    """Run what is missing; all tables, and a figure for each sort of shift in ``folder``."""
    from motion_gym.benchmarks import figures  # matplotlib takes a second

    tried, found = online_benchmark.run(folder, report)
    texts, paths = [], []
    for name, shifts in SHIFTS.items():
        settings = {row: spec for row, spec in online_benchmark.chosen(tried[name]).items() if row != NONE}
        texts += [f"## {shifts.title}", "", f"Adapted: `{shifts.source}`, weights `{shifts.weights}`.", ""]
        texts += [*choice(name, tried[name]), ""]
        for kind in shifts.streams:
            rows = rows_of(found, name, kind)
            everything = [r for results in rows.values() for r in results]
            texts += [f"### {shifts.title}: {kind}", "", *table(rows, settings), ""]
            texts += [*(f"- {note}." for note in (*notes(everything), *LEGEND)), ""]
            if kind == "sudden":
                texts += [*milestones(rows), ""]
            if kind == "sudden" and {FEW, MANY} <= rows.keys():
                texts += [fewer_labels(rows, FEW, MANY), ""]
        paths.append(folder / f"{name}.svg")
        figures.over_time({k: rows_of(found, name, k) for k in shifts.streams}, paths[-1], shifts.title)
    return "\n".join(texts).strip(), paths


def rows_of(found: Found, name: str, kind: str) -> dict[str, list[dict[str, Any]]]:
    """Results by row."""
    return {row: found[name, kind, row] for row in (BASELINE, NONE, ORACLE, *SHIFTS[name].rows)}


def short(folder: Path) -> str:
    """One table for a README: errors after a sudden shift, and the gain."""
    _, found = online_benchmark.read(folder)
    cells: dict[str, dict[str, str]] = {}
    for name in SHIFTS:
        there = rows_of(found, name, "sudden")
        for row, results in there.items():
            share = gain_of(results, there[NONE], there[ORACLE])
            after = spread(np.array([after_first(r) for r in results]))
            told = after if share is None or row in (NONE, ORACLE) else f"{after} ({share:.2f})"
            cells.setdefault(row.replace(",every=4", ""), {})[name] = told
    lines = [
        "**After a sudden shift.** ADE in metres, k = 1, mean ± standard error over seeds (adaptation gain)",
        "",
        f"| method | {' | '.join(shifts.title for shifts in SHIFTS.values())} |",
        f"|---|{'---|' * len(SHIFTS)}",
    ]
    lines += [f"| `{row}` | {' | '.join(by.get(name, '-') for name in SHIFTS)} |" for row, by in cells.items()]
    lines.append("")
    for name, shifts in SHIFTS.items():
        everything = [r for results in rows_of(found, name, "sudden").values() for r in results]
        lines += [f"- {shifts.title} (`{shifts.source}`): {note}." for note in notes(everything)[:1]]
    chosen_on = "settings were chosen on another shift, on frames that are not scored"
    lines += [f"- {LEGEND[0]}.", f"- {chosen_on}."]
    return "\n".join(lines)


def _span(values: Sequence[int]) -> str:
    return str(values[0]) if len(values) == 1 else f"{values[0]} to {values[-1]}"


def _more(row: str, spec: str) -> str:
    """What a spec has beyond that of its row."""
    return spec[len(row) :].lstrip(":,") or "defaults"
