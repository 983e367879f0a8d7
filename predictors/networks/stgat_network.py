"""The network of STGAT, as in the paper's released program, for several models at once.

Weights are a dict of tensors with a leading model axis M; ``shapes`` gives their shapes. The random values (the initial
states of the encoders and the noise of the decoder) are arguments, so the network is a pure function.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from motion_gym.contract import FUTURE
from motion_gym.predictors.networks.graph_attention import Layout, graph_attention
from motion_gym.predictors.networks.lstm import joined_weights, rolled_out, unrolled
from motion_gym.training.program import Weights

TRAJECTORY, GRAPH, NOISE = 32, 32, 16
"""Units of the trajectory LSTM and of the graph LSTM, and values of noise; their sum is the units of the decoder."""
DECODER = TRAJECTORY + GRAPH + NOISE
STATES = 2 * (TRAJECTORY + GRAPH)
"""Values of the initial hidden states and cells of both encoders."""


@dataclass(frozen=True)
class Draws:
    """The random values of one forward pass.

    Attributes:
        states: [M, A, 128] initial states of the encoders: h and c of the trajectory LSTM, then of the graph LSTM.
        noise: [M, A, 16] noise of the decoder, the same for the agents of a scene.
    """

    states: Tensor
    noise: Tensor

    @classmethod
    def of(cls, states: Tensor, noise: Tensor, layout: Layout) -> Draws:
        """Draws with initial states [M, A, 128] and the noise of each scene [M, S, 16]."""
        return cls(states, noise.index_select(1, layout.scene))

    def for_models(self, models: int) -> Draws:
        """The same draws for several models."""
        return Draws(self.states.expand(models, -1, -1), self.noise.expand(models, -1, -1))

    @classmethod
    def from_generators(cls, generators: Sequence[torch.Generator], layout: Layout) -> Draws:
        """Draws from N(0, 1) with one generator per model, so that models are independent of each other."""

        def normal(*shape: int) -> Tensor:
            return torch.stack([torch.randn(*shape, generator=g, device=g.device) for g in generators])

        return cls.of(normal(len(layout.scene), STATES), normal(len(layout.limits) - 1, NOISE), layout)


def shapes(features: int) -> dict[str, tuple[int, ...]]:
    """Shape of every weight, without the model axis, for inputs of ``features`` values per step."""
    result: dict[str, tuple[int, ...]] = {}
    for name, inputs, units in (
        ("trajectory", features, TRAJECTORY),
        ("graph", GRAPH, GRAPH),
        ("decoder", 2, DECODER),
    ):
        result[f"{name}.input"] = (inputs, 4 * units)
        result[f"{name}.hidden"] = (units, 4 * units)
        result[f"{name}.bias_input"] = result[f"{name}.bias_hidden"] = (4 * units,)
    for name, heads, channels, out in (("attention1", 4, TRAJECTORY, 16), ("attention2", 1, 64, GRAPH)):
        result[f"{name}.w"] = (heads, channels, out)
        result[f"{name}.source"] = result[f"{name}.target"] = (heads, out)
        result[f"{name}.bias"] = (out,)
    for name, inputs in (("stage1", TRAJECTORY), ("stage2", TRAJECTORY + GRAPH), ("stage3", DECODER)):
        result[f"{name}.weight"], result[f"{name}.bias"] = (inputs, 2), (2,)
    return result


def initial(features: int, seed: int) -> Weights:
    """Initial weights of one model, M = 1, as in the released program.

    Weights of LSTM and linear layers are drawn from U(-1, 1) / sqrt(units or inputs); those of attention by Glorot's
    rule with the gain sqrt(2), with fan in and fan out over all heads.

    Args:
        features: Values per observed step: 2, or 3 with sigma.
        seed: Seed of all random values.
    """
    generator = torch.Generator().manual_seed(seed)
    units = {"trajectory": TRAJECTORY, "graph": GRAPH, "decoder": DECODER}
    inputs = {"stage1": TRAJECTORY, "stage2": TRAJECTORY + GRAPH, "stage3": DECODER}
    weights = {}
    for name, shape in shapes(features).items():
        part, kind = name.split(".")
        if part in units or part in inputs:
            bound = 1 / math.sqrt(units.get(part) or inputs[part])
        elif kind == "bias":
            bound = 0.0
        else:
            # Fan in and fan out as torch computes them for three axes: heads, channels (or 1), F.
            heads, features = shape[0], shape[-1]
            bound = math.sqrt(2) * math.sqrt(6 / ((shape[1] + heads) * features if kind == "w" else features + heads))
        weights[name] = (torch.rand(1, *shape, generator=generator) * 2 - 1) * bound
    return weights


def _lstm(weights: Weights, name: str) -> Tensor:
    bias = weights[f"{name}.bias_input"] + weights[f"{name}.bias_hidden"]
    return joined_weights(weights[f"{name}.input"], weights[f"{name}.hidden"], bias)


def _linear(x: Tensor, weights: Weights, name: str) -> Tensor:
    return torch.matmul(x, weights[f"{name}.weight"]) + weights[f"{name}.bias"][:, None]


def encode_trajectory(steps: Tensor, draws: Draws, weights: Weights) -> Tensor:
    """Hidden states [8, M, A, 32] of the trajectory LSTM over the observed steps [8, A, F]."""
    inputs = steps[:, None].expand(-1, len(draws.noise), -1, -1)
    h, c = draws.states[..., : 2 * TRAJECTORY].chunk(2, dim=-1)
    return unrolled(inputs, h, c, _lstm(weights, "trajectory"))


def encode_graph(hidden: Tensor, draws: Draws, layout: Layout, weights: Weights) -> Tensor:
    """Hidden states [8, M, A, 32] of the graph LSTM over the attended trajectory states of each scene."""
    h, c = draws.states[..., 2 * TRAJECTORY :].chunk(2, dim=-1)
    return unrolled(graph_attention(hidden, layout, weights), h, c, _lstm(weights, "graph"))


def stage1(steps: Tensor, draws: Draws, weights: Weights) -> Tensor:
    """Observed displacements [8, M, A, 2] reconstructed from the trajectory LSTM."""
    return _linear(encode_trajectory(steps, draws, weights), weights, "stage1")


def stage2(steps: Tensor, draws: Draws, layout: Layout, weights: Weights) -> Tensor:
    """Observed displacements [8, M, A, 2] reconstructed from both LSTMs."""
    hidden = encode_trajectory(steps, draws, weights)
    return _linear(torch.cat([hidden, encode_graph(hidden, draws, layout, weights)], dim=-1), weights, "stage2")


def stage3(steps: Tensor, draws: Draws, layout: Layout, weights: Weights, counterfactual: bool = False) -> Tensor:
    """Forecast displacements [12, M, A, 2].

    Args:
        steps: [8, A, F] observed displacements, and sigma.
        draws: The random values.
        layout: The scenes.
        weights: Weights of M models.
        counterfactual: Subtract, at each step, the state of a second decoder that starts without the trajectory.
    """
    latent = encode(steps, draws, layout, weights)
    return decode(latent, steps[-1, :, :2], draws.noise, weights, counterfactual)


def encode(steps: Tensor, draws: Draws, layout: Layout, weights: Weights) -> Tensor:
    """Latent [M, A, 64]: the last states of both LSTMs."""
    hidden = encode_trajectory(steps, draws, weights)
    return torch.cat([hidden[-1], encode_graph(hidden, draws, layout, weights)[-1]], dim=-1)


def decode(latent: Tensor, last: Tensor, noise: Tensor, weights: Weights, counterfactual: bool = False) -> Tensor:
    """Displacements [12, M, A, 2] of the decoder for a latent [M, A, 64] and the last displacements [A, 2]."""
    return decoder_states(latent, last, noise, weights, counterfactual)[0]


def decoder_states(
    latent: Tensor, last: Tensor, noise: Tensor, weights: Weights, counterfactual: bool = False
) -> tuple[Tensor, Tensor]:
    """The displacements of ``decode``, and the inputs [12, M, A, 80] of the last layer."""
    h = torch.cat([latent, noise], dim=-1)
    if counterfactual:
        without = torch.cat([torch.zeros_like(latent[..., :TRAJECTORY]), latent[..., TRAJECTORY:], noise], dim=-1)
        h = torch.stack([h, without], dim=2).flatten(1, 2)
    first = last.expand(len(h), -1, -1)
    out, bias = weights["stage3.weight"], weights["stage3.bias"]
    return rolled_out(h, first, _lstm(weights, "decoder"), out, bias, FUTURE, counterfactual)
