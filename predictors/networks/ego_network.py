"""The networks of the ego-frame predictors, for several models at once; weights have a leading model axis M.

``without_style`` and ``in_style`` compute one term per neighbour and sum the terms, so they take any number of
neighbours, in any order. Their outputs are offsets [M, A, 24] from the undisturbed course, metres, along the course and
to its left.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from motion_gym.contract import FUTURE, HISTORY, WINDOW
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.ego_features import BEFORE, DURING, FREE, Scenes
from motion_gym.predictors.networks.pair_network import layers
from motion_gym.training.program import Weights

WIDTH = 128
DOUBT = 0.1
"""Metres: deviations of the observed steps below this are damped."""
TERMS = 3
"""Coefficients of the polynomial in the distance; three distances in training determine a quadratic one."""
LAYERS: dict[str, tuple[tuple[int, int], ...]] = {
    "plain": ((BEFORE + DURING, WIDTH), (WIDTH, WIDTH), (WIDTH, WIDTH), (WIDTH, 2 * FUTURE)),
    "manoeuvre": ((BEFORE, WIDTH), (WIDTH, WIDTH), (WIDTH, WIDTH), (WIDTH, TERMS * 2 * (WINDOW - FREE))),
}
"""Inputs and outputs of each layer of each network."""
GAINS = {"plain": "plain", "manoeuvre": "correction"}
"""Name of the linear gain from deviations to offsets that belongs to each network."""


def shapes(networks: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Shape of every weight, without the model axis."""
    result: dict[str, tuple[int, ...]] = {}
    for name in networks:
        result[f"inputs.{name}_mean"] = result[f"inputs.{name}_scale"] = LAYERS[name][0][:1]
        result |= pair_network.shapes({name: LAYERS[name]})
        result[f"{GAINS[name]}.gain"] = (2 * HISTORY, 2 * FUTURE)
    return result | ({"inputs.distance": (1,)} if "manoeuvre" in networks else {})


def initial(networks: tuple[str, ...], inputs: dict[str, Tensor], distance: Tensor, seed: int) -> Weights:
    """Initial weights of one model, M = 1.

    Layers are drawn by He's rule, the last one smaller; gains are constant velocity.

    Args:
        networks: Names of the networks.
        inputs: Training inputs [..., F] of each network, for standardisation.
        distance: Mean distance that agents keep in training, metres: the unit of the polynomial.
        seed: Seed of all random values.
    """
    generator = torch.Generator().manual_seed(seed)
    weights: Weights = {}
    for name in networks:
        flat = inputs[name].flatten(0, -2)
        weights[f"inputs.{name}_mean"], weights[f"inputs.{name}_scale"] = flat.mean(dim=0), flat.std(dim=0) + 0.02
        for number, (fan_in, out) in enumerate(LAYERS[name], 1):
            spread = 0.1 / math.sqrt(fan_in) if number == len(LAYERS[name]) else math.sqrt(2 / fan_in)
            weights[f"{name}.weight{number}"] = torch.randn(fan_in, out, generator=generator) * spread
            weights[f"{name}.bias{number}"] = torch.zeros(out)
        weights[f"{GAINS[name]}.gain"] = _constant_velocity()
    if "manoeuvre" in networks:
        weights["inputs.distance"] = distance[None]
    return {name: value[None] for name, value in weights.items()}


def without_style(scenes: Scenes, weights: Weights) -> Tensor:
    """Offsets [M, A, 24] without a style."""
    pairs = torch.cat([scenes.before, scenes.during], dim=-1)
    terms = _by_pair(pairs, weights, "plain") * torch.exp(-scenes.miss)[..., None, None]
    return torch.bmm(scenes.deviation, weights["plain.gain"]) + _summed(terms, scenes.side)


def in_style(scenes: Scenes, distance: Tensor, weights: Weights) -> tuple[Tensor, Tensor]:
    """Offsets of agents who keep a distance from each other.

    The term of a neighbour is the manoeuvre: the intrusion, max(0, distance - miss), times a quadratic function of the
    distance, whose coefficients depend only on the undisturbed courses. It therefore extrapolates to distances outside
    the training range. A linear gain of the observed deviation from the manoeuvre corrects the sum.

    Args:
        scenes: Agents [M, A, ...].
        distance: [M, A] metres.
        weights: Weights of M models.

    Returns:
        Offsets [M, A, 32] of the manoeuvre at the 16 steps that do not define the course, and corrected offsets
        [M, A, 24] at the future steps.
    """
    constant, slope, curvature = _by_pair(scenes.before, weights, "manoeuvre").chunk(TERMS, dim=-2)
    kept = distance[..., None].expand_as(scenes.miss)
    intrusion = torch.relu(kept - scenes.miss)[..., None, None]
    ratio = (distance / weights["inputs.distance"])[..., None, None, None]
    offsets = _summed(intrusion * (constant + ratio * (slope + ratio * curvature)), scenes.side)
    seen = 2 * (HISTORY - FREE)
    # The correction does not train the manoeuvre.
    fixed = offsets.detach()
    beyond = torch.cat(
        [scenes.deviation[..., : 2 * FREE], scenes.deviation[..., 2 * FREE :] - fixed[..., :seen]], dim=-1
    )
    size = (beyond**2).sum(dim=-1, keepdim=True)
    gained = torch.bmm(beyond * (size / (size + DOUBT**2)), weights["correction.gain"])
    return offsets, fixed[..., seen:] + gained


def distance_error(offsets: Tensor, target: Tensor) -> Tensor:
    """Mean Euclidean distance [M] of offsets [M, A, 2 T], metres."""
    return ((offsets - target).unflatten(-1, (-1, 2)) ** 2).sum(dim=-1).add(1e-10).sqrt().mean(dim=(1, 2))


def _by_pair(pairs: Tensor, weights: Weights, name: str) -> Tensor:
    """Terms [M, A, N, T, 2] for inputs [M, A, N, F]."""
    x = (pairs.flatten(1, 2) - weights[f"inputs.{name}_mean"][:, None]) / weights[f"inputs.{name}_scale"][:, None]
    return layers(x, weights, name, 1, len(LAYERS[name])).view(*pairs.shape[:3], -1, 2)


def _summed(terms: Tensor, side: Tensor) -> Tensor:
    """Sum over neighbours of terms [M, A, N, T, 2], with mirrored pairs mirrored back: [M, A, 2 T]."""
    return (terms * torch.stack([side.abs(), side], dim=-1)[..., None, :]).sum(dim=2).flatten(-2)


def _constant_velocity() -> Tensor:
    """Gain [16, 24] that continues from the last observed position at the last observed velocity."""
    gain = torch.zeros(HISTORY, 2, FUTURE, 2)
    ahead = torch.arange(1.0, FUTURE + 1)
    for axis in range(2):
        gain[-1, axis, :, axis], gain[-2, axis, :, axis] = 1 + ahead, -ahead
    return gain.reshape(2 * HISTORY, 2 * FUTURE)
