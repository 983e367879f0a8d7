"""The U-Net of the ``heatmap`` predictor, for several models at once; weights have a leading model axis M.

An encoder reads the maps of the history and of the ground. One decoder gives the map of the goal, the last future
step; another one gives the maps of all future steps, given a goal. A linear layer adds an offset to each future step.
After Mangalam et al., "From goals, waypoints & paths to long term human trajectory forecasting" (ICCV 2021), with crops
around the agent in place of whole scenes. Two sorts of adapters change nothing until they are tuned: a modulator after
each level of the encoder (Liu et al., CVPR 2022), and low-rank matrices added to the weights of the layers of the
encoder (Kothari et al., CoRL 2022).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from motion_gym.contract import FUTURE, HISTORY
from motion_gym.predictors.networks.ego_crops import COARSE, LABELS, gaussians, mean_place, one_hot
from motion_gym.training.program import Weights

LEVELS = (24, 48, 64, 64)
"""Channels of the encoder at 32, 16, 8 and 4 cells along each side."""
FIRST = 16
RANK = 2
"""Rank of a low-rank adapter."""
HIDDEN = 64
"""Inputs of the last layer."""
ENCODER = (
    (HISTORY, FIRST, 5),
    (FIRST + LABELS, LEVELS[0], 3),
    (LEVELS[0], LEVELS[1], 3),
    (LEVELS[1], LEVELS[1], 3),
    (LEVELS[1], LEVELS[2], 3),
    (LEVELS[2], LEVELS[3], 3),
)
"""Input channels, output channels and kernel size of each layer."""
DECODER = (64, 48, 32, 16)
"""Channels of a decoder at 4, 8, 16 and 32 cells along each side."""


def _decoder(goals: int, maps: int) -> tuple[tuple[int, int, int], ...]:
    below = (0, *DECODER[:-1])
    sizes = [(below[i] + LEVELS[-1 - i] + goals, out, 3) for i, out in enumerate(DECODER)]
    return (*sizes, (DECODER[-1], maps, 1))


LAYERS = {"encoder": ENCODER, "goal": _decoder(0, 4), "path": _decoder(1, FUTURE)}
"""Layers of each part. The four maps of the goal are one map with twice as many cells along each side."""


def shapes() -> dict[str, tuple[int, ...]]:
    """Shape of every weight, without the model axis."""
    result: dict[str, tuple[int, ...]] = {}
    for part, sizes in LAYERS.items():
        for number, (inputs, outputs, size) in enumerate(sizes, 1):
            result[f"{part}.weight{number}"] = (outputs, inputs, size, size)
            result[f"{part}.bias{number}"] = (outputs,)
    result |= {"summary.weight1": (LEVELS[-1] + 2 * HISTORY, HIDDEN), "summary.bias1": (HIDDEN,)}
    result |= {"offset.weight1": (HIDDEN, 2 * FUTURE), "offset.bias1": (2 * FUTURE,)}
    for number, channels in enumerate(LEVELS, 1):
        result[f"modulator.weight{number}"] = (channels, channels, 1, 1)
        result[f"modulator.bias{number}"] = (channels,)
    for number, (inputs, outputs, size) in enumerate(ENCODER, 1):
        result[f"low_rank.down{number}"] = (RANK, inputs * size * size)
        result[f"low_rank.up{number}"] = (outputs, RANK)
    return result


ZERO = ("offset.", "modulator.", "low_rank.up")
"""Weights that are zero at first, by prefixes of their names."""


def initial(seed: int) -> Weights:
    """Initial weights of one model, M = 1: layers by He's rule, no offset, and adapters that change nothing."""
    generator = torch.Generator().manual_seed(seed)
    weights: Weights = {}
    for name, shape in shapes().items():
        value = torch.randn(1, *shape, generator=generator)
        fan_in = shape[0] if name.startswith("summary") else math.prod(shape[1:])
        weights[name] = value * math.sqrt(2 / fan_in) if "bias" not in name and not name.startswith(ZERO) else value * 0
    return weights


def encode(history: Tensor, labels: Tensor, weights: Weights) -> list[Tensor]:
    """Features of each level, [B, M, C, H, W], from 32 to 4 cells along each side.

    Args:
        history: [B, 8, 2] observed positions in coordinates of the crops.
        labels: [B, 32, 32] uint8, labels of the ground.
        weights: Weights of M models.
    """
    models = len(weights["encoder.bias1"])
    x = _layer(gaussians(history, 2 * COARSE)[:, None], weights, "encoder", 1, stride=2).relu()
    ground = one_hot(labels)[:, None].expand(-1, models, -1, -1, -1)
    x = _layer(torch.cat([x, ground], dim=2), weights, "encoder", 2).relu()
    features = [_modulated(x, weights, 1)]
    for level, numbers in ((2, (3, 4)), (3, (5,)), (4, (6,))):
        x = functional.max_pool2d(features[-1].flatten(1, 2), 2).unflatten(1, (models, -1))
        for number in numbers:
            x = _layer(x, weights, "encoder", number).relu()
        features.append(_modulated(x, weights, level))
    return features


def goal_map(features: list[Tensor], weights: Weights) -> Tensor:
    """Logits [B, M, 64, 64] of the place at the last future step."""
    maps = _decode(features, weights, "goal")
    return functional.pixel_shuffle(maps.flatten(0, 1), 2)[:, 0].unflatten(0, maps.shape[:2])


def path_maps(features: list[Tensor], goal: Tensor, weights: Weights) -> Tensor:
    """Logits [B, M, 12, 32, 32] of the places at the future steps, given goals [B, M, 2] in the crops."""
    return _decode(features, weights, "path", goal)


def summary(features: list[Tensor], history: Tensor, weights: Weights) -> Tensor:
    """Inputs [M, B, 64] of the last layer."""
    pooled = features[-1].mean(dim=(-2, -1)).transpose(0, 1)
    inputs = torch.cat([pooled, history.flatten(1).expand(len(pooled), -1, -1)], dim=-1)
    return torch.baddbmm(weights["summary.bias1"][:, None], inputs, weights["summary.weight1"]).relu()


def offsets(hidden: Tensor, weights: Weights) -> Tensor:
    """What the last layer adds to the places of the future steps, [B, M, 12, 2], for its inputs [M, B, 64]."""
    added = torch.baddbmm(weights["offset.bias1"][:, None], hidden, weights["offset.weight1"])
    return added.unflatten(-1, (FUTURE, 2)).transpose(0, 1)


def places(history: Tensor, labels: Tensor, weights: Weights) -> tuple[Tensor, Tensor]:
    """The forecast towards the mean goal: places of the maps [B, M, 12, 2], and inputs [M, B, 64] of the last layer."""
    features = encode(history, labels, weights)
    goal = mean_place(goal_map(features, weights))
    return mean_place(path_maps(features, goal, weights)), summary(features, history, weights)


def _decode(features: list[Tensor], weights: Weights, part: str, goal: Tensor | None = None) -> Tensor:
    """Maps of a decoder at 32 cells along each side, [B, M, maps, 32, 32]."""
    models = features[0].shape[1]
    x = features[-1][:, :, :0]
    for number, level in enumerate(reversed(features), 1):
        x = functional.interpolate(x.flatten(1, 2), level.shape[-2:]).unflatten(1, (models, -1)) if number > 1 else x
        joined = [level, x, *([] if goal is None else [gaussians(goal, level.shape[-1])[:, :, None]])]
        x = _layer(torch.cat(joined, dim=2), weights, part, number).relu()
    return _layer(x, weights, part, len(DECODER) + 1)


def _modulated(x: Tensor, weights: Weights, level: int) -> Tensor:
    """Features of a level of the encoder with the output of its modulator added."""
    return x + _layer(x, weights, "modulator", level)


def _layer(x: Tensor, weights: Weights, part: str, number: int, stride: int = 1) -> Tensor:
    """A convolution for inputs [B, M, C, H, W], or [B, 1, C, H, W] that all models share."""
    weight, bias = weights[f"{part}.weight{number}"], weights[f"{part}.bias{number}"]
    if part == "encoder":
        change = weights[f"low_rank.up{number}"] @ weights[f"low_rank.down{number}"]
        weight = weight + change.view(weight.shape)
    padding = weight.shape[-1] // 2
    # One convolution for each model: convolutions in groups are slower.
    each = x.expand(-1, len(weight), -1, -1, -1).unbind(dim=1)
    outputs = [
        functional.conv2d(*arguments, stride=stride, padding=padding)
        for arguments in zip(each, weight, bias, strict=True)
    ]
    return torch.stack(outputs, dim=1)
