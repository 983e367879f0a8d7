"""Means with intervals that know how few pedestrians stand behind many windows.

Windows of one agent overlap and resemble each other, so agents (clusters) are resampled and not windows: the
percentile bootstrap for clustered data (Davison and Hinkley, Bootstrap Methods and their Application, 1997).
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from motion_gym.contract import Observation, SpecError

DRAWS_AT_ONCE = 1 << 18
"""Drawn clusters held in memory together."""
MOST_KEPT = 1 << 24
"""Drawn clusters up to which resamples are kept for the next metric, which sees the same ones."""


class Interval(NamedTuple):
    """A mean and its bootstrap interval: floats, or [M] arrays for M metrics."""

    mean: Any
    low: Any
    high: Any


@dataclass(frozen=True)
class Summary:
    """The mean of a metric and what stands behind it.

    Attributes:
        mean: Mean over the agent-windows where the metric could be computed; NaN if there are none.
        low: Lower end of the interval; NaN where it is undefined.
        high: Upper end of the interval; NaN where it is undefined.
        agent_windows: Values behind the mean.
        scenes: Scenes that they come from.
        agents: Distinct agents that they come from.
    """

    mean: float
    low: float
    high: float
    agent_windows: int
    scenes: int
    agents: int


@dataclass(frozen=True)
class Difference:
    """The paired difference a - b of two predictors on the same agent-windows.

    Attributes:
        mean: Mean of a - b; negative where a has the lower values.
        low: Lower end of the interval; NaN where it is undefined.
        high: Upper end of the interval; NaN where it is undefined.
        p_value: Two-sided bootstrap p-value of "the mean difference is 0"; NaN where it is undefined.
        n: Agent-windows where both could be computed.
    """

    mean: float
    low: float
    high: float
    p_value: float
    n: int


def clustered_interval(
    values: np.ndarray, cluster: np.ndarray, level: float = 0.95, replicates: int = 1000, seed: int = 0
) -> Interval:
    """Mean over all finite values, and its percentile bootstrap interval clustered by agent.

    A replicate draws as many clusters as there are, with replacement, and divides the sum of their values by
    the number of their finite values. All metrics see the same draws. Replicates without a finite value are
    left out.

    Args:
        values: [A] or [A, M]; NaN where a metric could not be computed.
        cluster: [A], what belongs together: ids of agents, unique over everything that is pooled.
        level: Coverage, between 0 and 1.
        replicates: Number of resamples.
        seed: Source of all randomness; the same seed gives the same interval.

    Returns:
        Interval of floats for [A], of [M] arrays for [A, M]. With fewer than two clusters that hold a finite
        value, low and high are undefined and NaN; with none, so is the mean.

    Raises:
        SpecError: Shapes that do not fit, an infinite value, a level or a number of replicates out of range.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim not in (1, 2):
        raise SpecError(f"values have shape {values.shape}, expected [A] or [A, M].")
    table = values if values.ndim == 2 else values[:, None]
    mean, means = _resampled_means(table, np.asarray(cluster), level, replicates, seed)
    low, high = _percentiles(means, level)
    if values.ndim == 2:
        return Interval(mean, low, high)
    return Interval(float(mean[0]), float(low[0]), float(high[0]))


def paired_difference(
    a: np.ndarray,
    b: np.ndarray,
    cluster: np.ndarray,
    level: float = 0.95,
    replicates: int = 1000,
    seed: int = 0,
) -> Difference:
    """Mean of a - b over the agent-windows where both are finite, with the clustered bootstrap.

    Both see the same resamples, since the differences are what is resampled. The p-value is twice the share
    of replicates beyond 0, with one more counted on that side, so it is never under 2 / (replicates + 1).

    Args:
        a: [A] values of one predictor, NaN where they could not be computed.
        b: [A] values of the other one, for the same agent-windows in the same order.
        cluster: [A], ids of agents, as for `clustered_interval`.
        level: Coverage, between 0 and 1.
        replicates: Number of resamples.
        seed: Source of all randomness.

    Returns:
        The difference; its interval and p-value are NaN with fewer than two clusters.

    Raises:
        SpecError: As `clustered_interval`, or a and b differ in shape.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if a.ndim != 1 or a.shape != b.shape:
        raise SpecError(f"a and b have shapes {a.shape} and {b.shape}, expected [A] and the same agents in both.")
    if np.isinf(a).any() or np.isinf(b).any():
        raise SpecError("a or b holds infinite values; only NaN may stand for a value that could not be computed.")
    difference = a - b
    mean, means = _resampled_means(difference[:, None], np.asarray(cluster), level, replicates, seed)
    low, high = _percentiles(means, level)
    drawn = means[np.isfinite(means)]
    tail = min((drawn <= 0).sum(), (drawn >= 0).sum())
    p_value = min(1.0, 2.0 * (1 + tail) / (1 + len(drawn))) if len(drawn) else np.nan
    return Difference(float(mean[0]), float(low[0]), float(high[0]), float(p_value), int(np.isfinite(difference).sum()))


def summarise(
    scores: Mapping[str, np.ndarray],
    observation: Observation,
    level: float = 0.95,
    replicates: int = 1000,
    seed: int = 0,
) -> dict[str, Summary]:
    """Mean, interval and counts of each metric, all from the same resamples of the agents.

    Args:
        scores: [A] values by name of the metric, as ``motion_gym.metrics.errors.score`` gives them.
        observation: The scored observation; says which agent and which scene each value belongs to.
        level: Coverage, between 0 and 1.
        replicates: Number of resamples.
        seed: Source of all randomness.

    Returns:
        A Summary by name of the metric.
    """
    if not scores:
        return {}
    table = np.stack([np.asarray(values, dtype=np.float64) for values in scores.values()], axis=1)
    interval = clustered_interval(table, observation.agent, level, replicates, seed)
    scene_index, (_, agent) = observation.scene_index, np.unique(observation.agent, return_inverse=True)
    summaries = {}
    for column, name in enumerate(scores):
        there = ~np.isnan(table[:, column])
        mean, low, high = (float(part[column]) for part in interval)
        scenes, agents = (int(np.count_nonzero(np.bincount(index[there]))) for index in (scene_index, agent))
        summaries[name] = Summary(mean, low, high, int(there.sum()), scenes, agents)
    return summaries


def _resampled_means(
    table: np.ndarray, cluster: np.ndarray, level: float, replicates: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """The mean [M] of each column and its replicates [R, M], NaN in columns with fewer than two clusters."""
    if not 0 < level < 1:
        raise SpecError(f"level is {level!r}, it must lie between 0 and 1; 0.95 is usual.")
    if replicates < 1:
        raise SpecError(f"replicates is {replicates!r}, it must be 1 or more; 1000 is usual.")
    if cluster.shape != (len(table),):
        raise SpecError(f"cluster has shape {cluster.shape}, expected ({len(table)},): one id for each value.")
    if np.isinf(table).any():
        raise SpecError("values holds infinite values; only NaN may stand for a value that could not be computed.")
    there = ~np.isnan(table)
    ids, index = np.unique(cluster, return_inverse=True)
    same = there.shape[1] > 0 and there.all()  # most often, and then one column counts for all
    kinds, kind = (there[:, :1], np.zeros(there.shape[1], int)) if same else (there, np.arange(there.shape[1]))
    columns = [np.bincount(index, column, minlength=len(ids)) for column in np.where(there, table, 0.0).T]
    columns += [np.bincount(index, column, minlength=len(ids)) for column in kinds.T]
    sums = np.stack(columns, axis=1) if columns else np.empty((len(ids), 0))
    metrics = table.shape[1]

    def ratio(sums: np.ndarray) -> np.ndarray:
        total, count = sums[..., :metrics], sums[..., metrics:][..., kind]
        return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)

    mean = ratio(sums.sum(axis=0))
    enough = ((sums[:, metrics:] > 0).sum(axis=0) >= 2)[kind]
    if not enough.any():
        return mean, np.full((replicates, metrics), np.nan)
    drawn = _resamples(len(ids), replicates, seed)
    means = np.concatenate([ratio(weights.astype(np.float64, copy=False) @ sums) for weights in drawn])
    return mean, np.where(enough, means, np.nan)


def _resamples(clusters: int, replicates: int, seed: int) -> Iterable[np.ndarray]:
    """How often each replicate draws each cluster: [rows, clusters] at a time, R rows in all."""
    return (_kept if clusters * replicates <= MOST_KEPT else _drawn)(clusters, replicates, seed)


@functools.lru_cache(maxsize=1)
def _kept(clusters: int, replicates: int, seed: int) -> list[np.ndarray]:
    return [block.astype(np.min_scalar_type(int(block.max()))) for block in _drawn(clusters, replicates, seed)]


def _drawn(clusters: int, replicates: int, seed: int) -> Iterator[np.ndarray]:
    """Blocks of float64.

    Counting plain draws is exact and, for many clusters, several times faster than a multinomial draw.
    """
    rng = np.random.default_rng(seed)
    block = max(1, DRAWS_AT_ONCE // clusters)
    for start in range(0, replicates, block):
        rows = min(block, replicates - start)
        drawn = rng.integers(clusters, size=(rows, clusters))
        drawn += np.arange(rows)[:, None] * clusters
        counts = np.bincount(drawn.ravel(), minlength=rows * clusters)
        yield counts.reshape(rows, clusters).astype(np.float64)


def _percentiles(means: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of the interval, [M] each; NaN for columns without a replicate."""
    ends = np.full((2, means.shape[1]), np.nan)
    there = ~np.isnan(means).all(axis=0)
    ends[:, there] = np.nanquantile(means[:, there], [(1 - level) / 2, (1 + level) / 2], axis=0)
    return ends[0], ends[1]
