"""LSTMs of several models at once, with a backward pass of their own.

M models of one shape, as five seeds are, are trained in one pass: every weight has a leading axis M, and every matrix
product is a batched one. Two things make it fast on a CPU: the rows are worked off in slices that stay in the cache
over all steps, and input, hidden state and a one for the bias lie side by side, so that a step is a single product.

Elsewhere, and in float64, the same is done by plain operations of torch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from motion_gym.predictors.networks import kernels, threads


def joined_weights(inputs: Tensor, hidden: Tensor, bias: Tensor) -> Tensor:
    """Weights [M, H + F + 1, 4 H] as used here, from those of torch's order of gates: input, forget, cell, output.

    The order is input, forget, output, cell, and all but the last are halved: logistic(x) = (1 + tanh(x / 2)) / 2, so
    that all four are hyperbolic tangents.

    Args:
        inputs: [M, F, 4 H], from the input to the gates.
        hidden: [M, H, 4 H], from the hidden state to the gates.
        bias: [M, 4 H].
    """
    i, f, n, o = torch.cat([hidden, inputs, bias[:, None]], dim=1).chunk(4, dim=-1)
    return torch.cat([i / 2, f / 2, o / 2, n], dim=-1)


def unrolled(inputs: Tensor, h: Tensor, c: Tensor, weight: Tensor) -> Tensor:
    """Run an LSTM over known inputs.

    Args:
        inputs: [T, M, A, F].
        h: [M, A, H] first hidden state; it gets no gradient.
        c: [M, A, H] first cell; it gets no gradient.
        weight: [M, K, 4 H], from ``joined_weights``.

    Returns:
        Hidden states [T, M, A, H].
    """
    if kernels.serve(h):
        return Unrolled.apply(inputs, h, c, weight)
    hidden = []
    for x in inputs:
        h, c = _step(h, c, x, weight)
        hidden.append(h)
    return torch.stack(hidden)


def rolled_out(h: Tensor, first: Tensor, weight: Tensor, out: Tensor, bias: Tensor, steps: int, twins: bool) -> Tensor:
    """Run an LSTM that is fed its own output, from a cell of zeros.

    The output is a linear map of the hidden state, or of the difference of two of them.

    Args:
        h: [M, A, H] first hidden state; with twins [M, 2 A, H], each row followed by its twin.
        first: [M, A, F] input of the first step, which twins share; it gets no gradient.
        weight: [M, K, 4 H], from ``joined_weights``.
        out: [M, H, F] from the hidden state to the output.
        bias: [M, F] of the output.
        steps: Number of steps T.
        twins: Whether the output is taken of the hidden state less that of the twin, and fed to both.

    Returns:
        Outputs [T, M, A, F].
    """
    each = 2 if twins else 1
    if kernels.serve(h):
        return RolledOut.apply(h, first, weight, out, bias, steps, each)
    return torch.baddbmm(
        bias.repeat(steps, 1)[:, None],
        rolled_states(h, first, weight, out, bias, steps, twins).flatten(0, 1),
        out.repeat(steps, 1, 1),
    ).unflatten(0, (steps, -1))


def rolled_states(
    h: Tensor, first: Tensor, weight: Tensor, out: Tensor, bias: Tensor, steps: int, twins: bool
) -> Tensor:
    """What the outputs of ``rolled_out`` are a linear map of: hidden states [T, M, A, H], less those of the twins."""
    each = 2 if twins else 1
    c, fed, states = torch.zeros_like(h), first, []
    for _ in range(steps):
        h, c = _step(h, c, fed.repeat_interleave(each, dim=1), weight)
        states.append(h[:, 0::2] - h[:, 1::2] if twins else h)
        fed = torch.baddbmm(bias[:, None], states[-1], out)
    return torch.stack(states)


def _step(h: Tensor, c: Tensor, x: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Hidden state and cell, [M, A, H] each, after a step with input x [M, A, F]."""
    gates = torch.bmm(torch.cat([h, x, torch.ones_like(x[..., :1])], dim=-1), weight).tanh()
    i, f, o, n = gates.chunk(4, dim=-1)
    c = ((1 + f) * c + (1 + i) * n) / 2
    return (1 + o) / 2 * c.tanh(), c


@dataclass
class Tape:
    """What a forward pass over a slice of the rows leaves for the backward pass.

    Attributes:
        joined: [T + 1, M, A, K] at each step the hidden state before it, its input and a one; K = H + F + 1.
        gates: [T, M, A, 4 H] as ``kernels.lstm_forward`` leaves them.
        cells: [T + 1, M, A, H] before each step, and at the end.
    """

    joined: Tensor
    gates: Tensor
    cells: Tensor

    @classmethod
    def start(cls, steps: int, h: Tensor, inputs: int) -> Tape:
        """For first hidden states h [M, A, H] and a number of inputs."""
        models, rows, size = h.shape
        joined = h.new_empty(steps + 1, models, rows, size + inputs + 1)
        joined[0, ..., :size] = h
        joined[..., -1] = 1
        gates = h.new_empty(steps, models, rows, 4 * size)
        return cls(joined, gates, h.new_empty(steps + 1, models, rows, size))

    def step(self, t: int, weight: Tensor) -> None:
        """Find the hidden state and cell after step t, for weights [M, K, 4 H]."""
        gates = torch.bmm(self.joined[t], weight, out=self.gates[t])
        kernels.lstm_forward(
            gates.numpy(), self.cells[t].numpy(), self.cells[t + 1].numpy(), self.joined[t + 1].numpy()
        )


class Back:
    """The backward pass over a tape.

    Attributes:
        d_joined: [M, A, K], gradient of ``joined``: before ``step(t)`` of ``joined[t + 1]``, as far as it goes through
            later steps, and after it of ``joined[t]``.
        d_weight: [M, K, 4 H], gradient of the weights.
    """

    def __init__(self, tape: Tape, weight: Tensor):
        self.tape, self.weight = tape, weight
        self.d_joined = torch.zeros_like(tape.joined[0])
        self.d_weight = torch.zeros_like(weight)
        self._d_cells = torch.zeros_like(tape.cells[0])
        self._d_gates = torch.empty_like(tape.gates[0])

    def step(self, t: int) -> None:
        """Go back over step t."""
        tape = self.tape
        kernels.lstm_backward(
            tape.gates[t].numpy(),
            tape.cells[t].numpy(),
            tape.cells[t + 1].numpy(),
            self.d_joined.numpy(),
            self._d_cells.numpy(),
            self._d_gates.numpy(),
        )
        self.d_weight.baddbmm_(tape.joined[t].transpose(1, 2), self._d_gates)
        torch.bmm(self._d_gates, self.weight.transpose(1, 2), out=self.d_joined)


class Unrolled(torch.autograd.Function):
    """``unrolled`` by kernels."""

    @staticmethod
    def forward(ctx: Any, inputs: Tensor, h: Tensor, c: Tensor, weight: Tensor) -> Tensor:
        """Hidden states."""
        steps, size = len(inputs), h.shape[-1]
        hidden = h.new_empty(steps, *h.shape)

        def run(rows: slice) -> Tape:
            tape = Tape.start(steps, h[:, rows], inputs.shape[-1])
            tape.joined[:-1, ..., size:-1] = inputs[:, :, rows]
            tape.cells[0] = c[:, rows]
            for t in range(steps):
                tape.step(t, weight)
            hidden[:, :, rows] = tape.joined[1:, ..., :size]
            return tape

        ctx.slices = threads.slices(h.shape[1], len(h) * 4 * size)
        tapes = threads.side_by_side(run, ctx.slices)
        if any(ctx.needs_input_grad):
            ctx.tapes, ctx.weight = tapes, weight
        return hidden

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_hidden: Tensor) -> tuple[Tensor | None, None, None, Tensor]:  # type: ignore[override]
        """Gradients of the inputs, if needed, and of the weights."""
        weight = ctx.weight.detach()
        size = d_hidden.shape[-1]
        needed = ctx.needs_input_grad[0]
        d_inputs = d_hidden.new_empty(*d_hidden.shape[:-1], weight.shape[1] - size - 1) if needed else None

        def run(part: tuple[slice, Tape]) -> Tensor:
            rows, tape = part
            back = Back(tape, weight)
            for t in reversed(range(len(d_hidden))):
                back.d_joined[..., :size] += d_hidden[t][:, rows]
                back.step(t)
                if d_inputs is not None:
                    d_inputs[t][:, rows] = back.d_joined[..., size:-1]
            return back.d_weight

        d_weights = threads.side_by_side(run, list(zip(ctx.slices, ctx.tapes, strict=True)))
        return d_inputs, None, None, sum(d_weights)  # type: ignore[return-value]


class RolledOut(torch.autograd.Function):
    """``rolled_out`` by kernels; ``each`` is 2 with twins, else 1."""

    @staticmethod
    def forward(
        ctx: Any, h: Tensor, first: Tensor, weight: Tensor, out: Tensor, bias: Tensor, steps: int, each: int
    ) -> Tensor:
        """Outputs."""
        size = h.shape[-1]
        outputs = first.new_empty(steps, *first.shape)
        turned = out.transpose(1, 2).contiguous()

        def run(rows: slice) -> Tape:
            tape = Tape.start(steps, h[:, rows.start * each : rows.stop * each], first.shape[-1])
            tape.joined[0, ..., size:-1] = first[:, rows].repeat_interleave(each, dim=1)
            tape.cells[0] = 0
            for t in range(steps):
                tape.step(t, weight)
                kernels.feed(tape.joined[t + 1].numpy(), turned.numpy(), bias.detach().numpy(), each)
            outputs[:, :, rows] = tape.joined[1:, :, ::each, size:-1]
            return tape

        ctx.slices = threads.slices(first.shape[1], len(h) * each * 4 * size)
        tapes = threads.side_by_side(run, ctx.slices)
        if any(ctx.needs_input_grad):
            ctx.tapes, ctx.weight, ctx.turned, ctx.each = tapes, weight, turned, each
        return outputs

    @staticmethod
    @once_differentiable
    def backward(  # type: ignore[override]
        ctx: Any, d_outputs: Tensor
    ) -> tuple[Tensor, None, Tensor, Tensor, Tensor, None, None]:
        """Gradients of h, weight, out and bias."""
        weight, turned, each = ctx.weight.detach(), ctx.turned.detach(), ctx.each
        models, _, size = turned.shape
        d_outputs = d_outputs.contiguous()
        d_h = turned.new_empty(models, each * d_outputs.shape[2], size)

        def run(part: tuple[slice, Tape]) -> tuple[Tensor, Tensor, Tensor]:
            rows, tape = part
            back = Back(tape, weight)
            d_out, d_bias = torch.zeros_like(turned), turned.new_zeros(turned.shape[:2])
            for t in reversed(range(len(d_outputs))):
                kernels.feed_backward(
                    tape.joined[t + 1].numpy(),
                    back.d_joined.numpy(),
                    d_outputs[t].numpy(),
                    rows.start,
                    turned.numpy(),
                    each,
                    d_out.numpy(),
                    d_bias.numpy(),
                )
                back.step(t)
            d_h[:, rows.start * each : rows.stop * each] = back.d_joined[..., :size]
            return back.d_weight, d_out, d_bias

        found = threads.side_by_side(run, list(zip(ctx.slices, ctx.tapes, strict=True)))
        d_weight, d_out, d_bias = (sum(parts) for parts in zip(*found, strict=True))
        return d_h, None, d_weight, d_out.transpose(1, 2), d_bias, None, None  # type: ignore[union-attr, return-value]
