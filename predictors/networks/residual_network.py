"""The network of ``kalman_residual``, for several models at once: what a bank of Kalman filters leaves to be learned.

Weights are a dict of tensors with a leading model axis M; ``shapes`` gives their shapes. Neighbours are pooled by their
sum and maximum, so the network takes any number of them in any order.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from motion_gym.contract import FUTURE
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.filter_features import OTHER, OWN
from motion_gym.predictors.networks.pair_network import layers
from motion_gym.training.program import Weights

WIDTH, POOLED = 192, 32
"""Units of the hidden layers, and of the layers that read a neighbour."""
LAYERS: dict[str, tuple[tuple[int, int], ...]] = {
    "neighbour": ((OTHER, POOLED), (POOLED, POOLED)),
    "residual": ((OWN + 2 * POOLED, WIDTH), (WIDTH, WIDTH), (WIDTH, 2 * FUTURE)),
    "spread": ((WIDTH, 2 * FUTURE),),
}
"""Inputs and outputs of each layer of each part."""
FIRST_SPREAD = 0.3
"""Metres: standard deviation of the forecast of an untrained network."""


def shapes() -> dict[str, tuple[int, ...]]:
    """Shape of every weight, without the model axis."""
    return {"inputs.mean": (OWN,), "inputs.scale": (OWN,), "correlation.factor": (2, FUTURE, FUTURE)} | (
        pair_network.shapes(LAYERS)
    )


def initial(own: Tensor, seed: int) -> Weights:
    """Initial weights of one model, M = 1: the forecast of the filters.

    Args:
        own: [A, OWN] inputs of the training set, for standardisation.
        seed: Seed of all random values.
    """
    weights = pair_network.initial(seed, pair_network.shapes(LAYERS))
    for name in ("residual.weight3", "residual.bias3", "spread.weight1", "spread.bias1"):
        weights[name] = torch.zeros_like(weights[name])
    weights["spread.bias1"] += math.log(FIRST_SPREAD)
    weights["inputs.mean"], weights["inputs.scale"] = own.mean(dim=0)[None], own.std(dim=0)[None] + 1e-3
    weights["correlation.factor"] = torch.eye(FUTURE).expand(1, 2, -1, -1).clone()
    return weights


def hidden(own: Tensor, others: Tensor, there: Tensor, weights: Weights) -> Tensor:
    """Inputs [M, A, 192] of the last layers.

    Args:
        own: [A, OWN] inputs of agents.
        others: [A, 6, OTHER] inputs of their neighbours.
        there: [A, 6] 1 where there is a neighbour.
        weights: Weights of M models.
    """
    models = len(weights["inputs.mean"])
    each = layers(others.flatten(0, 1).expand(models, -1, -1), weights, "neighbour", 1, 2).relu()
    each = each.unflatten(1, others.shape[:2]) * there[..., None]
    scaled = (own - weights["inputs.mean"][:, None]) / weights["inputs.scale"][:, None]
    return layers(torch.cat([scaled, each.sum(dim=2), each.amax(dim=2)], dim=-1), weights, "residual", 1, 2).relu()


def residual(own: Tensor, others: Tensor, there: Tensor, weights: Weights) -> tuple[Tensor, Tensor]:
    """Offsets from the forecast of the filters, and the logarithm of their standard deviations; see ``hidden``.

    The standard deviations do not train the layers that they share with the offsets.

    Returns:
        Two tensors [M, A, 12, 2]: metres along and to the left, and log metres.
    """
    inner = hidden(own, others, there, weights)
    offsets = pair_network.layer(inner, weights, "residual", 3)
    spread = pair_network.layer(inner.detach(), weights, "spread", 1)
    return offsets.unflatten(-1, (FUTURE, 2)), spread.unflatten(-1, (FUTURE, 2))
