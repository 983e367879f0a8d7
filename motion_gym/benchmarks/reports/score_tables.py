"""Tables of single runs on windows: one table for each domain."""

from __future__ import annotations

from collections.abc import Sequence

from motion_gym.benchmarks.objects import BASELINE
from motion_gym.benchmarks.reports.conditions import (
    Result,
    in_order,
    intervals,
    leaks,
    measured,
    not_computed,
    scored,
    unit_of,
)
from motion_gym.benchmarks.reports.table import Table, interval, number
from motion_gym.scoring.scorecard import SHIPPED


def domain_table(results: Sequence[Result]) -> Table:
    """A row for each predictor, for results of one domain, split, protocol and k."""
    k, unit = results[0]["k"], unit_of(results)
    columns = ["predictor", f"ADE [95 %], {unit}", f"FDE [95 %], {unit}", f"ADE vs. const. velocity, {unit}"]
    columns += [f"minADE/FDE_{k}", f"JADE/JFDE_{k}"] if k > 1 else []
    densities = list(dict.fromkeys(name for r in results for name in r["metrics"] if name.startswith("KDE_NLL")))
    columns += [f"{name}, nat" if name != "KDE_NLL" else f"KDE_NLL_{k}, nat" for name in densities]
    rows = []
    for result in in_order(results):
        metrics = result["metrics"]
        baseline = result["predictor"] == BASELINE
        row = [label(result), interval(metrics["ADE"]), interval(metrics["FDE"])]
        row += ["-" if baseline else interval(result["versus_baseline"]["ADE"], sign=True)]
        for names in ((f"minADE_{k}", f"minFDE_{k}"), (f"JADE_{k}", f"JFDE_{k}")) if k > 1 else ():
            row.append(" / ".join(number(metrics[name]["mean"]) for name in names))
        rows.append(row + [number(metrics.get(name, {}).get("mean")) for name in densities])
    source = results[0]["domain"].get("source")
    notes = [f"data: {source}"] if source else []
    notes += [scored(results[:1]), *not_computed(results), *leaks(results)]
    return Table(results[0]["spec"], columns, rows, notes)


def conditions(results: Sequence[Result]) -> list[str]:
    """Notes on all tables: protocol, k, unit, intervals, and how weights were selected."""
    first = results[0]
    lines = [
        f"{first['split']} split, protocol {first['protocol']}, k = {first['k']}; {measured(results)}",
        f"means over agent-windows; {intervals(results)}; differences are paired, negative is better",
    ]
    shown = {r["predictor"]: r["reference_scenes"] for r in results if r["reference_scenes"]}
    lines += [f"{name}: was shown {n} reference scenes, disjoint from those scored" for name, n in shown.items()]
    shots = dict.fromkeys((r["predictor"], r["shots"]) for r in results if r["shots"])
    lines += [f"{name}: was given {n} scenes of the domain's training split" for name, n in shots]
    single = dict.fromkeys(r["predictor"] for r in results if r["samples"] < r["k"])
    lines += [f"{', '.join(single)}: deterministic, one forecast stands for all {first['k']} samples"] if single else []
    selected: dict[str, dict[str, None]] = {}
    for result in in_order(results):
        selected.setdefault(result["selection"], {})[result["predictor"]] = None
    lines += [f"{', '.join(names)}: {how}" for how, names in selected.items()]
    checked = {r["predictor"]: r["verified"] for r in results if not r["verified"].startswith(SHIPPED)}
    return lines + [f"{name}: {how}" for name, how in checked.items()]


def label(result: Result) -> str:
    """Predictor, with its seed if that is not 0, and marked if it is an oracle."""
    seed = f", seed {result['seed']}" if result["seed"] else ""
    return f"{result['predictor']}{seed}{' (oracle)' if result['oracle'] else ''}"
