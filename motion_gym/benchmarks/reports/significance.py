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
    from scipy.stats import ttest_1samp  # takes a second to import

    return float(ttest_1samp(differences, 0).pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values of several tests, corrected for their number (Holm, Scandinavian Journal of Statistics 6, 1979)."""
    order = np.argsort(p_values)
    raised = np.maximum.accumulate(np.array(p_values)[order] * np.arange(len(p_values), 0, -1))
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(raised, 1)
    return corrected.tolist()  # type: ignore[no-any-return]
