"""The classes that define a benchmark, shipped or a user's: parts, shifts, studies, claims and figures."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks.definition_checks import check_benchmark, check_part
from motion_gym.benchmarks.identity import facts_of, shipped_card, stream_identity, windows_identity
from motion_gym.benchmarks.row_specs import domain, name_of_stream, of_seed, with_parameters
from motion_gym.contract import SpecError

Report = Callable[[int, int, str], None]
"""Called with the number of finished runs, the number of all runs, and the label of the next run."""
SAMPLES = 20
"""k of most runs: the first sample gives the scores for k = 1, all of them those for k = 20."""
SEEDS = (0, 1, 2, 3, 4)
"""Seeds of weights, of fits, and of streams."""
FURTHER_SEEDS = (5, 6, 7, 8, 9)
"""Further seeds of streams for rows that are compared with their own experts; weights of the seeds 0 to 4."""
BASELINE, NONE, ORACLE = "constant_velocity", "none", "oracle"
"""Rows that are in every online table."""
FILTERS = (BASELINE, "constant_velocity:velocity=4", "kalman_velocity")
"""Training-free rows, which are in every table."""
EVERYWHERE, NOWHERE, NOT_EVERYWHERE = "everywhere", "nowhere", "not everywhere"
"""Where a claim says that the error is lower."""
LEVEL = 0.05
"""A p-value below this is significant."""


@dataclass(frozen=True)
class External:
    """A row of an external program: its runs are stored, and are computed only where there is a checkout of it.

    Attributes:
        name: Name in tables.
        spec: Spec of its wrapper, without weights.
        weights: Name of the weights by column.
        fingerprints: Fingerprint of the weights by their name, as the wrapper has it.
    """

    name: str
    spec: str
    weights: Mapping[str, str]
    fingerprints: Mapping[str, str]

    def predictor(self, column: str) -> str:
        """Spec of the wrapper with the weights of a column."""
        return with_parameters(self.spec, weights=self.weights[column])


@dataclass(frozen=True)
class Part:
    """Rows that are scored on columns: one table of a benchmark.

    Attributes:
        title: Heading.
        domains: Columns of the table: short name, and spec.
        plain: Rows that are not trained, or that are fitted to the sources in closed form.
        trained: Rows with shipped weights.
        weights: Name of the weights of the trained rows.
        protocol: Protocol of every run.
        references: Number of reference scenes that a predictor with a style receives; None for all.
        pooled: Further columns, each the mean of some columns.
        shots: Number of scenes to learn from, by column; 0 for columns that are not named.
        samples: k of every run.
        external: Rows of external programs.
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
    external: Sequence[External] = ()

    def __post_init__(self) -> None:
        check_part(self)

    def runs(self) -> Iterator[tuple[str, str]]:
        """Predictor and column of every run; SpecError if the weights of a trained row do not ship."""
        yield from ((row, column) for row in self.plain for column in self.domains)
        for row in self.trained:
            for seed in shipped_card(self.weights, row)["seeds"]:
                predictor = with_parameters(row, weights=self.weights, seed=seed)
                yield from ((predictor, column) for column in self.domains)
        yield from ((row.predictor(column), column) for row in self.external for column in row.weights)

    @functools.cached_property
    def fingerprints(self) -> dict[str, str]:
        """Fingerprint of the weights of each predictor that is an external program."""
        columns = [(row, column, name) for row in self.external for column, name in row.weights.items()]
        return {row.predictor(column): row.fingerprints[name] for row, column, name in columns}

    def options(self, column: str) -> dict[str, Any]:
        """Options of ``evaluate`` for a column."""
        return {
            "k": self.samples,
            "protocol": self.protocol,
            "references": self.references,
            "shots": self.shots.get(column, 0),
        }

    def identity(self, predictor: Any, column: str, session: str | None = None, **options: Any) -> dict[str, Any]:
        """Identity of a run; that of an external program is known by the fingerprint of its weights."""
        options = {**self.options(column), **options}
        identity = windows_identity(predictor, self.domain(column), session=session, **options)
        external = self.fingerprints.get(predictor) if isinstance(predictor, str) else None
        return {**identity, "weights": {predictor: external}, "session": None} if external else identity

    def domain(self, column: str) -> Any:
        """The domain of a column."""
        return domain(self.domains[column])

    def column_of(self, result: Mapping[str, Any]) -> str:
        """Name of the column that a result belongs to."""
        return self._columns[result["identity"]["domain"], result["identity"]["shots"]]

    def find_column(self, result: Mapping[str, Any]) -> str | None:
        """Name of the column that a result belongs to; None if it belongs to none."""
        return self._columns.get((result["identity"]["domain"], result["identity"]["shots"]))

    @functools.cached_property
    def _columns(self) -> dict[tuple[str, int], str]:
        return {(facts_of(self.domain(name)).spec, self.shots.get(name, 0)): name for name in self.domains}


@dataclass(frozen=True)
class Shifts:
    """Streams with one sort of shift, and the adapters that are compared on them.

    Attributes:
        title: Heading.
        source: Name of the predictor that is adapted.
        weights: Its weights; empty for a predictor that is fitted in closed form.
        streams: Arguments of ``stream`` by kind, without the seed.
        oracle: Predictors that were trained on the target, without the seed: by domain, or one for all. One without
            weights is fitted to the scored people themselves.
        rows: Adapters.
        tried: Settings to choose from, by the name of an adapter.
        chosen_on: Arguments of ``stream`` of another shift, on which settings are chosen; its frames are not scored.
        chosen_with: Weights of the predictor on that shift.
        fitted_to: Domains on whose training windows a predictor without weights is fitted.
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
    fitted_to: Sequence[str] = ()

    def of(self, seed: int, weights: str | None = None) -> str:
        """Spec of the predictor that is adapted."""
        name = weights or self.weights
        return with_parameters(self.source, weights=name, seed=seed % len(SEEDS)) if name else self.source

    def oracle_of(self, seed: int) -> str | dict[str, str]:
        """Specs of the oracle's predictors: one, or one for each domain."""
        if isinstance(self.oracle, str):
            return of_seed(self.oracle, seed)
        return {domain: of_seed(spec, seed) for domain, spec in self.oracle.items()}

    def settings(self, row: str) -> list[str]:
        """Specs of a row with each of the settings that are tried."""
        return [with_parameters(row, **setting) for setting in self.tried.get(catalog.parse_spec(row)[0], [{}])]

    def all_rows(self) -> tuple[str, ...]:
        """Rows of a table."""
        return (*FILTERS, NONE, ORACLE, *self.rows)

    def identity(self, row: Any, of: str, stream: Mapping[str, Any], session: str | None = None) -> dict[str, Any]:
        """Identity of a run of a row around a predictor, on the stream that arguments of ``stream`` describe."""
        oracle = self.oracle_of(stream["seed"]) if row == ORACLE else {}
        oracles = [oracle] if isinstance(oracle, str) else list(oracle.values())
        predictors = [row] if row in FILTERS else [row, of, *oracles]
        domains = [domain(spec) for spec in dict.fromkeys([*stream["domains"], *self.fitted_to])]
        options = {"fitted_to": list(self.fitted_to)} if self.fitted_to else {}
        return stream_identity(row, predictors, of, name_of_stream(json.dumps(stream)), domains, options, session)


@dataclass(frozen=True)
class Study:
    """Values other than scores that are computed once and stored.

    Attributes:
        name: Name in the store.
        compute: ``"module:function"`` from the arguments to a dict in JSON types.
        render: ``"module:function"`` from that dict to a table; empty for none.
        curves: ``"module:function"`` from that dict to a list of ``Curves``, which are drawn; empty for none.
        draw: ``"module:function"`` from that dict and a path to a figure of another sort; empty for none.
        file: Name of the figure; empty for none.
        arguments: Arguments of ``compute``, in JSON types.
        uses: Specs of the predictors that take part, with their weights.
        reads: Specs of the domains that are read.
        version: Raised by hand when the numbers change.
    """

    name: str
    compute: str
    render: str = ""
    curves: str = ""
    draw: str = ""
    file: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    uses: Sequence[str] = ()
    reads: Sequence[str] = ()
    version: int = 1


@dataclass(frozen=True)
class Claim:
    """A sentence, and the test that decides it: rows have a lower error than other rows.

    Attributes:
        sentence: What is claimed.
        rows: Rows whose error is claimed to be lower.
        than: Rows with which each of them is compared; empty for the row itself in ``than_column``.
        columns: Columns that are tested; empty for all.
        panel: Name of the panel; empty for all panels of the honest protocol that have the rows.
        than_column: Column of the other rows, where it differs.
        ratio: Range of (mean error of the row) / (mean error of the other row), compared to 1 %.
        significant: Whether the difference must also be significant.
        each_seed: Whether the ratio must be in range for each seed.
        where: ``everywhere``, ``nowhere`` or ``not everywhere``; p-values of the latter two are not corrected.
    """

    sentence: str
    rows: Sequence[str]
    than: Sequence[str] = ()
    columns: Sequence[str] = ()
    panel: str = ""
    than_column: str = ""
    ratio: tuple[float, float] = (0.0, 1.0)
    significant: bool = True
    each_seed: bool = False
    where: str = EVERYWHERE

    def __post_init__(self) -> None:
        if self.where not in (EVERYWHERE, NOWHERE, NOT_EVERYWHERE):
            choices = f"`{EVERYWHERE}`, `{NOWHERE}` or `{NOT_EVERYWHERE}`"
            raise SpecError(f"`where={self.where}` of the claim `{self.sentence}` is not known: choose {choices}.")
        if not self.than and not self.than_column:
            raise SpecError(f"The claim `{self.sentence}` compares with nothing: name `than` or `than_column`.")

    @property
    def test(self) -> str:
        """The test in words."""
        low, high = self.ratio
        span = f"at most {high:.2f}" if not low else f"{low:.2f} to {high:.2f}".replace(" to inf", " or more")
        text = "lower" if self.ratio == (0.0, 1.0) else f"ratio of means {span}"
        text += " for each seed" if self.each_seed else ""
        corrected = "corrected " if self.where == EVERYWHERE else ""
        text += f", paired t-test with {corrected}p < {LEVEL:g}" if self.significant else ""
        return f"{text}; {self.where}"


@dataclass(frozen=True)
class Drawing:
    """A figure of an error over a parameter of the domains. Columns of the part are named by the parameter's values.

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
    """Which predictors are scored on which domains, and which tables and figures show the results.

    Attributes:
        name: Name of its folder and of its block in a file.
        title: What it tests, in a sentence.
        parts: Tables of scores of windows.
        shifts: Tables of scores of streams, by name.
        studies: Further values that are computed once.
        drives: Tables of scores of driven episodes, ``drives.Drives``.
        claims: Sentences, and the rows of the parts that decide them.
        claims_over: What the columns are, for the table of claims.
        tables: ``"module:function"`` from the parts with their runs to a further table.
        drawings: Figures.
        short: Numbers of the parts that ``motion-gym run`` prints; empty to print ``tables`` instead.
    """

    name: str
    title: str
    parts: Sequence[Part] = ()
    shifts: Mapping[str, Shifts] = field(default_factory=dict)
    studies: Sequence[Study] = ()
    drives: Sequence[Any] = ()
    claims: Sequence[Claim] = ()
    claims_over: str = "d"
    tables: Sequence[str] = ()
    drawings: Sequence[Drawing] = ()
    short: Sequence[int] = (0,)

    def __post_init__(self) -> None:
        check_benchmark(self, {"parts": Part, "studies": Study, "claims": Claim})

    def run(self, *predictors: Any, folder: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Compute the runs that are missing, and score a user's predictors on every column.

        Args:
            *predictors: Specs, classes or objects.
            folder: Folder for one small file per computed run; None to write none.
            **options: Further options of ``running.run``, such as ``adapters``, ``executor`` and ``report``.

        Returns:
            ``running.Results``; ``print`` shows the tables.
        """
        from motion_gym.benchmarks import running  # imports this module

        return running.run(self, predictors, None if folder is None else Path(folder), **options)
