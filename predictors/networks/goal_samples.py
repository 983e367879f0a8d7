"""Test-time sampling of goals: goals that are spread over a heat map by weighted k-means."""

from __future__ import annotations

import numpy as np

from motion_gym.predictors.networks.scene_noise import mixed

ROUNDS = 6
"""Rounds of k-means."""
MOST_CELLS = 256
"""Cells of the highest probability, which k-means divides among the goals."""


def spread_goals(logits: np.ndarray, keys: np.ndarray) -> np.ndarray:
    """Goals that are spread over maps: the centers of K clusters of cells, weighted by their probabilities.

    The first centers are cells drawn from the map, so that the goals depend on the seed.

    Args:
        logits: [A, cells, cells] float64, rows along y.
        keys: [A, K] uint64, a random key for each goal.

    Returns:
        [A, K, 2] goals in coordinates of the crops.
    """
    agents, cells = logits.shape[:2]
    flat = logits.reshape(agents, -1)
    shares = np.exp(flat - flat.max(axis=1, keepdims=True))
    below = shares.cumsum(axis=1)
    drawn = (mixed(keys) >> np.uint64(11)) * 2.0**-53 * below[:, -1:]
    first = np.stack([np.searchsorted(row, values) for row, values in zip(below, drawn, strict=True)])
    goals = _centers(first.reshape(keys.shape), cells)
    most = min(MOST_CELLS, flat.shape[1])
    likely = np.sort(np.argpartition(-flat, most - 1, axis=1)[:, :most], axis=1)
    places, weight = _centers(likely, cells), np.take_along_axis(shares, likely, axis=1)
    for _ in range(ROUNDS):
        distance = ((places[:, :, None] - goals[:, None]) ** 2).sum(axis=-1)
        member = (distance.argmin(axis=2)[..., None] == np.arange(keys.shape[1])) * weight[..., None]
        total = member.sum(axis=1)[..., None]
        means = member.transpose(0, 2, 1) @ places / np.where(total > 0, total, 1)
        goals = np.where(total > 0, means, goals)
    return goals


def _centers(number: np.ndarray, cells: int) -> np.ndarray:
    """Centers [..., 2] of cells, numbered row by row, in coordinates of the crops."""
    return (np.stack([number % cells, number // cells], axis=-1) + 0.5) * (2 / cells) - 1
