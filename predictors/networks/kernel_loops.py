"""The numba loops of ``kernels``: they take contiguous float32 arrays, release the GIL, and use one thread."""

from __future__ import annotations

import numpy as np
from numpy import float32

from motion_gym.compiled import compiled

SLOPE = 0.2
"""Slope of the leaky rectifier in the attention logits."""
EPSILON = 1e-5
"""Added to the variance in the normalisation over the agents of a scene."""

# The compiler may reorder sums, to vectorise them, but must not assume that no value is NaN.
kernel = compiled(fastmath={"contract", "reassoc", "nsz", "arcp"})


@kernel
def tanh(x):  # type: ignore[no-untyped-def]
    """Hyperbolic tangent, to 4e-7: the rational approximation of Eigen, which the compiler can vectorise."""
    most = float32(7.90531110763549805)  # the result rounds to 1 in float32
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
def lstm_forward(gates, cells, hidden, after):  # type: ignore[no-untyped-def]
    """``lstm_cell`` of rows [R, ...]; overwrites the gates with their hyperbolic tangents."""
    rows, size = cells.shape
    half, one = float32(0.5), float32(1)
    for r in range(rows):
        for k in range(4 * size):
            gates[r, k] = tanh(gates[r, k])
        for k in range(size):
            kept = (one + gates[r, size + k]) * cells[r, k]
            after[r, k] = half * (kept + (one + gates[r, k]) * gates[r, 3 * size + k])
        for k in range(size):
            hidden[r, k] = half * (one + gates[r, 2 * size + k]) * tanh(after[r, k])


@kernel
def lstm_backward(gates, cells, after, d_hidden, d_after, d_gates, d_cells):  # type: ignore[no-untyped-def]
    """Gradients of the gates and of the cells before the step, for the arrays of ``lstm_forward``."""
    rows, size = cells.shape
    half, one = float32(0.5), float32(1)
    for r in range(rows):
        # One loop per gate: the compiler does not vectorise a loop that writes all four.
        for k in range(size):
            o, bounded, d = gates[r, 2 * size + k], tanh(after[r, k]), half * d_hidden[r, k]
            d_gates[r, 2 * size + k] = d * bounded * (one - o * o)
            d_cells[r, k] = half * (d_after[r, k] + d * (one + o) * (one - bounded * bounded))
        for k in range(size):
            i = gates[r, k]
            d_gates[r, k] = d_cells[r, k] * gates[r, 3 * size + k] * (one - i * i)
        for k in range(size):
            n = gates[r, 3 * size + k]
            d_gates[r, 3 * size + k] = d_cells[r, k] * (one + gates[r, k]) * (one - n * n)
        for k in range(size):
            f = gates[r, size + k]
            d_gates[r, size + k] = d_cells[r, k] * cells[r, k] * (one - f * f)
            d_cells[r, k] *= one + f


@kernel
def normalise_forward(x, limits, y, scale):  # type: ignore[no-untyped-def]
    """``normalise`` of arrays [B, A, C]; writes y and scale [B, S, C], the inverse standard deviation."""
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
def normalise_backward(y, scale, d_y, limits, d_x):  # type: ignore[no-untyped-def]
    """Gradient of x, for the arrays of ``normalise_forward``."""
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
                    total[c] += d_y[b, a, c]
                    along[c] += d_y[b, a, c] * y[b, a, c]
            for a in range(first, last):
                for c in range(channels):
                    off = d_y[b, a, c] - share * (total[c] + y[b, a, c] * along[c])
                    d_x[b, a, c] = off * scale[b, s, c]


@kernel
def exponentials(rows, target, tops, share, scaled):  # type: ignore[no-untyped-def]
    """Write exp(target_j - top) and the same of the scaled difference, for the targets in a column; return top."""
    top = rows[0, target]
    for j in range(len(rows)):
        top = max(top, rows[j, target])
    for j in range(len(rows)):
        below = rows[j, target] - top
        tops[j], share[j], scaled[j] = below, np.exp(below), np.exp(float32(SLOPE) * below)
    return top


@kernel
def weigh(logit, n, share, scaled, row):  # type: ignore[no-untyped-def]
    """Write the attention weights of an agent; ``logit`` is its source plus the top target.

    The exponential of a leaky rectifier is the larger of two products: exp(source) exp(target), and the same of the
    scaled parts. This needs n exponentials instead of n x n.
    """
    other = np.exp(float32(SLOPE - 1) * abs(logit))
    gain, gain_scaled = (float32(1), other) if logit > 0 else (other, float32(1))
    total = float32(0)
    for j in range(n):
        row[j] = max(gain * share[j], gain_scaled * scaled[j])
    for j in range(n):
        total += row[j]
    total = float32(1) / total
    for j in range(n):
        row[j] *= total


@kernel
def attend_forward(projected, limits, bias, rectify, out):  # type: ignore[no-untyped-def]
    """``attend`` of arrays [B, A, ...] with the bias [B, F]."""
    batch, agents, width = projected.shape
    features = bias.shape[1]
    heads = width // (features + 2)
    tops, share = np.empty(agents, float32), np.empty(agents, float32)
    scaled, row = np.empty(agents, float32), np.empty(agents, float32)
    for b in range(batch):
        for s in range(len(limits) - 1):
            first, n = limits[s], limits[s + 1] - limits[s]
            if n == 0:
                continue
            rows = projected[b, first : first + n]
            for h in range(heads):
                columns = slice(h * features, (h + 1) * features)
                top = exponentials(rows, heads * features + heads + h, tops, share, scaled)
                for i in range(n):
                    weigh(rows[i, heads * features + h] + top, n, share, scaled, row)
                    written = out[b, first + i, columns]
                    written[:] = bias[b]
                    for j in range(n):
                        value, weight = rows[j, columns], row[j]
                        for f in range(features):
                            written[f] += weight * value[f]
                    if rectify:
                        for f in range(features):
                            if written[f] < 0:
                                written[f] = np.exp(written[f]) - float32(1)


@kernel
def attend_backward(projected, out, d_out, limits, rectify, d_projected, d_bias):  # type: ignore[no-untyped-def]
    """Gradients of ``attend_forward``: writes d_projected, adds to d_bias [B, F], recomputes the weights."""
    batch, agents, width = projected.shape
    features = d_bias.shape[1]
    heads = width // (features + 2)
    tops, share, scaled = np.empty(agents, float32), np.empty(agents, float32), np.empty(agents, float32)
    row, d_row, d = np.empty(agents, float32), np.empty(agents, float32), np.empty(features, float32)
    d_projected[:] = 0
    for b in range(batch):
        for s in range(len(limits) - 1):
            first, n = limits[s], limits[s + 1] - limits[s]
            if n == 0:
                continue
            rows, written = projected[b, first : first + n], d_projected[b, first : first + n]
            for h in range(heads):
                columns = slice(h * features, (h + 1) * features)
                source, target = heads * features + h, heads * features + heads + h
                top = exponentials(rows, target, tops, share, scaled)
                for i in range(n):
                    logit = rows[i, source] + top
                    weigh(logit, n, share, scaled, row)
                    output, upstream = out[b, first + i, columns], d_out[b, first + i, columns]
                    for f in range(features):
                        d[f] = upstream[f] * (min(output[f], float32(0)) + float32(1)) if rectify else upstream[f]
                    for f in range(features):
                        d_bias[b, f] += d[f]
                    mean = d_source = float32(0)
                    for j in range(n):
                        value, d_value, weight, slope = rows[j, columns], written[j, columns], row[j], float32(0)
                        for f in range(features):
                            slope += d[f] * value[f]
                        for f in range(features):
                            d_value[f] += weight * d[f]
                        d_row[j] = slope
                        mean += weight * slope
                    for j in range(n):
                        d_logit = row[j] * (d_row[j] - mean) * (float32(1) if logit + tops[j] > 0 else float32(SLOPE))
                        written[j, target] += d_logit
                        d_source += d_logit
                    written[i, source] = d_source
