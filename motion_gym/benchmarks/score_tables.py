"""Tables of single runs on windows: one table for each domain, or all domains in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from motion_gym.benchmarks.conditions import (
    Result,
    in_order,
    intervals,
    leaks,
    measured,
    not_computed,
    scored,
    unit_of,
)
from motion_gym.benchmarks.table import Code, Table, interval, number, pair

BASELINE = "constant_velocity"


def domain_table(results: Sequence[Result]) -> Table:
    """A row for each predictor, for results that ``groups`` puts together."""
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
        row += ["-" if baseline else interval(result["versus_baseline"]["ADE"], sign=True), *_best_of(result)]
        rows.append(row + [number(metrics.get(name, {}).get("mean")) for name in densities])
    return Table(results[0]["spec"], columns, rows, [scored(results[:1]), *not_computed(results), *leaks(results)])


def overview(results: Iterable[Result]) -> list[Table]:
    """A row for each domain and a column for each predictor; a table for each split, protocol, k and unit."""
    return [_overview(part) for part in _by(results, lambda r: (*_options(r), unit_of([r])))]


def _overview(results: Sequence[Result]) -> Table:
    tables = groups(results)
    names = list(dict.fromkeys(label(result) for result in in_order(results)))
    rows = []
    for group in tables:
        by_name = {label(result): result for result in group}
        cells = [_cell(by_name[name]) if name in by_name else "" for name in names]
        said = "; ".join([scored(group[:1]), *not_computed(group), *leaks(group)])
        rows.append([Code(group[0]["spec"]), *cells, said])
    k = results[0]["k"]
    best = f", then minADE_{k} / minFDE_{k} and JADE_{k} / JFDE_{k}" if k > 1 else ""
    return Table("", ["domain", *names, "scored"], rows, [f"Cells are ADE [95 %] / FDE{best}", *conditions(results)])


def conditions(results: Sequence[Result]) -> list[str]:
    """What is true of all tables together: protocol, k, unit, intervals, and how weights were selected."""
    first = results[0]
    lines = [
        f"{first['split']} split, protocol {first['protocol']}, k = {first['k']}; {measured(results)}",
        f"means over agent-windows; {intervals(results)}; differences are paired, negative is better",
    ]
    shown = {r["predictor"]: r["reference_scenes"] for r in results if r["reference_scenes"]}
    lines += [f"{name}: was shown {n} reference scenes, disjoint from those scored" for name, n in shown.items()]
    given = dict.fromkeys((r["predictor"], r["shots"]) for r in results if r["shots"])
    lines += [f"{name}: was given {n} scenes of the domain's training split" for name, n in given]
    single = dict.fromkeys(r["predictor"] for r in results if r["samples"] < r["k"])
    lines += [f"{', '.join(single)}: deterministic, one forecast stands for all {first['k']} samples"] if single else []
    selected: dict[str, dict[str, None]] = {}
    for result in in_order(results):
        selected.setdefault(result["selection"], {})[result["predictor"]] = None
    return lines + [f"{', '.join(names)}: {how}" for how, names in selected.items()]


def groups(results: Iterable[Result]) -> list[list[Result]]:
    """Results that may stand in one table: the same domain, split, protocol and k."""
    return _by(results, lambda r: (r["identity"]["domain"], *_options(r)))


def label(result: Result) -> str:
    """Predictor, with its seed if that is not 0, and marked if it is an oracle."""
    seed = f", seed {result['seed']}" if result["seed"] else ""
    return f"{result['predictor']}{seed}{' (oracle)' if result['oracle'] else ''}"


def _cell(result: Result) -> str:
    metrics = result["metrics"]
    return ", ".join([pair(interval(metrics["ADE"]), number(metrics["FDE"]["mean"])), *_best_of(result)])


def _best_of(result: Result) -> list[str]:
    """ADE / FDE of the best sample of each agent and of each scene; nothing for one sample."""
    metrics, k = result["metrics"], result["k"]
    names = ((f"minADE_{k}", f"minFDE_{k}"), (f"JADE_{k}", f"JFDE_{k}")) if k > 1 else ()
    return [pair(number(metrics[ade]["mean"]), number(metrics[fde]["mean"])) for ade, fde in names]


def _options(result: Result) -> tuple[Any, ...]:
    asked = result["identity"]
    return result["split"], result["protocol"], result["k"], asked["references"], asked["shots"]


def _by(results: Iterable[Result], key: Callable[[Result], Any]) -> list[list[Result]]:
    groups: dict[Any, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return list(groups.values())
