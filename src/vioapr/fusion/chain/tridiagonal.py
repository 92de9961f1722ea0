"""Symmetric block-tridiagonal systems: their solution, and the inverse's blocks that matter.

What a chain of poses leads to, in time and memory linear in its length.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_linalg: Any = import_module("scipy.linalg")  # has no types


class BlockTridiagonal(NamedTuple):
    """A symmetric positive definite matrix of n x n blocks of size d.

    Attributes:
        diagonal: Shape (n, d, d).
        above: The blocks to the right of these, shape (n - 1, d, d).
    """

    diagonal: NDArray[np.float64]
    above: NDArray[np.float64]

    def solve(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """The x of A x = right, shapes (n, d), by a banded Cholesky factorization."""
        count, size = right.shape
        bands = np.zeros((2 * size, count * size))
        for row in range(size):
            for column in range(row, size):
                bands[row - column - 1, column::size] = self.diagonal[:, row, column]
            for column in range(size):
                bands[row - column - size - 1, size + column :: size] = self.above[:, row, column]
        return _linalg.solveh_banded(bands, right.ravel(), check_finite=False).reshape(count, size)

    def inverse_diagonal(self) -> NDArray[np.float64]:
        """The diagonal blocks of the inverse, shape (n, d, d)."""
        return self._inverse()[0]

    def _inverse(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The inverse's blocks on and right of the diagonal, by odd-even (cyclic) reduction.

        Every second unknown is eliminated, which leaves a system of half the size; with the
        inverse of that the eliminated ones follow.
        """
        count = len(self.diagonal)
        if count == 1:
            return np.linalg.inv(self.diagonal).astype(np.float64), self.above
        own = np.linalg.inv(self.diagonal[1::2])
        # An odd unknown is -(to_left x_left + to_right x_right), if it is given the others.
        to_left = own @ self.above[::2].mT
        to_right = own[: len(self.above[1::2])] @ self.above[1::2]
        kept = self.diagonal[::2].copy()
        kept[: len(to_left)] -= self.above[::2] @ to_left
        kept[1 : len(to_right) + 1] -= self.above[1::2].mT @ to_right
        linked = -self.above[::2][: len(to_right)] @ to_right
        even, between = BlockTridiagonal(kept, linked)._inverse()
        diagonal, above = np.empty_like(self.diagonal), np.empty_like(self.above)
        diagonal[::2] = even
        with_left = -to_left @ even[: len(to_left)]
        with_left[: len(to_right)] -= to_right @ between.mT
        with_right = -to_right @ even[1 : len(to_right) + 1] - to_left[: len(to_right)] @ between
        diagonal[1::2] = own - with_left @ to_left.mT
        diagonal[1::2][: len(to_right)] -= with_right @ to_right.mT
        above[::2], above[1::2] = with_left.mT, with_right
        return diagonal, above
