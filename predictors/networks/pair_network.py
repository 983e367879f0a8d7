"""The network of the paper's experiments on style: two agents in a fixed order, plain layers, several models at once.

Weights are a dict of tensors with a leading axis M; ``SHAPES`` gives their shapes. Positions go in as they are, in
metres and world coordinates, and displacements come out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, HISTORY, WINDOW, Forecast, Observation, PredictorError, Truth
from motion_gym.training.program import Weights

AGENTS = 2
CODE = 8
"""Values of a style code."""

LAYERS: dict[str, tuple[tuple[int, int], ...]] = {
    "encoder": ((AGENTS * HISTORY * 2, 32), (32, 32), (32, 16)),
    "decoder": ((16, 32), (32, 32), (32, AGENTS * FUTURE * 2), (AGENTS * FUTURE * 2, AGENTS * FUTURE * 2)),
    "style": ((WINDOW * 2, 16), (16, CODE)),
    "modulator": ((16 + CODE, 16), (16, 16), (32 + CODE, 32), (32, 32)),
    "head": ((CODE, CODE), (CODE, CODE)),
}
"""Inputs and outputs of each layer of each part."""


@dataclass(frozen=True)
class Pairs:
    """Scenes of two agents, as tensors.

    Attributes:
        history: [S, 32] positions, agent by agent, step by step.
        moves: [S, 48] true displacements of the future, in the same order.
        path: [S, 40] positions of the second agent seen from the first, over all 20 steps.
    """

    history: Tensor
    moves: Tensor
    path: Tensor

    @classmethod
    def of(cls, truth: Truth, device: torch.device | str = "cpu") -> Pairs:
        """From a truth.

        Raises:
            PredictorError: a scene has not two agents.
        """
        history = paired(truth.observation)
        whole = np.concatenate([truth.observation.xy, truth.future], axis=1).reshape(-1, AGENTS, WINDOW, 2)
        moves = np.diff(whole[:, :, HISTORY - 1 :], axis=2)
        arrays = history, moves, whole[:, 1] - whole[:, 0]
        return cls(*(torch.tensor(a, dtype=torch.float32, device=device).flatten(1) for a in arrays))

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self.history)

    def take(self, index: Tensor | slice) -> Pairs:
        """Some of the scenes."""
        return Pairs(self.history[index], self.moves[index], self.path[index])

    def errors(self, moves: Tensor) -> Tensor:
        """ADE [M, S, 2] of each agent, metres, of forecast displacements [M, S, 48]."""
        off = (moves - self.moves).unflatten(-1, (AGENTS, FUTURE, 2)).cumsum(dim=-2)
        return off.norm(dim=-1).mean(dim=-1)


def paired(observation: Observation) -> np.ndarray:
    """Positions [S, 2, 8, 2] of scenes of two agents.

    Raises:
        PredictorError: a scene has another number of agents.
    """
    sizes = np.diff(observation.scene)
    if (sizes != AGENTS).any():
        raise PredictorError(
            f"This network takes scenes of exactly {AGENTS} agents, and there is one of {sizes[sizes != AGENTS][0]}: "
            "use a predictor that takes any number, as linear, erm_no_sigma or ego_erm."
        )
    return observation.xy.reshape(-1, AGENTS, HISTORY, 2)


def exact(observation: Observation) -> Tensor:
    """Histories [S, 2, 8, 2] in double precision: positions are taken as they are, and single ones round far out.

    Raises:
        PredictorError: a scene has not two agents.
    """
    return torch.tensor(paired(observation), dtype=torch.float64)


def walked(observation: Observation, moves: Tensor) -> Forecast:
    """Forecast [A, 1, 12, 2] of agents who go on by displacements [1, S, 48]."""
    offsets = moves.view(-1, FUTURE, 2).cumsum(dim=1).numpy()
    return Forecast((observation.xy[:, -1:] + offsets)[:, None].astype(np.float32))


def shapes(parts: tuple[str, ...] = tuple(LAYERS)) -> dict[str, tuple[int, ...]]:
    """Shape of every weight of some parts, without the axis M."""
    return shapes_of({part: LAYERS[part] for part in parts})


def shapes_of(parts: Mapping[str, tuple[tuple[int, int], ...]]) -> dict[str, tuple[int, ...]]:
    """Shape of every weight of layers with such inputs and outputs, without the axis M."""
    result: dict[str, tuple[int, ...]] = {}
    for part, sizes in parts.items():
        for number, (inputs, outputs) in enumerate(sizes, 1):
            result[f"{part}.weight{number}"], result[f"{part}.bias{number}"] = (inputs, outputs), (outputs,)
    return result


def initial(seed: int, expected: dict[str, tuple[int, ...]]) -> Weights:
    """Weights of one model, M = 1, all drawn from U(-1, 1) / sqrt(inputs of the layer)."""
    generator = torch.Generator().manual_seed(seed)
    weights: Weights = {}
    for name, shape in expected.items():
        inputs = shape[0] if "weight" in name else expected[name.replace("bias", "weight")][0]
        weights[name] = (torch.rand(1, *shape, generator=generator) * 2 - 1) / inputs**0.5
    return weights


def layer(x: Tensor, weights: Weights, part: str, number: int) -> Tensor:
    """A linear layer of [M, S, C]."""
    return torch.baddbmm(weights[f"{part}.bias{number}"][:, None], x, weights[f"{part}.weight{number}"])


def layers(x: Tensor, weights: Weights, part: str, first: int, last: int) -> Tensor:
    """Linear layers with rectifiers in between."""
    for number in range(first, last + 1):
        x = layer(x, weights, part, number)
        if number < last:
            x = x.relu()
    return x


def encode(history: Tensor, weights: Weights) -> Tensor:
    """Latent [M, S, 16] of histories [S, 32]."""
    models = len(weights["encoder.bias1"])
    return layers(history.expand(models, -1, -1), weights, "encoder", 1, 3)


def code(path: Tensor, weights: Weights) -> Tensor:
    """Style code [M, S, 8] of each scene from its relative path [S, 40] or [M, S, 40]."""
    models = len(weights["style.bias1"])
    return layers(path.expand(models, -1, -1), weights, "style", 1, 2)


def embed(codes: Tensor, weights: Weights) -> Tensor:
    """Projection [M, S, 8] of unit length."""
    return torch.nn.functional.normalize(layers(codes, weights, "head", 1, 2), dim=-1)


def modulate(x: Tensor, codes: Tensor, weights: Weights, block: int) -> Tensor:
    """Add the output of the modulator to x [M, S, C], for codes [M, S or 1, 8], before decoder block 1 or 2."""
    joined = torch.cat([x, codes.expand(len(x), x.shape[1], -1)], dim=-1)
    return x + layers(joined, weights, "modulator", 2 * block - 1, 2 * block)


def decode(latent: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Displacements [M, S, 48] from a latent that was modulated, if at all, before; codes for the second block."""
    return layer(before_last(latent, codes, weights), weights, "decoder", 4)


def before_last(latent: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Inputs [M, S, 48] of the last layer of ``decode``."""
    x = layers(latent, weights, "decoder", 1, 2)
    if codes is not None:
        x = modulate(x, codes, weights, 2)
    return layer(x, weights, "decoder", 3).relu()


def forecast(history: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Displacements [M, S, 48] of scenes, in the style of the codes if there are some."""
    return decode(latent_of(history, codes, weights), codes, weights)


def latent_of(history: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Latent [M, S, 16] of histories [S, 32], modulated if there are codes."""
    latent = encode(history, weights)
    return latent if codes is None else modulate(latent, codes, weights, 1)
