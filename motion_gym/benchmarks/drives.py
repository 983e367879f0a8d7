"""Driven episodes of a benchmark: their tables, and the runs that fill them."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from motion_gym.benchmarks.identity import drive_identity, facts_of, label_of, row_name
from motion_gym.benchmarks.jobs import Job
from motion_gym.benchmarks.objects import SEEDS, Benchmark
from motion_gym.benchmarks.row_specs import domain, with_parameters


@dataclass(frozen=True)
class Drives:
    """Rows that drive on columns: one table of a benchmark.

    Each column is driven with five seeds: the domain has the seed, so that each seed has traffic of its own. Predictors
    are fitted to the sources of the domain with its default seed and size.

    Attributes:
        title: Heading.
        domains: Columns of the table: short name, and spec without a seed.
        plain: Rows that are not trained, or that are fitted in closed form, adapters included.
        trained: Rows with shipped weights; the seed of the weights is that of the episodes.
        weights: Name of the weights of the trained rows.
        others: How the others move.
        episodes: Number of episodes of each seed.
        runs: Number of simulated runs of each seed.
    """

    title: str
    domains: Mapping[str, str]
    plain: Sequence[str]
    trained: Sequence[str] = ()
    weights: str = ""
    others: str = "react"
    episodes: int = 100
    runs: int = 6

    def rows(self) -> tuple[str, ...]:
        """Rows of the table."""
        return (*self.plain, *self.trained)

    def predictor(self, row: str, seed: int) -> str:
        """Spec of a row with the weights of a seed."""
        return with_parameters(row, weights=self.weights, seed=seed) if row in self.trained else row

    def domain(self, column: str, seed: int) -> Any:
        """The domain that is driven in."""
        return domain(with_parameters(self.domains[column], seed=seed, runs=self.runs))

    def identity(self, predictor: Any, column: str, seed: int, session: str | None = None) -> dict[str, Any]:
        """Identity of a run."""
        return drive_identity(
            predictor,
            self.domain(column, seed),
            others=self.others,
            episodes=self.episodes,
            seed=seed,
            fitted_to=domain(self.domains[column]),
            session=session,
        )

    def job(self, row: str, predictors: Sequence[Any], column: str, session: str) -> Job:
        """The runs of a row in a column: a predictor for each seed."""
        identities = [self.identity(p, column, seed, session) for p, seed in zip(predictors, SEEDS, strict=True)]
        compute = functools.partial(_drive, self, tuple(predictors), column)
        spec = self.domains[column]
        label = f"{row} drives on {spec}, others {self.others}"
        return Job(label, (self.title, column), row, spec, identities, compute)

    def column_of(self, run: Mapping[str, Any]) -> str:
        """Name of the column that a run belongs to."""
        return self._columns[run["identity"]["fitted_to"]]

    @functools.cached_property
    def _columns(self) -> dict[str, str]:
        return {facts_of(domain(spec)).spec: column for column, spec in self.domains.items()}


def drive_jobs(benchmark: Benchmark, session: str) -> Iterator[Job]:
    """Every row on every column, all seeds together."""
    for drives in benchmark.drives:
        for row in drives.rows():
            for column in drives.domains:
                yield drives.job(row_name(row), [drives.predictor(row, seed) for seed in SEEDS], column, session)


def _drive(drives: Drives, predictors: Sequence[Any], column: str) -> list[dict[str, Any]]:
    """Results of all seeds, in JSON types."""
    from motion_gym.driving.evaluation import drive

    results = []
    for predictor, seed in zip(predictors, SEEDS, strict=True):
        card = drive(
            predictor,
            drives.domain(column, seed),
            others=drives.others,
            episodes=drives.episodes,
            seed=seed,
            fitted_to=domain(drives.domains[column]),
        )
        results.append({**card.as_dict(), "predictor": label_of(predictor)})
    return results
