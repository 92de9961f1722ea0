"""Smoothing of local level models: noisy random walks, many at once.

Unknowns x_k, k = 0 (newest) to n - 1, minimize
sum w_k (y_k - x_k)^2 + sum t_k (x_k - x_k+1)^2: the posterior of a random walk, whose steps have
variances 1 / t_k, that is seen with errors of variances 1 / w_k. The normal equations are
tridiagonal. Parallel cyclic reduction (Hockney and Jesshope, Parallel Computers 2, section 5.4)
solves them in log2 n steps without branches or loops over k, the same in NumPy, PyTorch and in a
graph. In the end each unknown stands alone in its equation, whose factor is the precision of its
marginal distribution.

Each equation is kept as (excess + couplings) x_k = ..., the diagonal split into its parts. So
nothing is ever subtracted, and float32 loses no digits, however stiff the walk.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vioapr.geometry.arrays import Array, constant, namespace

_TINY = 1e-30


def smooth(values: Array, weights: Array, stiffness: Array) -> tuple[Array, Array]:
    """Smooth random walks that are seen with errors.

    Args:
        values: y, shape (..., k, n).
        weights: w, precisions of the values, at least 0, shape (..., k, n).
        stiffness: t, precisions of the steps from k + 1 to k, shape (..., k, n), the last one 0.

    Returns:
        x, and the precisions of its marginals, both of shape (..., k, n). Where no value that
        counts is connected, x is 0 and so is the precision.
    """
    xp = namespace(values)
    count, span = values.shape[-1], 1
    # Excess and right side; couplings to the newer and to the older neighbour.
    own = xp.concat([weights[..., None, :, :], (weights * values)[..., None, :, :]], axis=-3)
    to_older = stiffness[..., None, :, :]
    to_newer = newer_by(to_older, 1)
    while span < count:
        diagonal = own[..., :1, :, :] + to_newer + to_older
        inverse = 1 / xp.maximum(diagonal, _TINY)
        scaled = own * inverse
        newer = newer_by(xp.concat([scaled, to_newer * inverse], axis=-3), span)
        older = older_by(xp.concat([scaled, to_older * inverse], axis=-3), span)
        own = own + to_newer * newer[..., :2, :, :] + to_older * older[..., :2, :, :]
        to_newer = to_newer * newer[..., 2:, :, :]
        to_older = to_older * older[..., 2:, :, :]
        span *= 2
    excess, right = own[..., 0, :, :], own[..., 1, :, :]
    return right / xp.maximum(excess, _TINY), excess


def newer_by(values: Array, span: int) -> Array:
    """The values of k - span at k, 0 where there is none."""
    return namespace(values).concat([_zeros(values, span), values[..., :-span]], axis=-1)


def older_by(values: Array, span: int) -> Array:
    """The values of k + span at k, 0 where there is none."""
    return namespace(values).concat([values[..., span:], _zeros(values, span)], axis=-1)


def _zeros(values: Array, span: int) -> Array:
    return constant(_zeros_of((*values.shape[:-1], span)), values)


@lru_cache(64)
def _zeros_of(shape: tuple[int, ...]) -> np.ndarray:
    """Kept: making new ones costs more than a shift."""
    return np.zeros(shape)
