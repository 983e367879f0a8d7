"""Errors of forecasts, one value per agent, so that means and intervals can be taken over any grouping.

A metric is a pure function of a Forecast and its Truth, and a row of ``METRICS``. Metrics are computed in float64.
Lengths are in the unit of the domain. NaN means that the metric is not defined: no step is known, or the forecast is no
density.

A metric with a k scores the *first* k samples. A single sample stands for all samples, so that deterministic predictors
can be scored for any k; otherwise fewer than k samples are an error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from motion_gym.contract import FUTURE, Forecast, PredictorError, SpecError, Truth
from motion_gym.data.validation import check_forecast
from motion_gym.data.windows import check_truth

MISS_DISTANCE = 2.0
"""Metres between the last forecast and the last true position beyond which a forecast is a miss."""
COLLISION_DISTANCE = 0.2
"""Metres between two centres under which two agents collide: a person radius of 0.1 m, as in TrajNet++."""
LOG_DENSITY_BOUND = -20.0
"""Lowest log density (1 / m^2), as in Trajectron++, so that a single agent does not dominate the mean."""
KERNEL_WIDTH = 0.01
"""Smallest standard deviation of a kernel, metres, so that samples on a line have a density."""
PAIRS_AT_ONCE = 1 << 14
"""Number of pairs of agents whose distances are held in memory together."""


def ade(forecast: Forecast, truth: Truth) -> np.ndarray:
    """Average displacement error of the most likely sample over the known steps.

    Args:
        forecast: A agents; the sample of highest weight is scored, or the first sample if there are no weights.
        truth: Ground truth of the same agents, in the same order.

    Returns:
        [A] float64, a length; NaN for an agent without a known step.

    Raises:
        PredictorError: The forecast has a wrong shape, or impossible positions or weights.
        DataError: The truth is not valid.
    """
    return mean_over_known(_checked(forecast, truth).error, truth.known)


def fde(forecast: Forecast, truth: Truth) -> np.ndarray:
    """Final displacement error of the most likely sample: [A] lengths, NaN where that step is not known."""
    return error_by_horizon(forecast, truth)[:, -1]


def error_by_horizon(forecast: Forecast, truth: Truth) -> np.ndarray:
    """Displacement error of the most likely sample at each step: [A, 12] lengths, NaN where not known."""
    return np.where(truth.known, _checked(forecast, truth).error, np.nan)


def min_ade(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """ADE of the best of the first k samples, chosen for each agent: [A] lengths, NaN as for `ade`."""
    return _sample_ade(forecast, truth, k).min(axis=1)


def min_fde(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """FDE of the best of the first k samples, chosen for each agent and for FDE alone: [A] lengths."""
    return _sample_fde(forecast, truth, k).min(axis=1)


def joint_ade(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """ADE under the best of the first k samples of the whole scene.

    The sample of a scene has the smallest sum of ADE over the scene's agents; agents without a known step are left out
    of the sum. With all steps known, the mean over agents is the number that the paper's released program reports.

    Returns:
        [A] float64, lengths: the ADE of each agent under the sample of its scene; NaN as for `ade`.
    """
    return _under_best_of_scene(_sample_ade(forecast, truth, k), truth)


def joint_fde(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """FDE under the best sample of the scene, chosen as in `joint_ade` but for FDE alone: [A] lengths."""
    return _under_best_of_scene(_sample_fde(forecast, truth, k), truth)


def miss_rate_2m(forecast: Forecast, truth: Truth, k: int = 1) -> np.ndarray:
    """1 if the error at the last step is more than 2 m, else 0: [A], NaN if the last step is not known.

    k = 1 scores the most likely sample, k > 1 the best of the first k samples.
    """
    error = fde(forecast, truth) if k == 1 else min_fde(forecast, truth, k)
    return np.where(np.isnan(error), np.nan, error > MISS_DISTANCE)


def collision_rate(forecast: Forecast, truth: Truth) -> np.ndarray:
    """1 if the forecast of an agent is within 0.2 m of the forecast of another agent of its scene, else 0.

    The distance is between the centres of the most likely samples, at any of the 12 steps. This is Col-I of TrajNet++
    (Kothari et al., 2021) with its person radius of 0.1 m, but for every agent instead of a primary agent, and without
    the half-way points that TrajNet++ adds between steps. Steps after an agent left count, too.

    Returns:
        [A] float64, 0 or 1; 0 for an agent that is alone in its scene.
    """
    track = _checked(forecast, truth).most_likely().astype(np.float64)
    scene = truth.observation.scene
    hit = np.zeros(len(track))
    # Agent i is paired with the later agents of its scene; pairs are numbered by i and made when needed.
    partners = np.repeat(scene[1:], np.diff(scene)) - np.arange(len(track)) - 1
    start = np.concatenate([[0], np.cumsum(partners)])
    for lowest in range(0, int(start[-1]), PAIRS_AT_ONCE):
        pair = np.arange(lowest, min(lowest + PAIRS_AT_ONCE, int(start[-1])))
        one = np.searchsorted(start, pair, side="right") - 1
        other = one + 1 + pair - start[one]
        close = (distance(track[one] - track[other]) < COLLISION_DISTANCE).any(axis=1)
        hit[one[close]] = 1.0
        hit[other[close]] = 1.0
    return hit


def kde_nll(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """Negative log density of the truth under a Gaussian kernel estimate over the first k samples.

    At each step the kernels have the (weighted) covariance of the samples times the square of Scott's factor,
    n^(-1/6) for n samples in the plane, as in ``scipy.stats.gaussian_kde``. A covariance whose smaller
    eigenvalue would be under ``KERNEL_WIDTH`` squared gets the missing part added in all directions. The log
    density of a step is clipped from below at -20 (Trajectron++, Salzmann et al., ECCV 2020), then averaged
    over known steps.

    An agent with equal samples, or with all weight on one sample, counts as well; its kernels are ``KERNEL_WIDTH``
    wide.

    Returns:
        [A] float64, nats for a density per m^2. NaN without a known step. NaN for all agents where the forecast is no
        density: with fewer than 3 samples, or if the samples of every agent are equal (to a micrometre at every step).

    Raises:
        PredictorError: The weights of an agent are all 0.
    """
    samples = _samples(forecast, truth, k)
    if samples.shape[1] < 3:
        return np.full(len(samples), np.nan)
    weights = _normalised_weights(forecast, samples.shape[1])
    with np.errstate(divide="ignore"):
        log_weights = np.log(weights)
    concentration = (weights**2).sum(axis=1)
    # The covariance of samples in one point is 0 times infinity; the kernel width then replaces it.
    unbiased = 1.0 / np.maximum(1.0 - concentration, 1e-12)
    known = truth.known
    loss = np.empty(known.shape)
    spread = np.zeros(len(known))
    for step in range(FUTURE):
        x, y = (samples[:, :, step, axis].astype(np.float64) for axis in (0, 1))
        spread = np.maximum(spread, np.maximum(np.ptp(x, axis=1), np.ptp(y, axis=1)))
        dx, dy = (values - (weights * values).sum(axis=1, keepdims=True) for values in (x, y))
        xx, xy, yy = (unbiased * (weights * a * b).sum(axis=1) for a, b in ((dx, dx), (dx, dy), (dy, dy)))
        scott = np.cbrt(concentration)
        ex, ey = (truth.future[:, None, step, axis] - values for axis, values in ((0, x), (1, y)))
        density = _log_density(ex, ey, log_weights, scott * xx, scott * xy, scott * yy)
        loss[:, step] = -np.maximum(density, LOG_DENSITY_BOUND)
    return mean_over_known(loss, known) if (spread > 1e-6).any() else np.full(len(known), np.nan)


@dataclass(frozen=True)
class Metric:
    """A row of the table of metrics.

    Attributes:
        name: Usual name; ``{k}`` stands for the number of samples.
        function: ``function(forecast, truth)``, or ``function(forecast, truth, k)`` if it needs samples.
        unit: Unit of its values; ``m`` stands for the unit of the domain.
        needs_samples: Whether it scores k samples; such metrics are reported for k > 1 only.
        description: One sentence.
        needs_metres: Whether it has a threshold in metres; such metrics are reported for domains in metres only.
        lower_is_better: Whether smaller values are better.
    """

    name: str
    function: Callable[..., np.ndarray]
    unit: str
    needs_samples: bool
    description: str
    needs_metres: bool = False
    lower_is_better: bool = True

    def __call__(self, forecast: Forecast, truth: Truth, k: int = 1) -> np.ndarray:
        """One value per agent: [A] float64."""
        return self.function(forecast, truth, k) if self.needs_samples else self.function(forecast, truth)


METRICS = (
    Metric("ADE", ade, "m", False, "Mean displacement error, most likely sample."),
    Metric("FDE", fde, "m", False, "Displacement error at the last step, most likely sample."),
    Metric("MR_2m", miss_rate_2m, "1", False, "Share missed by more than 2 m at the end, most likely sample.", True),
    Metric("collision_0.2m", collision_rate, "1", False, "Share whose forecast hits another agent's forecast.", True),
    Metric("minADE_{k}", min_ade, "m", True, "ADE of the best of {k} samples of each agent."),
    Metric("minFDE_{k}", min_fde, "m", True, "FDE of the best of {k} samples of each agent."),
    Metric("JADE_{k}", joint_ade, "m", True, "ADE under the best of {k} samples of the whole scene."),
    Metric("JFDE_{k}", joint_fde, "m", True, "FDE under the best of {k} samples of the whole scene."),
    Metric("MR_2m_{k}", miss_rate_2m, "1", True, "Share missed by more than 2 m by all of {k} samples.", True),
    Metric("KDE_NLL_{k}", kde_nll, "nat", True, "Negative log density of a kernel estimate over {k} samples.", True),
)
"""Every metric; a new one is a function and a row here."""


def metric_rows(k: int, unit: str = "m") -> list[Metric]:
    """The metrics to report for k samples on a domain of a unit: names, descriptions and units filled in."""
    _check_k(k)
    rows = [m for m in METRICS if (k > 1 or not m.needs_samples) and (unit == "m" or not m.needs_metres)]
    return [
        replace(
            row,
            name=row.name.format(k=k),
            description=row.description.format(k=k),
            unit=unit if row.unit == "m" else row.unit,
        )
        for row in rows
    ]


def score(forecast: Forecast, truth: Truth, k: int = 1, unit: str = "m") -> dict[str, np.ndarray]:
    """Every metric to report for k samples, by name: each [A] float64, NaN where it is not defined.

    Args:
        forecast: A agents with at least k samples, or with a single sample that stands for all.
        truth: Ground truth of the same agents, in the same order.
        k: Number of samples that are scored.
        unit: Unit of the positions, as in the domain's card.

    Raises:
        PredictorError: The forecast has the wrong shape, fewer than k samples, or impossible values.
        DataError: The truth is not valid.
    """
    checked = _checked(forecast, truth)
    return {metric.name: metric(checked, truth, k) for metric in metric_rows(k, unit)}


@dataclass(frozen=True, eq=False)
class _Checked(Forecast):
    """A forecast that was checked against its truth; ``score`` checks a forecast once for all metrics."""

    error: np.ndarray = field(kw_only=True)
    """[A, 12] displacement error of the most likely sample."""


def _checked(forecast: Forecast, truth: Truth) -> _Checked:
    if isinstance(forecast, _Checked):
        return forecast
    check_truth(truth, "The truth")
    plain = check_forecast(forecast, truth.observation, None, "The predictor")
    error = distance(plain.most_likely().astype(np.float64) - truth.future)
    return _Checked(plain.positions, plain.weights, error=error)


def distance(difference: np.ndarray) -> np.ndarray:
    """Euclidean length along the last axis."""
    return np.sqrt(np.einsum("...i,...i->...", difference, difference))


def mean_over_known(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Mean of [..., 12] values over the known steps: [...], NaN where none is known."""
    count = known.sum(axis=-1)
    total = np.where(known, values, 0.0).sum(axis=-1)
    return np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)


def _samples(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """The first k samples, or the only one: [A, k or 1, 12, 2]."""
    _check_k(k)
    positions = _checked(forecast, truth).positions
    samples = positions.shape[1]
    if 1 < samples < k:
        raise PredictorError(
            f"The forecast has {samples} samples, but k = {k} are to be scored. Predict with samples={k}, "
            f"score with k <= {samples}, or give a single sample if the predictor is deterministic."
        )
    return positions[:, :k]


def _sample_ade(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """ADE of each sample: [A, k or 1]."""
    samples = _samples(forecast, truth, k)
    known = truth.known
    # One sample at a time: all of them at once in float64 would be the largest array of an evaluation.
    errors = (distance(samples[:, i].astype(np.float64) - truth.future) for i in range(samples.shape[1]))
    return np.stack([mean_over_known(error, known) for error in errors], axis=1)


def _sample_fde(forecast: Forecast, truth: Truth, k: int) -> np.ndarray:
    """FDE of each sample: [A, k or 1]."""
    last = _samples(forecast, truth, k)[:, :, -1].astype(np.float64)
    return np.where(truth.known[:, -1:], distance(last - truth.future[:, None, -1]), np.nan)


def _under_best_of_scene(error: np.ndarray, truth: Truth) -> np.ndarray:
    """The [A] errors under the sample with the smallest sum of [A, K] errors over each scene."""
    scene = truth.observation.scene
    if not len(error):
        return np.empty(0)
    total = np.add.reduceat(np.where(np.isnan(error), 0.0, error), scene[:-1], axis=0)
    best = np.repeat(total.argmin(axis=1), np.diff(scene))
    return error[np.arange(len(error)), best]


def _normalised_weights(forecast: Forecast, samples: int) -> np.ndarray:
    """Weights of the first samples, summing to 1: [A, samples] float64."""
    if forecast.weights is None:
        return np.full((len(forecast.positions), samples), 1.0 / samples)
    weights = np.asarray(forecast.weights, dtype=np.float64)[:, :samples]
    total = weights.sum(axis=1, keepdims=True)
    if not (total > 0).all():
        row = int(np.argmin(total[:, 0] > 0))
        raise PredictorError(
            f"The weights of row {row} are 0 for the first {samples} samples: a forecast needs a sample of positive "
            "weight for every agent; leave the weights out if all samples are equally likely."
        )
    return weights / total


def _log_density(
    ex: np.ndarray, ey: np.ndarray, log_weights: np.ndarray, xx: np.ndarray, xy: np.ndarray, yy: np.ndarray
) -> np.ndarray:
    """Log density [A] of K Gaussians of one covariance, at offsets ex, ey [A, K] from their centres."""
    middle, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    ridge = np.maximum(KERNEL_WIDTH**2 - (middle - radius), 0.0)
    # The product of eigenvalues stays positive where xx * yy - xy^2 would be lost to rounding.
    determinant = (middle + radius + ridge) * np.maximum(middle - radius, KERNEL_WIDTH**2)
    a, b, c = ((part / determinant)[:, None] for part in (yy + ridge, xy, xx + ridge))
    exponent = log_weights - np.maximum(a * ex * ex - 2 * b * ex * ey + c * ey * ey, 0.0) / 2
    highest = exponent.max(axis=1, keepdims=True)
    total = np.log(np.exp(exponent - highest).sum(axis=1)) + highest[:, 0]
    return total - np.log(2 * np.pi) - np.log(determinant) / 2


def _check_k(k: int) -> None:
    if k < 1:
        raise SpecError(f"k is {k!r}; the number of samples must be 1 or more.")
