"""Coverage of the regions that samples of a forecast span: how often the ground truth lies inside."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import Forecast, SpecError, Truth

LEAST = 20
"""Fewest samples from which the quantiles of a region are taken."""


def inside(forecast: Forecast, truth: Truth, step: int, share: float) -> np.ndarray:
    """Whether the ground truth of a step lies in the central region that holds a share of the samples.

    The distance of a position from the mean of an agent's samples is taken in units of their covariance (Mahalanobis).
    The region holds the positions that are no farther than this share of the samples are, so that it holds the share
    exactly for an elliptical distribution, and no distribution is assumed.

    Args:
        forecast: Samples, at least 20 for each agent, equally weighted.
        truth: Ground truth.
        step: Future step, 1 to 12.
        share: Share of the samples, between 0 and 1.

    Returns:
        [A] float64: 1 where the truth lies inside, 0 where not, NaN where it is not known.

    Raises:
        SpecError: there are fewer samples, or the share is not between 0 and 1.
    """
    positions = forecast.positions[:, :, step - 1].astype(np.float64)
    if positions.shape[1] < LEAST:
        raise SpecError(f"The forecast has {positions.shape[1]} samples: coverage needs at least {LEAST}, as k=200.")
    if not 0 < share < 1:
        raise SpecError(f"`share={share}` must lie between 0 and 1.")
    centered = positions - positions.mean(axis=1, keepdims=True)
    covariance = np.einsum("aki,akj->aij", centered, centered) / positions.shape[1]
    covariance += 1e-12 * np.eye(2)
    precision = np.linalg.inv(covariance)
    off = truth.future[:, step - 1].astype(np.float64) - positions.mean(axis=1)
    of_samples = np.einsum("aki,aij,akj->ak", centered, precision, centered)
    of_truth = np.einsum("ai,aij,aj->a", off, precision, off)
    covered = (of_truth <= np.quantile(of_samples, share, axis=1)).astype(np.float64)
    return np.where(truth.known[:, step - 1], covered, np.nan)
