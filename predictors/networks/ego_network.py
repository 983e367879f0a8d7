"""The networks of the ego-frame predictors, for several models at once; weights have a leading axis M.

``without_style`` and ``in_style`` answer for each neighbour on its own and add the answers up, so that any number of
neighbours, in any order, will do. What they give are offsets [M, A, 24] from the undisturbed course, metres, along it
and to its left.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from motion_gym.contract import FUTURE, HISTORY, WINDOW
from motion_gym.predictors.networks.ego_features import BEFORE, DURING, FREE, Scenes
from motion_gym.predictors.networks.pair_network import layers, shapes_of
from motion_gym.training.program import Weights

WIDTH = 128
DOUBT = 0.1
"""Metres: a deviation of the observed steps counts fully only if it is well above this."""
LAYERS: dict[str, tuple[tuple[int, int], ...]] = {
    "plain": ((BEFORE + DURING, WIDTH), (WIDTH, WIDTH), (WIDTH, WIDTH), (WIDTH, 2 * FUTURE)),
    "manoeuvre": ((BEFORE, WIDTH), (WIDTH, WIDTH), (WIDTH, WIDTH), (WIDTH, 2 * 2 * (WINDOW - FREE))),
}
"""Inputs and outputs of each layer of each network."""
GAINS = {"plain": "plain", "manoeuvre": "correction"}
"""The linear gain from deviations to offsets that stands beside each network."""


def shapes(networks: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Shape of every weight, without the axis M."""
    result: dict[str, tuple[int, ...]] = {}
    for name in networks:
        result[f"inputs.{name}_mean"] = result[f"inputs.{name}_scale"] = LAYERS[name][0][:1]
        result |= shapes_of({name: LAYERS[name]})
        result[f"{GAINS[name]}.gain"] = (2 * HISTORY, 2 * FUTURE)
    return result


def initial(networks: tuple[str, ...], inputs: dict[str, Tensor], seed: int) -> Weights:
    """Weights of one model, M = 1: layers by He's rule, the last one a tenth of it; gains that are constant velocity.

    Args:
        networks: Which.
        inputs: Inputs [..., F] of each network, to be standardised by.
        seed: Source of all randomness.
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
    return {name: value[None] for name, value in weights.items()}


def without_style(scenes: Scenes, weights: Weights) -> Tensor:
    """Offsets [M, A, 24] from what is observed alone."""
    pairs = torch.cat([scenes.before, scenes.during], dim=-1)
    answers = _by_pair(pairs, weights, "plain") * torch.exp(-scenes.miss)[..., None, None]
    return torch.bmm(scenes.deviation, weights["plain.gain"]) + _added(answers, scenes.side)


def in_style(scenes: Scenes, distance: Tensor, weights: Weights) -> tuple[Tensor, Tensor]:
    """Of agents who keep a distance: how they leave their undisturbed courses.

    Each answer is the intrusion, max(0, distance - miss), times what is affine in the distance; the network that gives
    it sees undisturbed courses alone. So it extrapolates to distances that it was not trained with. What the observed
    steps show beyond it corrects it by a linear gain.

    Args:
        scenes: Agents [M, A, ...].
        distance: [M, A] metres.
        weights: Of M models.

    Returns:
        [M, A, 32] offsets by the manoeuvre alone at the 16 steps after the free ones, and corrected [M, A, 24].
    """
    alone = _by_pair(scenes.before, weights, "manoeuvre")
    constant, slope = alone.chunk(2, dim=-2)
    reach = distance[..., None].expand_as(scenes.miss)
    intrusion = torch.relu(reach - scenes.miss)[..., None, None]
    offsets = _added(intrusion * (constant + reach[..., None, None] * slope), scenes.side)
    seen = 2 * (HISTORY - FREE)
    # The manoeuvre is not trained through the correction.
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
    """Answers [M, A, N, T, 2] to inputs [M, A, N, F]."""
    x = (pairs.flatten(1, 2) - weights[f"inputs.{name}_mean"][:, None]) / weights[f"inputs.{name}_scale"][:, None]
    return layers(x, weights, name, 1, len(LAYERS[name])).view(*pairs.shape[:3], -1, 2)


def _added(answers: Tensor, side: Tensor) -> Tensor:
    """Sum over neighbours of [M, A, N, T, 2], each turned out of its mirror: [M, A, 2 T]."""
    return (answers * torch.stack([side.abs(), side], dim=-1)[..., None, :]).sum(dim=2).flatten(-2)


def _constant_velocity() -> Tensor:
    """Gain [16, 24] that goes on from the last observed position at the last observed velocity."""
    gain = torch.zeros(HISTORY, 2, FUTURE, 2)
    ahead = torch.arange(1.0, FUTURE + 1)
    for axis in range(2):
        gain[-1, axis, :, axis], gain[-2, axis, :, axis] = 1 + ahead, -ahead
    return gain.reshape(2 * HISTORY, 2 * FUTURE)
