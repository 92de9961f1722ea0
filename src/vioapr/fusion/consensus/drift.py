"""How fast VIO drifts, judged by the votes of method `consensus`.

Samples a_i = level + drift_i + error_i. The drift is a random walk over the odometer: two
samples share the drift of the way that both have come since. Errors of similar views are
correlated; those of different views are not, and that is what tells drift from error. All
covariances are in units of the errors' variance, which need not be known. For each candidate of
the drift's size, the marginal likelihood of the samples is a closed form (kriging with an
unknown mean; Rasmussen and Williams, Gaussian Processes for Machine Learning, sections 2.7 and
5.4). Its average over the walk gives the candidates their weights.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.votes import ViewGaps
from vioapr.geometry.arrays import Array, constant, namespace

LOG10_RATES = np.array([-2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
"""Candidates: variance that VIO drifts by in a metre, in units of the errors' variance."""

CORRELATED_PART = 1 / 30
"""The likelihood's errors include the slow part that the votes' scatter does not show; their
variance is larger than the scatter's by about this factor, and rates in its units smaller."""

_ERROR_LENGTH_RAD = 0.35
"""Turn after which the errors of a regressor are other ones."""

_WHITE = 0.15
"""Share of the errors' variance that changes from frame to frame whatever the view."""

_PRIOR_DEGREES = 0.5
"""Degrees of freedom that the expected variance of the errors is worth."""


class Channel(NamedTuple):
    """What of the samples drifts together, and the size expected of its errors.

    Attributes:
        components: Columns of the samples.
        noise: Shape (...), standard deviation.
    """

    components: slice
    noise: Array


class Evidence(NamedTuple):
    """Of one channel, for every candidate, shape (..., g).

    Attributes:
        log_likelihood: Up to a constant.
        variance: Of the errors.
    """

    log_likelihood: Array
    variance: Array


def weigh_drifts(
    samples: Array,
    is_valid: Array,
    gaps: ViewGaps,
    length_m: Array,
    ages: Array,
    excess: Array,
    jumps: Array,
    channels: list[Channel],
) -> list[Evidence]:
    """The candidates' likelihoods.

    Args:
        samples: Shape (..., n, d).
        is_valid: Shape (..., n), 1 where there is a sample, else 0.
        gaps: Between the samples' views, shape (..., n, n).
        length_m: Shape (...), motion after which a regressor's errors are other ones.
        ages: Shape (..., n), metres that VIO has come since.
        excess: Shape (..., n), by how much a sample's variance is larger than usual, in units
            of the usual one.
        jumps: Shape (..., n), variance by jumps since, in the same units.
        channels: Which columns are judged together.
    """
    squared = gaps.normalized(length_m[..., None, None], _ERROR_LENGTH_RAD)
    covariance = _covariances(is_valid, squared, ages, excess, jumps)
    whitened, log_determinant = _whiten(covariance, samples, is_valid)
    xp = namespace(samples)
    ones, values = whitened[..., :1, :], whitened[..., 1:, :]
    floor = xp.ones_like(log_determinant) * 1e-12  # where there are no samples
    information = xp.maximum(xp.sum(ones * ones, axis=(-2, -1)), floor)
    mean = xp.sum(ones * values, axis=-1) / information[..., None]
    squares = xp.sum(values * values, axis=-1) - mean * mean * information[..., None]
    log_determinant = log_determinant + xp.log(information)
    count = xp.sum(is_valid, axis=-1)[..., None]
    free = xp.maximum(count - 1, xp.zeros_like(count))
    return [_judge(channel, squares, log_determinant, free) for channel in channels]


def _judge(channel: Channel, squares: Array, log_determinant: Array, free: Array) -> Evidence:
    """With the errors' variance at its likeliest value."""
    xp = namespace(squares)
    own = squares[..., channel.components]
    degrees = own.shape[-1] * free
    total = xp.maximum(xp.sum(own, axis=-1), xp.zeros_like(log_determinant))
    variance = (total + _PRIOR_DEGREES * channel.noise[..., None] ** 2) / (degrees + _PRIOR_DEGREES)
    score = -0.5 * (degrees * xp.log(variance) + own.shape[-1] * log_determinant)
    return Evidence(score - xp.max(score, axis=-1, keepdims=True), variance)


def _covariances(
    is_valid: Array, squared: Array, ages: Array, excess: Array, jumps: Array
) -> Array:
    """Of the samples for every candidate, shape (..., g, n, n)."""
    xp = namespace(ages)
    # A mixture of a smooth and a rough kernel: what regressors' errors look like.
    errors = 0.5 * xp.exp(-0.5 * squared) + 0.5 * xp.exp(-xp.sqrt(squared))
    identity = constant(np.eye(ages.shape[-1]), ages)
    errors = errors + identity * (_WHITE + excess)[..., None] + _since_later(jumps)
    rates = constant(CORRELATED_PART * 10**LOG10_RATES, ages)[:, None, None]
    covariance = errors[..., None, :, :] + rates * _since_later(ages)[..., None, :, :]
    # Samples that are not there become independent of the others, and say nothing.
    is_pair = (is_valid[..., :, None] * is_valid[..., None, :])[..., None, :, :]
    return covariance * is_pair + identity * (1 - is_valid)[..., None, :, None]


def _since_later(values: Array) -> Array:
    """What two samples share of something that grows with age, (..., n) to (..., n, n)."""
    return namespace(values).minimum(values[..., :, None], values[..., None, :])


def _whiten(covariance: Array, samples: Array, is_valid: Array) -> tuple[Array, Array]:
    """L^-1 [1, samples], transposed to (..., g, 1 + d, n), and log det, where L L^T is K.

    By one Cholesky factorization of [[K, B], [B^T, c I]]: its lower left part is
    (L^-1 B)^T for any c that is large enough. Array libraries have no triangular solve.
    """
    xp = namespace(samples)
    known = xp.concat([is_valid[..., None], samples * is_valid[..., None]], axis=-1)
    rows, columns = known.shape[-2:]
    known = xp.broadcast_to(known[..., None, :, :], (*covariance.shape[:-1], columns))
    bound = 1 + xp.sum(known * known, axis=(-2, -1), keepdims=True) / _WHITE
    corner = bound * constant(np.eye(columns), samples)
    transposed = xp.matrix_transpose(known)
    bordered = xp.concat(
        [xp.concat([covariance, known], axis=-1), xp.concat([transposed, corner], axis=-1)],
        axis=-2,
    )
    lower = xp.linalg.cholesky(bordered)
    pivots = xp.linalg.diagonal(lower)[..., :rows]
    return lower[..., rows:, :rows], 2 * xp.sum(xp.log(pivots), axis=-1)
