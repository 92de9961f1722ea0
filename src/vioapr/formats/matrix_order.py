"""Whether 4x4 matrices are written row by row or column by column: their 0 0 0 1 tells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TRANSPOSED = (
    "matrices are written in the other order of rows and columns than the format's, as their "
    "0 0 0 1 shows: read transposed"
)
"""To be said of a file whose matrices are not in its format's order."""

_ZERO = 1e-6
_MOSTLY = 0.9


def are_transposed(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Find matrices whose last column is 0 0 0 1, and whose last row is not.

    Args:
        matrices: Of rigid transforms, shape (n, 4, 4), or (n, 3, 4), which tell nothing.

    Returns:
        Shape (n,).
    """
    if matrices.shape[1:] != (4, 4):
        return np.zeros(len(matrices), dtype=bool)
    return _is_bottom(matrices[:, :, 3]) & ~_is_bottom(matrices[:, 3, :])


def to_rows(matrices: NDArray[np.float64]) -> tuple[NDArray[np.float64], bool]:
    """Transpose the matrices of a file, if most of those that tell say so.

    A matrix without a translation tells nothing, and goes with the others.

    Args:
        matrices: Shape (n, 4, 4), NaN where there is none.

    Returns:
        The matrices, and whether they are transposed.
    """
    is_transposed = are_transposed(matrices)
    tells = is_transposed | (_is_bottom(matrices[:, 3, :]) & ~_is_bottom(matrices[:, :, 3]))
    if not tells.any() or is_transposed[tells].mean() < _MOSTLY:
        return matrices, False
    return np.swapaxes(matrices, 1, 2), True


def explain_transposed(matrix: NDArray[np.float64]) -> str:
    """Say what is wrong with a matrix that is transposed, shape (4, 4)."""
    return f"{explain_last_row(matrix)}: written column by column?"


def explain_last_row(matrix: NDArray[np.float64]) -> str:
    """Say what is wrong with the last row of a matrix, shape (4, 4); "" if nothing is."""
    if _is_bottom(matrix[3]):
        return ""
    got = " ".join(f"{value:.4g}" for value in matrix[3].tolist())
    return f"expected 0 0 0 1 as the last row of a matrix, got {got}"


def _is_bottom(vectors: NDArray[np.float64]) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(vectors - [0.0, 0.0, 0.0, 1.0]) < _ZERO).all(axis=-1))
