"""The network of STGAT with a style: a style encoder for any number of agents, and a modulator.

The parts are those of the paper's two-agent network with another backbone: z' = f(z, c) + z, where z is the last states
of both encoders. The style of a scene is the mean code of its pairs of neighbours.
"""

from __future__ import annotations

import torch
from torch import Tensor

from motion_gym.contract import WINDOW
from motion_gym.predictors.networks import pair_network, stgat_network
from motion_gym.predictors.networks.graph_attention import Layout
from motion_gym.predictors.networks.pair_network import CODE, layers
from motion_gym.predictors.networks.stgat_network import GRAPH, TRAJECTORY, Draws
from motion_gym.training.program import Weights

LATENT = TRAJECTORY + GRAPH
LAYERS: dict[str, tuple[tuple[int, int], ...]] = {
    "style": ((WINDOW * 2, 32), (32, 32), (32, CODE)),
    "modulator": ((LATENT + CODE, LATENT), (LATENT, LATENT)),
    "head": ((CODE, CODE), (CODE, CODE)),
}
"""Inputs and outputs of each layer of each part."""


def shapes() -> dict[str, tuple[int, ...]]:
    """Shape of every weight beside those of STGAT, without the model axis."""
    return pair_network.shapes(LAYERS)


def initial(features: int, seed: int) -> Weights:
    """Initial weights of one model, M = 1; the last layer of the modulator is zero."""
    weights = {**stgat_network.initial(features, seed), **pair_network.initial(seed, shapes())}
    last = len(LAYERS["modulator"])
    for name in (f"modulator.weight{last}", f"modulator.bias{last}"):
        weights[name] = torch.zeros_like(weights[name])
    return weights


def scene_codes(paths: Tensor, scene: Tensor, scenes: int, weights: Weights) -> Tensor:
    """Style code [M, S, 8] of each scene: the mean over its pairs, or zero without pairs.

    Args:
        paths: [P, 40] relative paths of ``NeighbourPairs.paths``.
        scene: [P] scene of each pair.
        scenes: Number of scenes S.
        weights: Weights of M models.
    """
    models = len(weights["style.bias1"])
    codes = layers(paths.expand(models, -1, -1), weights, "style", 1, len(LAYERS["style"]))
    count = torch.bincount(scene, minlength=scenes).clamp(min=1)
    total = codes.new_zeros(models, scenes, CODE).index_add(1, scene, codes)
    return total / count[:, None]


def forecast(steps: Tensor, draws: Draws, layout: Layout, codes: Tensor, weights: Weights) -> Tensor:
    """Forecast displacements [12, M, A, 2] in the style of codes [M, A or 1, 8]."""
    latent = modulate(stgat_network.encode(steps, draws, layout, weights), codes, weights)
    return stgat_network.decode(latent, steps[-1, :, :2], draws.noise, weights)


def modulate(latent: Tensor, codes: Tensor, weights: Weights) -> Tensor:
    """Add the modulator's output for codes [M, A or 1, 8] to a latent [M, A, 64]."""
    joined = torch.cat([latent, codes.expand(len(latent), latent.shape[1], -1)], dim=-1)
    return latent + layers(joined, weights, "modulator", 1, len(LAYERS["modulator"]))
