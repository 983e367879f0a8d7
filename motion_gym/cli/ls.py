"""The command that lists domains, predictors, benchmarks and data sets, and explains one of them."""

from __future__ import annotations

import inspect
from typing import Annotated

import tyro

from motion_gym import catalog
from motion_gym.benchmarks.reports.table import Table
from motion_gym.benchmarks.running import BENCHMARKS, benchmark
from motion_gym.cli.output import console, say
from motion_gym.contract import SpecError
from motion_gym.data import datasets
from motion_gym.metrics.errors import METRICS
from motion_gym.scoring.evaluation import PROTOCOLS


def ls(name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = None) -> None:
    """List domains, predictors, adapters, benchmarks, protocols, metrics and data sets, or explain one.

    Args:
        name: Domain, predictor or adapter to explain, with its parameters; without a name, all are listed.
    """
    if name is not None:
        _explain(name)
        return
    head = ("name", "description")
    domains = [(key, entry.env_id or "", entry.summary) for key, entry in catalog.DOMAINS.items()]
    predictors = [(key, entry.summary) for key, entry in catalog.PREDICTORS.items()]
    adapters = [(key, entry.summary) for key, entry in catalog.ADAPTERS.items()]
    benchmarks = [(key, benchmark(key).title) for key in BENCHMARKS]
    metrics = [(metric.name, metric.unit, metric.description) for metric in METRICS]
    sets = [(entry.name, entry.title) for entry in datasets.DATASETS.values()]
    for table in (
        Table(
            "Domains  (name:parameter=value; also environments motion_gym/ID)", ("name", "id", "description"), domains
        ),
        Table("Predictors  (or your own: module:Class)", head, predictors),
        Table("Adapters  (motion-gym adapt PREDICTOR --adapter NAME; or your own: module:Class)", head, adapters),
        Table("Benchmarks  (motion-gym run NAME; or your own: module:OBJECT)", head, benchmarks),
        Table("Protocols", head, list(PROTOCOLS.items())),
        Table("Metrics", ("name", "unit", "description"), metrics),
        Table("Data sets  (motion-gym data ...)", head, sets),
    ):
        console.print(table)


def _explain(name: str) -> None:
    target, _ = catalog.parse_spec(name)
    known = {**catalog.DOMAINS, **catalog.PREDICTORS, **catalog.ADAPTERS}
    if target not in known and ":" not in target:
        raise SpecError(f"There is nothing of the name `{name}`.{catalog.suggest(name, known)} Your own: module:Class.")
    entry = known.get(target)
    kind = catalog.load_class(entry.target if entry else target)
    say(f"{name}{inspect.signature(kind)}\n\n{inspect.getdoc(kind)}")
    parent = next((k for k in kind.__mro__[1:] if k.__doc__ and "## Arguments" in k.__doc__), None)
    if parent is not None and "## Arguments" not in (kind.__doc__ or ""):
        say(f"\n{inspect.getdoc(parent)}")
