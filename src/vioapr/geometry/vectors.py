"""Angles between directions, and lengths of what a point moved: NumPy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

STANDARD_GRAVITY_M_S2 = 9.80665
"""CGPM 1901."""


def angle_between_deg(left: ArrayLike, right: ArrayLike) -> NDArray[np.float64]:
    """The angle between vectors in degrees, 0 to 180, shapes (..., 3) to (...).

    By 2 atan2(|a - b|, |a + b|) of the unit vectors (Kahan 2006), which keeps its precision
    near 0 and 180 degrees, where the arccos of the scalar product loses half the digits.

    Args:
        left: Of any length but 0.
        right: In the same frame; the batch shapes are broadcast.
    """
    a, b = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    return np.degrees(
        2 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    )


def step_lengths_m(position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distances between consecutive positions, shapes (n, 3) to (n - 1,)."""
    return np.linalg.norm(np.diff(position_m, axis=0), axis=1)


def path_length_m(position_m: NDArray[np.float64]) -> float:
    """The length of the polyline through positions, shape (n, 3)."""
    return float(step_lengths_m(position_m).sum())


def distance_along_m(position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The length of the polyline up to each of its points, shapes (n, 3) to (n,)."""
    return np.concatenate([[0.0], np.cumsum(step_lengths_m(position_m))])
