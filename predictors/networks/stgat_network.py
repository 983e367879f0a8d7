"""The network of STGAT as the paper's released program has it, for several models at once.

Weights are a dict of tensors with a leading axis M; ``shapes`` gives their shapes. All that is random (the initial
states of the encoders, the noise of the decoder) is an argument, so that the network itself is a pure function.
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
"""Units of the trajectory LSTM, of the graph LSTM, and values of noise; together the units of the decoder."""
DECODER = TRAJECTORY + GRAPH + NOISE
STATES = 2 * (TRAJECTORY + GRAPH)
"""Values of the encoders' first states, hidden states and cells."""


@dataclass(frozen=True)
class Draws:
    """What is random in one forward pass.

    Attributes:
        trajectory: h and c of the trajectory LSTM, [M, A, 32] each.
        graph: h and c of the graph LSTM, [M, A, 32] each.
        noise: [M, A, 16], the same for the agents of a scene.
    """

    trajectory: tuple[Tensor, Tensor]
    graph: tuple[Tensor, Tensor]
    noise: Tensor

    @classmethod
    def of(cls, states: Tensor, noise: Tensor, layout: Layout) -> Draws:
        """From the first states [M, A, 128], in the order of the attributes, and the noise of each scene [M, S, 16]."""
        h, c, graph_h, graph_c = states.split([TRAJECTORY, TRAJECTORY, GRAPH, GRAPH], dim=-1)
        return cls((h, c), (graph_h, graph_c), noise.index_select(1, layout.scene))

    def for_models(self, models: int) -> Draws:
        """The draws of one model for several."""
        h, c, graph_h, graph_c, noise = (
            tensor.expand(models, -1, -1).contiguous() for tensor in (*self.trajectory, *self.graph, self.noise)
        )
        return Draws((h, c), (graph_h, graph_c), noise)

    @classmethod
    def from_generators(cls, generators: Sequence[torch.Generator], layout: Layout) -> Draws:
        """Everything from N(0, 1), for each model from its own generator, so that the others are of no account."""

        def normal(*shape: int) -> Tensor:
            return torch.stack([torch.randn(*shape, generator=g, device=g.device) for g in generators])

        return cls.of(normal(len(layout.scene), STATES), normal(layout.scenes, NOISE), layout)


def shapes(features: int) -> dict[str, tuple[int, ...]]:
    """Shape of every weight without the axis M, for inputs of ``features`` values per step."""
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
    """Weights of one model, M = 1.

    Those of an LSTM or linear layer are drawn from U(-1, 1) / sqrt(units or inputs), of attention by Glorot's rule with
    the gain sqrt(2), all heads counted together, as in the released program.

    Args:
        features: Values per observed step: 2, or 3 with sigma.
        seed: Source of all randomness.
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
            # Fan in and fan out as torch counts them for three axes: heads, channels (else 1), F.
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
    return unrolled(inputs, *draws.trajectory, _lstm(weights, "trajectory"))


def encode_graph(hidden: Tensor, draws: Draws, layout: Layout, weights: Weights) -> Tensor:
    """Hidden states [8, M, A, 32] of the graph LSTM over the attended trajectory states of each scene."""
    return unrolled(graph_attention(hidden, layout, weights), *draws.graph, _lstm(weights, "graph"))


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
        draws: What is random.
        layout: The scenes.
        weights: Of M models.
        counterfactual: Subtract, at each step, the state of a second decoder that starts without the trajectory.
    """
    latent = encode(steps, draws, layout, weights)
    return decode(latent, steps[-1, :, :2], draws.noise, weights, counterfactual)


def encode(steps: Tensor, draws: Draws, layout: Layout, weights: Weights) -> Tensor:
    """Latent [M, A, 64]: the last states of both LSTMs."""
    hidden = encode_trajectory(steps, draws, weights)
    return torch.cat([hidden[-1], encode_graph(hidden, draws, layout, weights)[-1]], dim=-1)


def decode(latent: Tensor, last: Tensor, noise: Tensor, weights: Weights, counterfactual: bool = False) -> Tensor:
    """Displacements [12, M, A, 2] that the decoder makes of a latent [M, A, 64] and the last displacements [A, 2]."""
    return decoder_states(latent, last, noise, weights, counterfactual)[0]


def decoder_states(
    latent: Tensor, last: Tensor, noise: Tensor, weights: Weights, counterfactual: bool = False
) -> tuple[Tensor, Tensor]:
    """The displacements of ``decode``, and the states [12, M, A, 80] that the last layer maps to them."""
    h = torch.cat([latent, noise], dim=-1)
    if counterfactual:
        without = torch.cat([torch.zeros_like(latent[..., :TRAJECTORY]), latent[..., TRAJECTORY:], noise], dim=-1)
        h = torch.stack([h, without], dim=2).flatten(1, 2)
    first = last.expand(len(h), -1, -1)
    out, bias = weights["stage3.weight"], weights["stage3.bias"]
    return rolled_out(h, first, _lstm(weights, "decoder"), out, bias, FUTURE, counterfactual)
