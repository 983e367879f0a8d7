"""Tests of differences between rows over pairs of seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def paired_p(differences: np.ndarray) -> float:
    """Two-sided p-value of Student's t-test that paired differences [N >= 2] have the mean 0.

    Differences that are all the same have no spread to test against: p is 1 if they are 0, else 0.
    """
    if np.ptp(differences) == 0:
        return 1.0 if differences[0] == 0 else 0.0
    from scipy.special import stdtr  # scipy.stats takes a second to import

    error = differences.std(ddof=1) / len(differences) ** 0.5
    return float(2 * stdtr(len(differences) - 1, -abs(differences.mean() / error)))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values of several tests, corrected for their number (Holm, Scandinavian Journal of Statistics 6, 1979)."""
    order = np.argsort(p_values)
    raised = np.maximum.accumulate(np.array(p_values)[order] * np.arange(len(p_values), 0, -1))
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(raised, 1)
    return corrected.tolist()  # type: ignore[no-any-return]
