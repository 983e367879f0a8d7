"""LSTMs of several models at once, with a backward pass of their own.

M models of one shape, as five seeds are, are trained in one pass: every weight has a leading axis M, and every matrix
product is a batched one. The element-wise part of an LSTM is most of its time on a CPU, so forward and backward keep
only the activated gates and cells, and work in place.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


class Unrolled(torch.autograd.Function):
    """An LSTM over T steps whose input part of the gates is known beforehand."""

    @staticmethod
    def forward(ctx: Any, gates: Tensor, h: Tensor, c: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
        """Run the LSTM.

        Args:
            ctx: Of autograd.
            gates: [T, M, A, 4 H], input part of the gates, biases included; order: input, forget, cell, output.
            h: [M, A, H] hidden state before the first step.
            c: [M, A, H] cell before the first step.
            weight: [M, H, 4 H], from the hidden state to the gates.

        Returns:
            Hidden states [T, M, A, H] and the last cell [M, A, H].
        """
        steps, size = len(gates), h.shape[-1]
        hidden, cells = torch.empty(steps, *h.shape), torch.empty(steps + 1, *c.shape)
        if gates.device.type != "cpu":
            hidden, cells = hidden.to(gates.device), cells.to(gates.device)
        active = torch.empty_like(gates)
        cells[0] = c
        before = h
        for t in range(steps):
            g = active[t]
            torch.baddbmm(gates[t], before, weight, out=g)
            g[..., : 2 * size].sigmoid_()
            g[..., 2 * size : 3 * size].tanh_()
            g[..., 3 * size :].sigmoid_()
            i, f, n, o = g.split(size, dim=-1)
            torch.mul(f, cells[t], out=cells[t + 1])
            cells[t + 1].addcmul_(i, n)
            torch.tanh(cells[t + 1], out=hidden[t])
            hidden[t].mul_(o)
            before = hidden[t]
        ctx.save_for_backward(active, h, hidden, cells, weight)
        return hidden, cells[steps].clone()

    @staticmethod
    def backward(ctx: Any, d_hidden: Tensor, d_last: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:  # type: ignore[override]
        """Gradients of gates, h, c and weight."""
        active, h, hidden, cells, weight = ctx.saved_tensors
        steps, size = len(active), h.shape[-1]
        d_gates = torch.empty_like(active)
        d_c, d_h = d_last.clone(), torch.zeros_like(h)
        back = weight.transpose(1, 2)
        for t in reversed(range(steps)):
            i, f, n, o = active[t].split(size, dim=-1)
            d_i, d_f, d_n, d_o = d_gates[t].split(size, dim=-1)
            d_h += d_hidden[t]
            tanh = cells[t + 1].tanh()
            torch.mul(d_h, tanh, out=d_o)
            d_c.addcmul_(d_h * o, 1 - tanh * tanh)
            torch.mul(d_c, n, out=d_i)
            torch.mul(d_c, cells[t], out=d_f)
            torch.mul(d_c, i, out=d_n)
            d_c.mul_(f)
            d_i.mul_(i - i * i)
            d_f.mul_(f - f * f)
            d_n.mul_(1 - n * n)
            d_o.mul_(o - o * o)
            d_h = torch.bmm(d_gates[t], back)
        previous = torch.cat([h[None], hidden[:-1]])
        models, agents = h.shape[:2]
        rows = previous.transpose(0, 1).reshape(models, steps * agents, size)
        columns = d_gates.transpose(0, 1).reshape(models, steps * agents, 4 * size)
        return d_gates, d_h, d_c, torch.bmm(rows.transpose(1, 2), columns)


def lstm(inputs: Tensor, h: Tensor, c: Tensor, to_gates: Tensor, weight: Tensor, bias: Tensor) -> tuple[Tensor, Tensor]:
    """An LSTM over known inputs.

    Args:
        inputs: [T, A, F] the same for all models, or [T, M, A, F].
        h: [M, A, H] hidden state before the first step.
        c: [M, A, H] cell before the first step.
        to_gates: [M, F, 4 H], from the input to the gates.
        weight: [M, H, 4 H], from the hidden state to the gates.
        bias: [M, 4 H].

    Returns:
        Hidden states [T, M, A, H] and the last cell [M, A, H].
    """
    if inputs.dim() == 3:
        inputs = inputs[:, None]
    return Unrolled.apply(torch.matmul(inputs, to_gates) + bias[:, None], h, c, weight)
