"""Operations on float32 arrays with x and y as the first axis."""

from __future__ import annotations

import numpy as np

ONE, HALF, TINY = np.float32(1), np.float32(0.5), np.float32(1e-30)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product along the first axis."""
    return a[0] * b[0] + a[1] * b[1]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Signed area along the first axis."""
    return a[0] * b[1] - a[1] * b[0]


def select(mask: np.ndarray, yes: np.ndarray, no: np.ndarray) -> np.ndarray:
    """``numpy.where`` for finite numbers, without branches: several times faster."""
    mask = mask.astype(np.float32)
    return yes * mask + no * (ONE - mask)


def put(array: np.ndarray, place: np.ndarray, value: np.ndarray) -> None:
    """``array[:, place] = value`` row by row, which is several times faster."""
    array[0][place], array[1][place] = value
