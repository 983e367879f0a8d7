"""The command that lists domains, predictors, benchmarks, metrics and data sets, and explains one of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import tyro

from motion_gym import catalog
from motion_gym.benchmarks.reports.table import Table
from motion_gym.benchmarks.running import BENCHMARKS, benchmark
from motion_gym.cli.explain import explanations
from motion_gym.cli.output import Json, console, print_json, say
from motion_gym.data import datasets
from motion_gym.metrics.errors import METRICS
from motion_gym.scoring.evaluation import PROTOCOLS


def ls(
    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = None, as_json: Json = False
) -> None:
    """List domains, predictors, adapters, benchmarks, protocols, metrics and data sets, or explain one.

    Args:
        name: What to explain; without a name, all are listed.
        as_json: Print JSON in place of tables.
    """
    if name is not None:
        explained = explanations(name)
        if as_json:
            print_json(explained)
        else:
            say("\n\n".join("{kind} {name}{signature}\n\n{description}".format(**entry) for entry in explained))
        return
    head = ("name", "description")
    rows: dict[str, tuple[str, tuple[str, ...], list[tuple[str, ...]]]] = {
        "domains": (
            "Domains  (name:parameter=value; also environments motion_gym/ID)",
            ("name", "id", "description"),
            [(key, entry.env_id or "", entry.summary) for key, entry in catalog.DOMAINS.items()],
        ),
        "predictors": ("Predictors  (or your own: module:Class)", head, _summaries(catalog.PREDICTORS)),
        "adapters": (
            "Adapters  (motion-gym adapt PREDICTOR --adapter NAME; or your own: module:Class)",
            head,
            _summaries(catalog.ADAPTERS),
        ),
        "benchmarks": (
            "Benchmarks  (motion-gym run NAME; or your own: module:OBJECT)",
            head,
            [(key, benchmark(key).title) for key in BENCHMARKS],
        ),
        "protocols": ("Protocols", head, list(PROTOCOLS.items())),
        "metrics": (
            "Metrics",
            ("name", "unit", "description"),
            [(metric.name, metric.unit, metric.description) for metric in METRICS],
        ),
        "data_sets": (
            "Data sets  (motion-gym data ...)",
            head,
            [(entry.name, entry.title) for entry in datasets.DATASETS.values()],
        ),
    }
    if as_json:
        print_json(
            {key: [dict(zip(names, row, strict=True)) for row in table] for key, (_, names, table) in rows.items()}
        )
        return
    for title, names, table in rows.values():
        console.print(Table(title, names, table))


def _summaries(entries: Mapping[str, catalog.Entry]) -> list[tuple[str, ...]]:
    return [(key, entry.summary) for key, entry in entries.items()]
