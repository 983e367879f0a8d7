"""The three most expensive operations of the networks: an LSTM cell, and normalisation and attention over scenes.

On a CPU in single precision they are numba kernels with backward passes, which use one thread. Otherwise they are plain
torch operations, which are also the reference in the tests. Only ``kernel_loops`` needs numba.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import elu, leaky_relu

from motion_gym.predictors.networks import kernel_loops as loops
from motion_gym.predictors.networks.kernel_loops import EPSILON, SLOPE


def serve(x: Tensor) -> bool:
    """Whether the kernels support a tensor."""
    return x.device.type == "cpu" and x.dtype == torch.float32


def lstm_cell(gates: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
    """One step of an LSTM after its matrix product.

    Args:
        gates: [M, A, 4 H] pre-activations in the order input, forget, output, cell. The first three, which are
            logistic, are halved: logistic(x) = (1 + tanh(x / 2)) / 2. The kernel overwrites them.
        cells: [M, A, H] cells before the step.

    Returns:
        Hidden states and cells [M, A, H] after the step.
    """
    if serve(gates):
        return LstmCell.apply(gates, cells)  # type: ignore[no-any-return]
    i, f, o, n = gates.tanh().chunk(4, dim=-1)
    after = ((1 + f) * cells + (1 + i) * n) / 2
    return (1 + o) / 2 * after.tanh(), after


def normalise(x: Tensor, scene: Tensor, limits: Tensor) -> Tensor:
    """Features minus their mean over the agents of a scene, divided by their standard deviation.

    Args:
        x: [T, M, A, C].
        scene: [A] int64, scene of each agent.
        limits: [S + 1] int64; scene s has the agents limits[s] to limits[s + 1].
    """
    if serve(x):
        return Normalise.apply(x, limits)  # type: ignore[no-any-return]

    def mean(values: Tensor) -> Tensor:
        total = values.new_zeros(*values.shape[:2], len(limits) - 1, values.shape[3]).index_add(2, scene, values)
        return (total / limits.diff().clamp(min=1)[:, None])[:, :, scene]

    off = x - mean(x)
    return off / (mean(off * off) + EPSILON).sqrt()


def attend(projected: Tensor, bias: Tensor, limits: Tensor, rectify: bool) -> Tensor:
    """Attention among the agents of each scene: softmax over j of leaky_relu(source_i + target_j), times the values.

    Args:
        projected: [T, M, A, heads * F + 2 * heads]: the values, then the sources, then the targets of each head.
        bias: [M, F], added to each head.
        limits: [S + 1] int64; scene s has the agents limits[s] to limits[s + 1].
        rectify: Whether to apply an exponential linear unit to the output.

    Returns:
        [T, M, A, heads * F].
    """
    if serve(projected):
        return Attend.apply(projected, bias, limits, rectify)  # type: ignore[no-any-return]
    features = bias.shape[-1]
    heads = projected.shape[-1] // (features + 2)
    sizes = limits.diff()[:, None]
    place = torch.arange(int(sizes.max()) if len(sizes) else 0, device=projected.device)
    present = place < sizes
    padded = projected[:, :, torch.where(present, limits[:-1, None] + place, 0)] * present[..., None]
    values, source, target = padded.split([heads * features, heads, heads], dim=-1)
    logits = leaky_relu(source[..., :, None, :] + target[..., None, :, :], SLOPE)
    logits = logits.masked_fill(~present[:, None, :, None], torch.finfo(projected.dtype).min)
    attended = torch.einsum("...ijh,...jhf->...ihf", logits.softmax(dim=-2), values.unflatten(-1, (heads, features)))
    out = (attended + bias[:, None, None, None]).flatten(-2)[:, :, present]
    return elu(out) if rectify else out


class LstmCell(torch.autograd.Function):
    """``lstm_cell`` with kernels."""

    @staticmethod
    def forward(ctx: Any, gates: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
        """Hidden states and cells."""
        gates, cells = gates.contiguous(), cells.contiguous()
        hidden, after = torch.empty_like(cells), torch.empty_like(cells)
        loops.lstm_forward(*_flat(gates, cells, hidden, after))
        ctx.save_for_backward(gates, cells, after)
        return hidden, after

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_hidden: Tensor, d_after: Tensor) -> tuple[Tensor, Tensor]:  # type: ignore[override]
        """Gradients of gates and cells."""
        gates, cells, after = ctx.saved_tensors
        d_gates, d_cells = torch.empty_like(gates), torch.empty_like(cells)
        arrays = _flat(gates, cells, after, d_hidden.contiguous(), d_after.contiguous())
        loops.lstm_backward(*arrays, *_flat(d_gates, d_cells))
        return d_gates, d_cells


class Normalise(torch.autograd.Function):
    """``normalise`` with kernels."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, limits: Tensor) -> Tensor:
        """Normalised features."""
        x = x.contiguous()
        y, scale = torch.empty_like(x), x.new_empty(*x.shape[:2], len(limits) - 1, x.shape[3])
        loops.normalise_forward(*_flat(x), limits.numpy(), *_flat(y, scale))
        ctx.save_for_backward(y, scale, limits)
        return y

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_y: Tensor) -> tuple[Tensor, None]:  # type: ignore[override]
        """Gradient of x."""
        y, scale, limits = ctx.saved_tensors
        d_x = torch.empty_like(y)
        loops.normalise_backward(*_flat(y, scale, d_y.contiguous()), limits.numpy(), *_flat(d_x))
        return d_x, None


class Attend(torch.autograd.Function):
    """``attend`` with kernels."""

    @staticmethod
    def forward(ctx: Any, projected: Tensor, bias: Tensor, limits: Tensor, rectify: bool) -> Tensor:
        """Attended values."""
        projected, features = projected.contiguous(), bias.shape[1]
        heads = projected.shape[3] // (features + 2)
        out = projected.new_empty(*projected.shape[:3], heads * features)
        repeated = bias.detach().repeat(len(projected), 1).numpy()
        loops.attend_forward(*_flat(projected), limits.numpy(), repeated, rectify, *_flat(out))
        ctx.save_for_backward(projected, out, limits)
        ctx.rectify, ctx.features = rectify, features
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_out: Tensor) -> tuple[Tensor, Tensor, None, None]:  # type: ignore[override]
        """Gradients of projected and bias."""
        projected, out, limits = ctx.saved_tensors
        d_projected = torch.empty_like(projected)
        d_bias = projected.new_zeros(*projected.shape[:2], ctx.features)
        arrays = _flat(projected, out, d_out.contiguous())
        loops.attend_backward(*arrays, limits.numpy(), ctx.rectify, *_flat(d_projected, d_bias))
        return d_projected, d_bias.sum(dim=0), None, None


def _flat(*tensors: Tensor) -> list[np.ndarray]:
    """Tensors [T, M, ...] as arrays [T M, ...]."""
    return [tensor.detach().flatten(0, 1).numpy() for tensor in tensors]
