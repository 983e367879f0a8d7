"""The network of STGAT as the paper's released program has it, for several models at once.

Weights are a dict of tensors with a leading axis M; ``names`` gives their shapes. All that is random (the initial
states of the encoders, the noise of the decoder) is an argument, so that the network itself is a pure function.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from motion_gym.contract import FUTURE
from motion_gym.predictors.graph_attention import Layout, graph_attention
from motion_gym.predictors.lstm import Unrolled, lstm

Weights = dict[str, Tensor]

TRAJECTORY, GRAPH, NOISE = 32, 32, 16
"""Units of the trajectory LSTM, of the graph LSTM, and values of noise; together the units of the decoder."""
DECODER = TRAJECTORY + GRAPH + NOISE


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
    def from_generator(cls, generator: torch.Generator, models: int, layout: Layout) -> Draws:
        """Draw everything from N(0, 1)."""
        agents, scenes = len(layout.place), len(layout.row)

        def normal(*shape: int) -> Tensor:
            return torch.randn(*shape, generator=generator, device=generator.device)

        trajectory = (normal(models, agents, TRAJECTORY), normal(models, agents, TRAJECTORY))
        graph = (normal(models, agents, GRAPH), normal(models, agents, GRAPH))
        return cls(trajectory, graph, normal(models, scenes, NOISE).index_select(1, layout.scene))


def shapes(features: int) -> dict[str, tuple[int, ...]]:
    """Shape of every weight without the axis M, for inputs of ``features`` values per step."""
    found: dict[str, tuple[int, ...]] = {}
    for name, inputs, units in (
        ("trajectory", features, TRAJECTORY),
        ("graph", GRAPH, GRAPH),
        ("decoder", 2, DECODER),
    ):
        found[f"{name}.input"] = (inputs, 4 * units)
        found[f"{name}.hidden"] = (units, 4 * units)
        found[f"{name}.bias_input"] = found[f"{name}.bias_hidden"] = (4 * units,)
    for name, heads, channels, out in (("attention1", 4, TRAJECTORY, 16), ("attention2", 1, 64, GRAPH)):
        found[f"{name}.w"] = (heads, channels, out)
        found[f"{name}.source"] = found[f"{name}.target"] = (heads, out)
        found[f"{name}.bias"] = (out,)
    for name, inputs in (("stage1", TRAJECTORY), ("stage2", TRAJECTORY + GRAPH), ("stage3", DECODER)):
        found[f"{name}.weight"], found[f"{name}.bias"] = (inputs, 2), (2,)
    return found


def initial(features: int, seed: int) -> Weights:
    """Weights of one model, M = 1.

    Those of an LSTM or linear layer are drawn from U(-1, 1) / sqrt(units or inputs), of attention by Glorot's rule.

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
            bound = math.sqrt(2) * math.sqrt(6 / (shape[-1] + (shape[-2] if kind == "w" else 1)))
        weights[name] = (torch.rand(1, *shape, generator=generator) * 2 - 1) * bound
    return weights


def _bias(weights: Weights, name: str) -> Tensor:
    return weights[f"{name}.bias_input"] + weights[f"{name}.bias_hidden"]


def _linear(x: Tensor, weights: Weights, name: str) -> Tensor:
    return torch.matmul(x, weights[f"{name}.weight"]) + weights[f"{name}.bias"][:, None]


def encode_trajectory(steps: Tensor, draws: Draws, weights: Weights) -> Tensor:
    """Hidden states [8, M, A, 32] of the trajectory LSTM over the observed steps [8, A, F]."""
    gates = (weights["trajectory.input"], weights["trajectory.hidden"], _bias(weights, "trajectory"))
    return lstm(steps, *draws.trajectory, *gates)[0]


def encode_graph(hidden: Tensor, draws: Draws, layout: Layout, weights: Weights) -> Tensor:
    """Hidden states [8, M, A, 32] of the graph LSTM over what the scene's agents make of the trajectory states."""
    gates = (weights["graph.input"], weights["graph.hidden"], _bias(weights, "graph"))
    return lstm(graph_attention(hidden, layout, weights), *draws.graph, *gates)[0]


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
    hidden = encode_trajectory(steps, draws, weights)
    graph = encode_graph(hidden, draws, layout, weights)[-1]
    return decode(hidden[-1], graph, steps[-1, :, :2], draws.noise, weights, counterfactual)


def decode(
    trajectory: Tensor, graph: Tensor, last: Tensor, noise: Tensor, weights: Weights, counterfactual: bool
) -> Tensor:
    """Roll the decoder out: [12, M, A, 2] displacements.

    Each output is the next input. Since it is linear in the hidden state, it is folded into the recurrent weights, and
    the 12 outputs are computed together at the end.
    """
    to_gates, recurrent = weights["decoder.input"], weights["decoder.hidden"]
    out, out_bias = weights["stage3.weight"], weights["stage3.bias"]
    bias = _bias(weights, "decoder")
    fed = torch.matmul(out, to_gates)
    first = torch.matmul(last, to_gates) + bias[:, None]
    rest = (bias + torch.matmul(out_bias[:, None], to_gates)[:, 0])[:, None]
    if counterfactual:
        # Both decoders side by side: the input of both is out (h - h') + bias.
        size = DECODER
        h = torch.cat([trajectory, graph, noise, torch.zeros_like(trajectory), graph, noise], dim=-1)
        zero = torch.zeros_like(recurrent)
        gates_of = [recurrent + fed, fed, -fed, recurrent - fed]
        alone = [recurrent, zero, zero, recurrent]
        joint, separate = (_side_by_side(blocks, size) for blocks in (gates_of, alone))
        first, rest = (_twice(g, size) for g in (first, rest))
        out = torch.cat([out, -out], dim=1)
    else:
        h = torch.cat([trajectory, graph, noise], dim=-1)
        joint, separate = recurrent + fed, recurrent
    one, c = Unrolled.apply(first[None].expand(1, *h.shape[:2], first.shape[-1]), h, torch.zeros_like(h), separate)
    more = rest.expand(FUTURE - 1, h.shape[0], h.shape[1], rest.shape[-1])
    others, _ = Unrolled.apply(more, one[0], c, joint)
    return torch.matmul(torch.cat([one, others]), out) + out_bias[:, None]


def _side_by_side(blocks: list[Tensor], size: int) -> Tensor:
    """Recurrent weights [M, 2 H, 8 H] of two LSTMs that feed each other; gates keep their order, each two H wide."""
    own, to_other, from_other, other = (b.unflatten(-1, (4, size)) for b in blocks)
    top = torch.cat([own, to_other], dim=-1)
    bottom = torch.cat([from_other, other], dim=-1)
    return torch.cat([top, bottom], dim=1).flatten(-2)


def _twice(gates: Tensor, size: int) -> Tensor:
    halves = gates.unflatten(-1, (4, size))
    return torch.cat([halves, halves], dim=-1).flatten(-2)
