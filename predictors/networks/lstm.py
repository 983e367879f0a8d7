"""LSTMs of several models at once: every weight has a leading model axis M, and every matrix product is batched.

Hidden state, input and a one for the bias are concatenated, so that a step is a single product.
"""

from __future__ import annotations

import torch
from torch import Tensor

from motion_gym.predictors.networks.kernels import lstm_cell


def joined_weights(inputs: Tensor, hidden: Tensor, bias: Tensor) -> Tensor:
    """Weights [M, H + F + 1, 4 H] for ``unrolled`` and ``rolled_out``, from weights in torch's order of gates.

    Torch's order is input, forget, cell, output. The result has the order of ``kernels.lstm_cell``: input, forget,
    output, cell, all but the last halved.

    Args:
        inputs: [M, F, 4 H] from the input to the gates.
        hidden: [M, H, 4 H] from the hidden state to the gates.
        bias: [M, 4 H].
    """
    i, f, n, o = torch.cat([hidden, inputs, bias[:, None]], dim=1).chunk(4, dim=-1)
    return torch.cat([i / 2, f / 2, o / 2, n], dim=-1)


def unrolled(inputs: Tensor, h: Tensor, c: Tensor, weight: Tensor) -> Tensor:
    """Run an LSTM over known inputs.

    Args:
        inputs: [T, M, A, F].
        h: [M, A, H] initial hidden states.
        c: [M, A, H] initial cells.
        weight: [M, K, 4 H], from ``joined_weights``.

    Returns:
        Hidden states [T, M, A, H].
    """
    hidden = []
    for x in inputs:
        h, c = _step(h, c, x, weight)
        hidden.append(h)
    return torch.stack(hidden)


def rolled_out(
    h: Tensor, first: Tensor, weight: Tensor, out: Tensor, bias: Tensor, steps: int, twins: bool
) -> tuple[Tensor, Tensor]:
    """Run an LSTM on its own output, from cells of zeros.

    The output is a linear map of the hidden state, or of the difference of two hidden states.

    Args:
        h: [M, A, H] initial hidden states; with twins [M, 2 A, H], each row followed by its twin.
        first: [M, A, F] input of the first step, shared by twins.
        weight: [M, K, 4 H], from ``joined_weights``.
        out: [M, H, F] from the hidden state to the output.
        bias: [M, F] of the output.
        steps: Number of steps T.
        twins: Whether the output is computed from the hidden state minus that of the twin, and fed to both.

    Returns:
        Outputs [T, M, A, F], and the states [T, M, A, H] that the linear map is applied to.
    """
    c, fed, outputs, states = torch.zeros_like(h), first, [], []
    for _ in range(steps):
        h, c = _step(h, c, fed.repeat_interleave(2, dim=1) if twins else fed, weight)
        states.append(h[:, 0::2] - h[:, 1::2] if twins else h)
        fed = torch.baddbmm(bias[:, None], states[-1], out)
        outputs.append(fed)
    return torch.stack(outputs), torch.stack(states)


def _step(h: Tensor, c: Tensor, x: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Hidden states and cells, [M, A, H] each, after a step with input x [M, A, F]."""
    return lstm_cell(torch.bmm(torch.cat([h, x, torch.ones_like(x[..., :1])], dim=-1), weight), c)
