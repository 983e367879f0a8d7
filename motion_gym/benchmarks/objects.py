"""What a benchmark is made of: parts, shifts, studies, claims and figures; the same for those of a user."""

from __future__ import annotations

import functools
import inspect
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks.identity import facts_of, shipped_card, stream_identity, windows_identity
from motion_gym.benchmarks.reports.claims import Claim
from motion_gym.contract import SpecError
from motion_gym.online.streams import stream_name

Report = Callable[[int, int, str], None]
"""Called with the number of runs done, of all, and what is next."""
SAMPLES = 20
"""k of most runs: the first sample gives the scores for k = 1, all of them those for k = 20."""
SEEDS = (0, 1, 2, 3, 4)
"""Seeds of weights, of fits, and of streams."""
BASELINE, NONE, ORACLE = "constant_velocity", "none", "oracle"
"""Rows that are in every online table."""
FILTERS = (BASELINE, "constant_velocity:velocity=4", "kalman_velocity")
"""Training-free rows, which are in every table."""


@dataclass(frozen=True)
class Part:
    """Rows that are scored on columns: one table of a benchmark.

    Attributes:
        title: Heading.
        domains: Columns of the table: short name, and spec.
        plain: Rows that are not trained, or are fitted to the sources at once.
        trained: Rows with shipped weights.
        weights: Name of the weights of the trained rows.
        protocol: Protocol of every run.
        references: Reference scenes that a predictor with a style is shown; None for all.
        pooled: Further columns, each the mean of some columns.
        shots: Scenes that are given to learn from, by column; none where a column is not named.
        samples: k of every run.
    """

    title: str
    domains: Mapping[str, str]
    plain: Sequence[str]
    trained: Sequence[str] = ()
    weights: str = ""
    protocol: str = "honest"
    references: int | None = None
    pooled: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    shots: Mapping[str, int] = field(default_factory=dict)
    samples: int = SAMPLES

    def runs(self) -> Iterator[tuple[str, str]]:
        """Predictor and column of every run."""
        yield from ((row, column) for row in self.plain for column in self.domains)
        for row in self.trained:
            yield from ((spec, column) for spec in self.seeds_of(row).values() for column in self.domains)

    def options(self, column: str) -> dict[str, Any]:
        """Options of ``evaluate`` for a column."""
        return {
            "k": self.samples,
            "protocol": self.protocol,
            "references": self.references,
            "shots": self.shots.get(column, 0),
        }

    def identity(self, predictor: str, column: str, session: str | None = None) -> dict[str, Any]:
        """Identity of a run."""
        return windows_identity(predictor, self.domain(column), session=session, **self.options(column))

    def domain(self, column: str) -> Any:
        """The domain of a column."""
        return domain(self.domains[column])

    def column_of(self, result: Mapping[str, Any]) -> str:
        """Name of the column that a result belongs to."""
        return self._columns[result["identity"]["domain"], result["identity"]["shots"]]

    @functools.cached_property
    def _columns(self) -> dict[tuple[str, int], str]:
        return {(facts_of(self.domain(name)).spec, self.shots.get(name, 0)): name for name in self.domains}

    def seeds_of(self, row: str) -> dict[int, str]:
        """Specs of a trained row by the seeds of its weights; SpecError if these do not ship."""
        return {
            seed: with_parameters(row, weights=self.weights, seed=seed)
            for seed in shipped_card(self.weights, row)["seeds"]
        }


Found = Sequence[tuple[Part, Sequence[Mapping[str, Any]]]]
"""Each part of a benchmark with its runs."""


@dataclass(frozen=True)
class Shifts:
    """Streams of one sort of shift, and the adapters that meet it.

    Attributes:
        title: Heading.
        source: Name of the predictor that is adapted.
        weights: Its weights.
        streams: Arguments of ``stream`` by kind, without the seed.
        oracle: Predictors that were trained on the target, without the seed: by domain, or one for all.
        rows: Adapters.
        tried: Settings to choose from, by the name of an adapter.
        chosen_on: Arguments of ``stream`` of another shift, on which settings are chosen; its frames are not scored.
        chosen_with: Weights that are used there.
    """

    title: str
    source: str
    weights: str
    streams: Mapping[str, Mapping[str, Any]]
    oracle: str | Mapping[str, str]
    rows: Sequence[str]
    tried: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    chosen_on: Mapping[str, Any] = field(default_factory=dict)
    chosen_with: str = ""

    def of(self, seed: int, weights: str | None = None) -> str:
        """Spec of the predictor that is adapted."""
        return with_parameters(self.source, weights=weights or self.weights, seed=seed)

    def oracle_of(self, seed: int) -> str | dict[str, str]:
        """Specs of the oracle's predictors: one, or one for each domain."""
        if isinstance(self.oracle, str):
            return with_parameters(self.oracle, seed=seed)
        return {place: with_parameters(spec, seed=seed) for place, spec in self.oracle.items()}

    def settings(self, row: str) -> list[str]:
        """Specs of a row with all the settings that are tried."""
        return [with_parameters(row, **more) for more in self.tried.get(catalog.parse_spec(row)[0], [{}])]

    def played(self, kind: str, seed: int) -> dict[str, Any]:
        """Arguments of ``stream``."""
        return {**self.streams[kind], "seed": seed}

    def chosen_stream(self) -> dict[str, Any]:
        """Arguments of the stream on which settings are chosen."""
        return {**self.chosen_on, "kind": "sudden", "seed": 0}

    def identity(self, row: Any, of: str, stream: Mapping[str, Any], session: str | None = None) -> dict[str, Any]:
        """Identity of a run of a row around a predictor."""
        oracle = self.oracle_of(stream["seed"]) if row == ORACLE else {}
        around = [oracle] if isinstance(oracle, str) else list(oracle.values())
        predictors = [row] if row in FILTERS else [row, of, *around]
        places = [domain(spec) for spec in dict.fromkeys(stream["domains"])]
        return stream_identity(row, predictors, of, name_of_stream(json.dumps(stream)), places, {}, session)


@dataclass(frozen=True)
class Study:
    """Something that is computed once and stored, and shown besides the tables of scores.

    Attributes:
        name: Name in the store.
        compute: ``"module:function"`` from the arguments to a dict in JSON types.
        render: ``"module:function"`` from that dict to a table; empty for none.
        draw: ``"module:function"`` from that dict and a path to a figure at the path; empty for none.
        file: Name of the figure.
        arguments: Of ``compute``, in JSON types.
        uses: Specs of the predictors that take part, with their weights.
        reads: Specs of the domains that are read.
        version: Raised by hand when the numbers change.
    """

    name: str
    compute: str
    render: str = ""
    draw: str = ""
    file: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    uses: Sequence[str] = ()
    reads: Sequence[str] = ()
    version: int = 1


@dataclass(frozen=True)
class Drawing:
    """A figure of an error over a parameter of the domains, which are the names of the columns of a part.

    Attributes:
        file: Name of the figure.
        label: The parameter, and its values in training.
        part: Number of the part.
        metric: Name of the metric.
        log: Whether the axis of the parameter is logarithmic.
    """

    file: str
    label: str
    part: int = 0
    metric: str = "ADE"
    log: bool = False


@dataclass(frozen=True)
class Benchmark:
    """What is scored on what, and what is shown of it.

    Attributes:
        name: Name of its folder and of its block in a file.
        title: What it tests, in a sentence.
        parts: Tables of scores of windows.
        shifts: Tables of scores of streams, by name.
        studies: What is computed once besides.
        claims: Sentences, and the rows of the parts that decide them.
        claims_over: What the columns are, for the table of claims.
        tables: ``"module:function"`` from the parts with their runs to a further table.
        drawings: Figures.
        short: Parts that are shown by ``motion-gym run``, or ``"module:function"`` of a table in their place.
    """

    name: str
    title: str
    parts: Sequence[Part] = ()
    shifts: Mapping[str, Shifts] = field(default_factory=dict)
    studies: Sequence[Study] = ()
    claims: Sequence[Claim] = ()
    claims_over: str = "d"
    tables: Sequence[str] = ()
    drawings: Sequence[Drawing] = ()
    short: Sequence[int] | str = (0,)

    def __post_init__(self) -> None:
        titles = [part.title for part in self.parts]
        if len(set(titles)) < len(titles):
            raise SpecError(f"Two parts of the benchmark `{self.name}` have the same title: give each its own.")

    def run(self, *predictors: Any, folder: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Compute what is missing, and score predictors of a user on every column.

        Args:
            *predictors: Specs, classes or objects.
            folder: For one small file per computed run; None to keep none.
            **options: Further options of ``running.run``, such as ``adapters``, ``shifts``, ``jobs`` and ``report``.

        Returns:
            ``running.Results``; printed, they are the tables.
        """
        from motion_gym.benchmarks import running  # which needs what is defined here

        return running.run(self, predictors, None if folder is None else Path(folder), **options)


@functools.lru_cache(maxsize=64)
def domain(spec: str) -> Any:
    """A domain by its spec, made once, so that its windows are kept."""
    return catalog.domain(spec)


@functools.cache
def name_of_stream(arguments: str) -> str:
    """Name of a stream by its arguments, as JSON."""
    return stream_name(**json.loads(arguments))


def with_parameters(spec: str, **more: Any) -> str:
    """A spec with further parameters, such as its weights and seed."""
    name, parameters = catalog.parse_spec(spec)
    return catalog.format_spec(name, {**parameters, **more})


def takes_weights(spec: str) -> bool:
    """Whether a predictor has weights."""
    return "weights" in inspect.signature(type(catalog.predictor(spec))).parameters


def weighted(rows: Sequence[str], weights: str) -> tuple[str, ...]:
    """Specs of rows with weights."""
    return tuple(with_parameters(row, weights=weights) for row in rows)
