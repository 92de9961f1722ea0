"""Helpers for code that runs on any Array API backend (NumPy, PyTorch, traced PyTorch)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import array_api_compat
import array_api_compat.numpy
import numpy as np

Array = Any
"""An array of any backend that follows the Python Array API standard."""


_NUMPY_TYPES = (np.ndarray, np.generic)


def namespace(*arrays: Array) -> Any:
    """The Array API namespace that the arrays belong to."""
    # NumPy's case is short-cut: it is the streaming one, where microseconds count.
    for array in arrays:
        if not isinstance(array, _NUMPY_TYPES):
            return array_api_compat.array_namespace(*arrays)
    return array_api_compat.numpy


def constant(values: np.ndarray | float, like: Array) -> Array:
    """`values` as an array with the namespace, dtype and device of `like`."""
    xp = namespace(like)
    if xp is array_api_compat.numpy:
        return np.asarray(values, dtype=like.dtype)
    return xp.asarray(
        np.asarray(values).tolist(), dtype=like.dtype, device=array_api_compat.device(like)
    )


def zeros(shape: tuple[int, ...], like: Array) -> Array:
    """Zeros with the namespace, dtype and device of `like`."""
    return namespace(like).zeros(shape, dtype=like.dtype, device=array_api_compat.device(like))


def norm(vectors: Array) -> Array:
    """Euclidean length over the last axis, shape (..., n) to (...)."""
    xp = namespace(vectors)
    return xp.sqrt(xp.sum(vectors * vectors, axis=-1))


def select(condition: Array, if_true: Array, if_false: Array) -> Array:
    """`where` for values that have more trailing axes than the condition.

    Args:
        condition: Booleans, shape (...).
        if_true: Values, shape (...) followed by any axes.
        if_false: Values of the same shapes.
    """
    xp = namespace(condition, if_true)
    trailing = if_true.ndim - condition.ndim
    return xp.where(condition[(..., *(None,) * trailing)], if_true, if_false)


def holds_nowhere(condition: Array) -> bool:
    """Whether it is certain that a condition holds in no row, so that work can be left out.

    Known in NumPy only; see `compute_where`.
    """
    return namespace(condition) is array_api_compat.numpy and not condition.any()


def holds_everywhere(condition: Array) -> bool:
    """Whether it is certain that a condition holds in all rows; see `holds_nowhere`."""
    return namespace(condition) is array_api_compat.numpy and bool(condition.all())


def compute_where(
    condition: Array,
    compute: Callable[..., tuple[Array, ...]],
    inputs: tuple[Array, ...],
    otherwise: tuple[Array, ...],
) -> tuple[Array, ...]:
    """`compute(*inputs)` in the rows where a condition holds, `otherwise` in the others.

    For what is costly and rarely needed. NumPy computes the needed rows only. Other backends
    compute all and select: which rows are needed is not known when a graph is traced, and not
    worth a synchronization on a GPU.

    Args:
        condition: Booleans, the batch shape (...).
        compute: From arrays of shape (rows, ...) to a tuple of arrays of shape (rows, ...).
        inputs: Arrays of the batch shape and further axes.
        otherwise: Arrays of the batch shape and the further axes of the results.
    """
    if namespace(condition, *inputs) is not array_api_compat.numpy:
        computed = compute(*inputs)
        return tuple(select(condition, *pair) for pair in zip(computed, otherwise, strict=True))
    if holds_nowhere(condition):
        return otherwise
    results = tuple(np.array(array) for array in otherwise)
    computed = compute(*(array[condition] for array in inputs))
    for result, values in zip(results, computed, strict=True):
        result[condition] = values
    return results
