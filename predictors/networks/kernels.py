"""What the networks do on a CPU besides matrix products: numba kernels.

They take contiguous float32 arrays, release the GIL, and use one thread; see ``threads`` for more.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numba import njit
from numpy import float32
from torch import Tensor

SLOPE = 0.2
"""Of the leaky rectifier in the attention logits."""
EPSILON = 1e-5
"""Added to the variance before its root, in the normalisation over a scene's agents."""

# Sums may be reordered, which is what lets them be vectorised; that nothing is NaN must not be assumed.
kernel: Any = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})


def serve(x: Tensor) -> bool:
    """Whether the kernels can work on this tensor."""
    return x.device.type == "cpu" and x.dtype == torch.float32


@kernel
def tanh(x):  # type: ignore[no-untyped-def]
    """Hyperbolic tangent, to 4e-7: the rational approximation of Eigen, which is vectorised where libm is not."""
    most = float32(7.90531110763549805)  # where float32 reaches 1
    x = most if x > most else x
    x = -most if x < -most else x
    s = x * x
    p = float32(-2.76076847742355e-16)
    p = p * s + float32(2.00018790482477e-13)
    p = p * s + float32(-8.60467152213735e-11)
    p = p * s + float32(5.12229709037114e-08)
    p = p * s + float32(1.48572235717979e-05)
    p = p * s + float32(6.37261928875436e-04)
    p = p * s + float32(4.89352455891786e-03)
    q = float32(1.19825839466702e-06)
    q = q * s + float32(1.18534705686654e-04)
    q = q * s + float32(2.26843463243900e-03)
    q = q * s + float32(4.89352518554385e-03)
    return x * p / q


@kernel
def lstm_forward(gates, cells, after, joined):  # type: ignore[no-untyped-def]
    """One step of an LSTM after the matrix product.

    Args:
        gates: [M, A, 4 H] pre-activations, those of the logistic gates halved, order input, forget, output, cell;
            changed into their hyperbolic tangents.
        cells: [M, A, H] before the step.
        after: [M, A, H], written: the cells after it.
        joined: [M, A, K], the first H written: the hidden state.
    """
    models, rows, size = cells.shape
    half, one = float32(0.5), float32(1)
    for m in range(models):
        for r in range(rows):
            for k in range(4 * size):
                gates[m, r, k] = tanh(gates[m, r, k])
            for k in range(size):
                kept = (one + gates[m, r, size + k]) * cells[m, r, k]
                after[m, r, k] = half * (kept + (one + gates[m, r, k]) * gates[m, r, 3 * size + k])
            for k in range(size):
                joined[m, r, k] = half * (one + gates[m, r, 2 * size + k]) * tanh(after[m, r, k])


@kernel
def lstm_backward(gates, cells, after, d_joined, d_cells, d_gates):  # type: ignore[no-untyped-def]
    """Gradients of one step, for the arrays of ``lstm_forward``.

    Args:
        gates: [M, A, 4 H].
        cells: [M, A, H] before the step.
        after: [M, A, H], the cells after it.
        d_joined: [M, A, K], the first H of them the gradient of the hidden state after the step.
        d_cells: [M, A, H], gradient of the cells after the step; changed into that of the cells before it.
        d_gates: [M, A, 4 H], written: gradient of the pre-activations.
    """
    models, rows, size = cells.shape
    half, one = float32(0.5), float32(1)
    for m in range(models):
        for r in range(rows):
            # A loop for each gate: one that writes all four is not vectorised.
            for k in range(size):
                o, bounded, d = gates[m, r, 2 * size + k], tanh(after[m, r, k]), half * d_joined[m, r, k]
                d_gates[m, r, 2 * size + k] = d * bounded * (one - o * o)
                d_cells[m, r, k] = half * (d_cells[m, r, k] + d * (one + o) * (one - bounded * bounded))
            for k in range(size):
                i = gates[m, r, k]
                d_gates[m, r, k] = d_cells[m, r, k] * gates[m, r, 3 * size + k] * (one - i * i)
            for k in range(size):
                n = gates[m, r, 3 * size + k]
                d_gates[m, r, 3 * size + k] = d_cells[m, r, k] * (one + gates[m, r, k]) * (one - n * n)
            for k in range(size):
                f = gates[m, r, size + k]
                d_gates[m, r, size + k] = d_cells[m, r, k] * cells[m, r, k] * (one - f * f)
                d_cells[m, r, k] *= one + f


@kernel
def feed(joined, out, bias, each):  # type: ignore[no-untyped-def]
    """Put what an LSTM gives out in the place of its next input.

    Args:
        joined: [M, A, K], hidden state, input and a one; the input is written.
        out: [M, F, H] from the hidden state to the output.
        bias: [M, F] of the output.
        each: 1, or 2 where each row is followed by its twin, whose state is subtracted and who is fed the same.
    """
    models, rows, _ = joined.shape
    _, features, size = out.shape
    for m in range(models):
        for r in range(0, rows, each):
            for f in range(features):
                value = bias[m, f]
                for k in range(size):
                    value += joined[m, r, k] * out[m, f, k]
                if each == 2:
                    for k in range(size):
                        value -= joined[m, r + 1, k] * out[m, f, k]
                    joined[m, r + 1, size + f] = value
                joined[m, r, size + f] = value


@kernel
def feed_backward(joined, d_joined, d_outputs, first, out, each, d_out, d_bias):  # type: ignore[no-untyped-def]
    """Gradients of ``feed``.

    Args:
        joined: [M, each * a, K] after ``feed``.
        d_joined: [M, each * a, K] its gradient; to that of the hidden state is added what comes through the output.
        d_outputs: [M, A, F] gradient of the output itself, of all rows.
        first: Where the rows of ``joined`` start among those.
        out: [M, F, H].
        each: 1, or 2 with twins.
        d_out: [M, F, H], added to.
        d_bias: [M, F], added to.
    """
    models, rows, _ = joined.shape
    _, features, size = out.shape
    for m in range(models):
        for r in range(0, rows, each):
            for f in range(features):
                d = d_outputs[m, first + r // each, f] + d_joined[m, r, size + f]
                if each == 2:
                    d += d_joined[m, r + 1, size + f]
                d_bias[m, f] += d
                for k in range(size):
                    d_out[m, f, k] += d * joined[m, r, k]
                for k in range(size):
                    d_joined[m, r, k] += d * out[m, f, k]
                if each == 2:
                    for k in range(size):
                        d_out[m, f, k] -= d * joined[m, r + 1, k]
                    for k in range(size):
                        d_joined[m, r + 1, k] -= d * out[m, f, k]


@kernel
def normalise(x, limits, y, scale):  # type: ignore[no-untyped-def]
    """Features less their mean over the agents of a scene, divided by their standard deviation.

    Args:
        x: [B, A, C].
        limits: [S + 1], where scenes start.
        y: [B, A, C], written.
        scale: [B, S, C], written: one over the standard deviation.
    """
    batch, _, channels = x.shape
    total = np.empty(channels, float32)
    for b in range(batch):
        for s in range(len(limits) - 1):
            first, last = limits[s], limits[s + 1]
            share = float32(1) / float32(last - first)
            total[:] = 0
            for a in range(first, last):
                for c in range(channels):
                    total[c] += x[b, a, c]
            for c in range(channels):
                total[c] *= share
                scale[b, s, c] = 0
            for a in range(first, last):
                for c in range(channels):
                    y[b, a, c] = x[b, a, c] - total[c]
                    scale[b, s, c] += y[b, a, c] * y[b, a, c]
            for c in range(channels):
                scale[b, s, c] = float32(1) / np.sqrt(scale[b, s, c] * share + float32(EPSILON))
            for a in range(first, last):
                for c in range(channels):
                    y[b, a, c] *= scale[b, s, c]


@kernel
def normalise_backward(y, limits, scale, d):  # type: ignore[no-untyped-def]
    """Change the gradient ``d`` of y into that of x, for the arrays of ``normalise``."""
    batch, _, channels = y.shape
    total, along = np.empty(channels, float32), np.empty(channels, float32)
    for b in range(batch):
        for s in range(len(limits) - 1):
            first, last = limits[s], limits[s + 1]
            share = float32(1) / float32(last - first)
            total[:] = 0
            along[:] = 0
            for a in range(first, last):
                for c in range(channels):
                    total[c] += d[b, a, c]
                    along[c] += d[b, a, c] * y[b, a, c]
            for c in range(channels):
                total[c] *= share
                along[c] *= share
            for a in range(first, last):
                for c in range(channels):
                    d[b, a, c] = (d[b, a, c] - total[c] - y[b, a, c] * along[c]) * scale[b, s, c]


@kernel
def weigh(made, first, size, values, weights):  # type: ignore[no-untyped-def]
    """Values and attention weights of scenes of like size: softmax over j of leaky_relu(source_i + target_j).

    The exponential of a leaky rectifier is the larger of two products, e^source e^target and the same of the scaled
    parts, so that the n x n exponentials are products of n.

    Args:
        made: [B, A, heads * F + 2 * heads] values, then sources, then targets.
        first: [S] first agent of each scene.
        size: [S] number of its agents, at most n.
        values: [B, S, heads, n, F], written; zero where nobody is.
        weights: [B, S, heads, n, n], written; zero where nobody is.
    """
    batch, scenes, heads, most, features = values.shape
    columns = heads * features
    share, share_scaled = np.empty(most, float32), np.empty(most, float32)
    for b in range(batch):
        for s in range(scenes):
            n = size[s]
            rows = made[b, first[s] : first[s] + n]
            for h in range(heads):
                source, target = columns + h, columns + heads + h
                top = rows[0, target]
                for j in range(n):
                    top = max(top, rows[j, target])
                    for f in range(features):
                        values[b, s, h, j, f] = rows[j, h * features + f]
                values[b, s, h, n:] = 0
                weights[b, s, h, n:] = 0
                share[n:] = 0
                share_scaled[n:] = 0
                for j in range(n):
                    below = rows[j, target] - top
                    share[j], share_scaled[j] = np.exp(below), np.exp(float32(SLOPE) * below)
                for i in range(n):
                    row, logit = weights[b, s, h, i], rows[i, source] + top
                    other = np.exp(float32(SLOPE - 1) * abs(logit))
                    gain, gain_scaled = (float32(1), other) if logit > 0 else (other, float32(1))
                    total = float32(0)
                    for j in range(most):
                        row[j] = max(gain * share[j], gain_scaled * share_scaled[j])
                    for j in range(most):
                        total += row[j]
                    total = float32(1) / total
                    for j in range(most):
                        row[j] *= total


@kernel
def spread(found, first, size, bias, rectify, out):  # type: ignore[no-untyped-def]
    """Put what was attended in its place.

    Args:
        found: [B, S, heads, n, F].
        first: As in ``weigh``.
        size: As in ``weigh``.
        bias: [B, F], added.
        rectify: Whether to end with an exponential linear unit.
        out: [B, A, heads * F], written.
    """
    batch, scenes, heads, _, features = found.shape
    for b in range(batch):
        for s in range(scenes):
            for h in range(heads):
                for i in range(size[s]):
                    row, given = out[b, first[s] + i, h * features : (h + 1) * features], found[b, s, h, i]
                    for f in range(features):
                        row[f] = given[f] + bias[b, f]
                    if rectify:
                        for f in range(features):
                            if row[f] < 0:
                                row[f] = np.exp(row[f]) - float32(1)


@kernel
def spread_backward(d_out, out, first, size, rectify, d_found, d_bias):  # type: ignore[no-untyped-def]
    """Gradients of ``spread``: ``d_found`` is written, and zero where nobody is; ``d_bias`` is added to."""
    batch, scenes, heads, _, features = d_found.shape
    for b in range(batch):
        for s in range(scenes):
            for h in range(heads):
                d_found[b, s, h, size[s] :] = 0
                for i in range(size[s]):
                    columns = slice(h * features, (h + 1) * features)
                    d, given, row = d_out[b, first[s] + i, columns], out[b, first[s] + i, columns], d_found[b, s, h, i]
                    for f in range(features):
                        row[f] = d[f] * (min(given[f], float32(0)) + float32(1)) if rectify else d[f]
                    for f in range(features):
                        d_bias[b, f] += row[f]


@kernel
def weigh_backward(made, first, size, weights, d_weights, d_values, d_made):  # type: ignore[no-untyped-def]
    """Gradients of ``weigh``.

    Args:
        made: As in ``weigh``.
        first: As in ``weigh``.
        size: As in ``weigh``.
        weights: What ``weigh`` wrote.
        d_weights: [B, S, heads, n, n], gradient of it; changed into that of the logits.
        d_values: [B, S, heads, n, F].
        d_made: [B, A, heads * F + 2 * heads], written.
    """
    batch, scenes, heads, most, features = d_values.shape
    columns, slope = heads * features, float32(SLOPE)
    targets, d_targets = np.empty(most, float32), np.empty(most, float32)
    for b in range(batch):
        for s in range(scenes):
            n = size[s]
            rows, written = made[b, first[s] : first[s] + n], d_made[b, first[s] : first[s] + n]
            for h in range(heads):
                targets[n:] = 0
                d_targets[:] = 0
                for j in range(n):
                    targets[j] = rows[j, columns + heads + h]
                    for f in range(features):
                        written[j, h * features + f] = d_values[b, s, h, j, f]
                for i in range(n):
                    w, d, source = weights[b, s, h, i], d_weights[b, s, h, i], rows[i, columns + h]
                    mean = d_source = float32(0)
                    for j in range(most):
                        mean += w[j] * d[j]
                    for j in range(most):
                        d[j] = w[j] * (d[j] - mean) * (float32(1) if source + targets[j] > 0 else slope)
                    for j in range(most):
                        d_targets[j] += d[j]
                    for j in range(most):
                        d_source += d[j]
                    written[i, columns + h] = d_source
                for j in range(n):
                    written[j, columns + heads + h] = d_targets[j]
