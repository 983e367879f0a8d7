"""Operations on vectors in the plane, and how the loops of the engine are compiled."""

from __future__ import annotations

import numpy as np

from motion_gym.compiled import compiled

ZERO, HALF, ONE, TINY = np.float32(0), np.float32(0.5), np.float32(1), np.float32(1e-30)

# Without fastmath no operation is reordered or fused.
loop = compiled()


@loop
def dot(ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Scalar product of a and b."""
    return ax * bx + ay * by


@loop
def cross(ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Signed area spanned by a and b."""
    return ax * by - ay * bx
