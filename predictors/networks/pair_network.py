"""The network of the paper's experiments on style: two agents in a fixed order, linear layers, several models at once.

Weights are a dict of tensors with a leading model axis M; ``shapes`` gives their shapes. The input is positions in
metres and world coordinates, the output is displacements.
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
PLAIN = ("encoder", "decoder")
"""Parts of the network without a style."""
FACTORS = ("side", "d")
"""Parameters of a domain that have a part of the code of their own, in the network with factors."""
SHARE = CODE // len(FACTORS)
"""Values of the code of a factor."""


@dataclass(frozen=True)
class Pairs:
    """Scenes of two agents, as tensors.

    Attributes:
        history: [S, 32] positions, agent by agent, step by step.
        moves: [S, 48] true displacements of the future, in the same order.
        path: [S, 40] positions of the second agent relative to the first, over all 20 steps.
    """

    history: Tensor
    moves: Tensor
    path: Tensor

    @classmethod
    def of(cls, truth: Truth, device: torch.device | str = "cpu") -> Pairs:
        """The scenes of a ground truth.

        Raises:
            PredictorError: a scene does not have two agents.
        """
        history = pair_positions(truth.observation)
        path = np.concatenate([truth.observation.xy, truth.future], axis=1).reshape(-1, AGENTS, WINDOW, 2)
        moves = np.diff(path[:, :, HISTORY - 1 :], axis=2)
        arrays = history, moves, path[:, 1] - path[:, 0]
        return cls(*(torch.tensor(a, dtype=torch.float32, device=device).flatten(1) for a in arrays))

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self.history)

    def take(self, index: Tensor | slice) -> Pairs:
        """A subset of the scenes."""
        return Pairs(self.history[index], self.moves[index], self.path[index])

    def errors(self, moves: Tensor) -> Tensor:
        """ADE [M, S, 2] of each agent, metres, for forecast displacements [M, S, 48]."""
        off = (moves - self.moves).unflatten(-1, (AGENTS, FUTURE, 2)).cumsum(dim=-2)
        return off.norm(dim=-1).mean(dim=-1)


def pair_positions(observation: Observation) -> np.ndarray:
    """Positions [S, 2, 8, 2] of scenes of two agents.

    Raises:
        PredictorError: a scene has another number of agents.
    """
    sizes = np.diff(observation.scene)
    if (sizes != AGENTS).any():
        raise PredictorError(
            f"This network takes scenes of exactly {AGENTS} agents, but a scene has {sizes[sizes != AGENTS][0]}: "
            "use a predictor that takes any number, such as linear, erm_no_sigma or ego_erm."
        )
    return observation.xy.reshape(-1, AGENTS, HISTORY, 2)


def to_forecast(observation: Observation, moves: Tensor) -> Forecast:
    """Forecast [A, 1, 12, 2] from displacements [1, S, 48] or [1, A, 24]."""
    offsets = moves.view(-1, FUTURE, 2).cumsum(dim=1).numpy()
    return Forecast((observation.xy[:, -1:] + offsets)[:, None].astype(np.float32))


def shapes(parts: Mapping[str, tuple[tuple[int, int], ...]]) -> dict[str, tuple[int, ...]]:
    """Shape of every weight, without the model axis, for the inputs and outputs of each layer of each part."""
    result: dict[str, tuple[int, ...]] = {}
    for part, sizes in parts.items():
        for number, (inputs, outputs) in enumerate(sizes, 1):
            result[f"{part}.weight{number}"], result[f"{part}.bias{number}"] = (inputs, outputs), (outputs,)
    return result


def shapes_with_factors() -> dict[str, tuple[int, ...]]:
    """Shape of every weight of the network whose style has factors: see ``code`` and ``modulate``."""
    smaller = {
        "style": ((WINDOW * 2, 16), (16, SHARE)),
        "modulator": ((16 + SHARE, 16), (16, 16), (32 + SHARE, 32), (32, 32)),
    }
    parts = {f"{part}_{factor}": sizes for part, sizes in smaller.items() for factor in FACTORS}
    gates = {f"modulator_gate.weight{block}": (len(FACTORS), units) for block, units in ((1, 16), (2, 32))}
    return {**shapes({part: LAYERS[part] for part in PLAIN}), **shapes(parts), **gates}


def initial(seed: int, expected: dict[str, tuple[int, ...]]) -> Weights:
    """Initial weights of one model, M = 1, drawn from U(-1, 1) / sqrt(inputs of the layer)."""
    generator = torch.Generator().manual_seed(seed)
    weights: Weights = {}
    for name, shape in expected.items():
        inputs = shape[0] if "weight" in name else expected[name.replace("bias", "weight")][0]
        weights[name] = (torch.rand(1, *shape, generator=generator) * 2 - 1) / inputs**0.5
    return weights


def layer(x: Tensor, weights: Weights, part: str, number: int) -> Tensor:
    """One linear layer, for inputs [M, S, C]."""
    return torch.baddbmm(weights[f"{part}.bias{number}"][:, None], x, weights[f"{part}.weight{number}"])


def layers(x: Tensor, weights: Weights, part: str, first: int, last: int) -> Tensor:
    """Linear layers with rectifiers between them."""
    for number in range(first, last + 1):
        x = layer(x, weights, part, number)
        if number < last:
            x = x.relu()
    return x


def encode(history: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Latent [M, S, 16] of histories [S, 32], modulated if there are codes."""
    models = len(weights["encoder.bias1"])
    latent = layers(history.expand(models, -1, -1), weights, "encoder", 1, 3)
    return latent if codes is None else modulate(latent, codes, weights, 1)


def code(path: Tensor, weights: Weights) -> Tensor:
    """Style code [M, S, 8] of each scene from its relative path [S, 40] or [M, S, 40].

    With factors, it holds a code of each factor, one after the other, each from an encoder of its own.
    """
    path = path.expand(len(weights["encoder.bias1"]), -1, -1)
    return torch.cat([layers(path, weights, part, 1, 2) for part in _parts("style", weights)], dim=-1)


def embed(codes: Tensor, weights: Weights) -> Tensor:
    """Style embeddings [M, S, 8] of unit length; with factors, the directions of the codes of each factor."""
    parts = codes.chunk(len(FACTORS), dim=-1)
    if "head.bias1" in weights:
        parts = (layers(codes, weights, "head", 1, 2),)
    return torch.cat([torch.nn.functional.normalize(part, dim=-1) for part in parts], dim=-1)


def modulate(x: Tensor, codes: Tensor, weights: Weights, block: int) -> Tensor:
    """Add the modulator's output for codes [M, S or 1, 8] to x [M, S, C], the input of decoder block 1 or 2.

    With factors, x' = x + sum over factors f of g_f * m_f(x, c_f), where m_f is the modulator of a factor, c_f its
    code, and the gates g [F, C] of ``gates`` share each unit among the factors. In block 2, m_f is linear in x for each
    code: m_f = W2 ((W1 x + b1) * V c_f) + b2, so that it has the same effect on values of x that it was not trained on.
    """
    parts = _parts("modulator", weights)
    changes = []
    for name, part in zip(parts, codes.chunk(len(parts), dim=-1), strict=True):
        if len(parts) > 1 and block == 2:
            changes.append(_product(x, part, weights, name))
            continue
        joined = torch.cat([x, part.expand(len(x), x.shape[1], -1)], dim=-1)
        changes.append(layers(joined, weights, name, 2 * block - 1, 2 * block))
    if len(parts) == 1:
        return x + changes[0]
    return x + (torch.stack(changes, dim=1) * gates(weights, block)[:, :, None]).sum(dim=1)


def _product(x: Tensor, codes: Tensor, weights: Weights, part: str) -> Tensor:
    """Output [M, S, C] of a modulator of block 2 with factors; its first layer holds W1 above V."""
    first, second = weights[f"{part}.weight3"].split([x.shape[-1], codes.shape[-1]], dim=1)
    hidden = torch.baddbmm(weights[f"{part}.bias3"][:, None], x, first) * (codes @ second)
    return layer(hidden, weights, part, 4)


def gates(weights: Weights, block: int) -> Tensor:
    """Gates [M, F, C] of each factor and unit of block 1 or 2; those of a unit sum to 1."""
    return weights[f"modulator_gate.weight{block}"].softmax(dim=1)


def _parts(part: str, weights: Weights) -> tuple[str, ...]:
    """Names of a part of the style: one, or one for each factor."""
    return (part,) if f"{part}.bias1" in weights else tuple(f"{part}_{factor}" for factor in FACTORS)


def decode(latent: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Displacements [M, S, 48] of a latent of ``encode``; the codes modulate the second block."""
    return layer(last_hidden(latent, codes, weights), weights, "decoder", 4)


def last_hidden(latent: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Inputs [M, S, 48] of the last layer of ``decode``."""
    x = layers(latent, weights, "decoder", 1, 2)
    if codes is not None:
        x = modulate(x, codes, weights, 2)
    return layer(x, weights, "decoder", 3).relu()


def forecast(history: Tensor, codes: Tensor | None, weights: Weights) -> Tensor:
    """Displacements [M, S, 48] for histories [S, 32], in the style of the codes if there are any."""
    return decode(encode(history, codes, weights), codes, weights)
