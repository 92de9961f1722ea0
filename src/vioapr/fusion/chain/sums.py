"""Sums, medians and squared lengths over the predictions in the window of method `chain`."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from vioapr.geometry.arrays import Array, Mask, constant, namespace

_FEW = 5
"""Predictions from which on a median says something."""


def total(values: Array) -> Array:
    """Sum over the predictions, shape (..., k, n) to (..., k, 1)."""
    return values @ constant(_ones(values.shape[-1]), values)


@cache
def _ones(count: int) -> np.ndarray:
    return np.ones((count, 1))


def squared_lengths(vectors: Array) -> Array:
    """Of the two vectors of each prediction, shape (..., 6, n) to (..., 2, n)."""
    return constant(_SUMS_OF_THREE, vectors) @ (vectors * vectors)


_SUMS_OF_THREE = np.kron(np.eye(2), np.ones((1, 3)))


def squared_length(vectors: Array) -> Array:
    """Of vectors side by side, shape (..., k, n) to (..., 1, n)."""
    return constant(_row(vectors.shape[-2]), vectors) @ (vectors * vectors)


def row_sum(values: Array) -> Array:
    """Over the rows, shape (..., k, n) to (..., 1, n)."""
    return constant(_row(values.shape[-2]), values) @ values


@cache
def _row(count: int) -> np.ndarray:
    return np.ones((1, count))


def to_axes(values: Array) -> Array:
    """One row for orientation and one for position as six of axes, (..., 2, n) to (..., 6, n)."""
    return constant(_AXES, values) @ values


_AXES = _SUMS_OF_THREE.T


def largest(values: Array) -> Array:
    """Of the two rows, shape (..., 2, n) to (..., 1, n)."""
    return namespace(values).maximum(values[..., :1, :], values[..., 1:, :])


class Typical(NamedTuple):
    """Picks the lower median of the values of some predictions.

    Attributes:
        absent: Shape (..., k, n), a huge number for predictions that do not count, else 0.
        is_middle: Shape (..., k, n), 1 at the median's place in the sorted values, else 0.
        is_few: Shape (..., k, 1), whether too few predictions count.
    """

    absent: Array
    is_middle: Array
    is_few: Mask

    def median(self, values: Array) -> Array:
        """Of values of shape (..., m, n), m being k or k being 1: shape (..., m, 1)."""
        xp = namespace(values)
        return total(xp.sort(values + self.absent, axis=-1) * self.is_middle)


def typical_of(counts: Array) -> Typical:
    """Of the predictions where `counts`, shape (..., k, n), is 1 and not 0."""
    xp = namespace(counts)
    number = total(counts)
    index = constant(_indices(counts.shape[-1]), counts)
    is_middle = xp.astype(index == xp.floor((number - 1) / 2), counts.dtype)
    return Typical((1 - counts) * 1e12, is_middle, number < _FEW)


@cache
def _indices(count: int) -> np.ndarray:
    return np.arange(float(count))


def largest_of_three(values: Array) -> Array:
    """Of each three rows, shape (..., 3 k, 1) to (..., k, 1)."""
    xp = namespace(values)
    threes = xp.reshape(values, (*values.shape[:-2], values.shape[-2] // 3, 3))
    return xp.max(threes, axis=-1, keepdims=True)
