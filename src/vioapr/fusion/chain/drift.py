"""How fast VIO drifts, judged by the predictions in the window of method `chain`.

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

from vioapr.fusion.chain.sums import total
from vioapr.geometry.arrays import Array, constant, namespace

LOG10_RATES = np.array([-2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
"""Candidates: variance that VIO drifts by in a metre, in units of the errors' variance."""

CORRELATED_PART = 1 / 30
"""The likelihood's errors include the slow part that the scatter of predictions does not show;
their variance is larger than the scatter's by about this factor, and rates in its units
smaller."""

ERROR_LENGTH_RAD = 0.35
"""Turn after which the errors of a regressor are other ones."""

_WHITE = 0.15
"""Share of the errors' variance that changes from frame to frame whatever the view."""

_PRIOR_DEGREES = 0.5
"""Degrees of freedom that the expected variance of the errors is worth."""

CHANNELS = np.array([[1.0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]])
"""What of the samples drifts together: tilt, heading and position."""

_AXES = CHANNELS.sum(axis=1, keepdims=True)
_RATES = CORRELATED_PART * 10 ** LOG10_RATES[:, None, None]


class Samples(NamedTuple):
    """Of n predictions.

    Attributes:
        values: Turns about and positions along the world's axes, shape (..., 6, n), rad and m.
        is_valid: Shape (..., 1, n), 1 where there is a sample, else 0.
        exponents: -d^2 / 2 for the distances of views in correlation lengths, (..., n, n).
        ages_m: Shape (..., 1, n), metres that VIO has come since.
        excess: Shape (..., 1, n), by how much a sample's variance is larger than usual, in
            units of the usual one.
        jumps: Shape (..., 1, n), variance by jumps since, in the same units.
    """

    values: Array
    is_valid: Array
    exponents: Array
    ages_m: Array
    excess: Array
    jumps: Array


class Evidence(NamedTuple):
    """For tilt, heading and position, and for every candidate, shape (..., 3, g).

    Attributes:
        log_likelihood: Up to a constant.
        variance: Of the errors.
    """

    log_likelihood: Array
    variance: Array


def weigh_drifts(samples: Samples, noise: Array) -> Evidence:
    """The candidates' likelihoods, with the errors' variance at its likeliest value.

    Args:
        samples: The predictions.
        noise: Size expected of the channels' errors, standard deviation, shape (..., 3, 1).
    """
    xp = namespace(noise)
    squares, log_determinant = _residuals(samples)
    count = total(samples.is_valid) - 1
    degrees = xp.maximum(count, 0.0) * constant(_AXES, noise)
    sums = constant(CHANNELS, noise) @ squares
    sums = xp.maximum(sums, 0.0)
    variance = (sums + _PRIOR_DEGREES * noise * noise) / (degrees + _PRIOR_DEGREES)
    score = degrees * xp.log(variance) + constant(_AXES, noise) * log_determinant
    return Evidence(-0.5 * (score - xp.min(score, axis=-1, keepdims=True)), variance)


def _residuals(samples: Samples) -> tuple[Array, Array]:
    """Whitened squared residuals of the mean, (..., 6, g), and log-determinants, (..., 1, g)."""
    xp = namespace(samples.values)
    count = samples.is_valid.shape[-1]
    lower = xp.linalg.cholesky(_bordered_covariances(samples))
    whitened = lower[..., count:, :count]
    ones, values = whitened[..., :1, :], whitened[..., 1:, :]
    information = ones @ ones.mT
    information = xp.maximum(information, 1e-12)  # without samples
    products = values @ ones.mT
    squares = total(values * values) - products * products / information
    pivots = xp.linalg.diagonal(lower)[..., None, :count]
    log_determinant = 2 * total(xp.log(pivots)) + xp.log(information)
    return squares[..., 0].mT, log_determinant[..., 0].mT


def _bordered_covariances(samples: Samples) -> Array:
    """[[K, B], [B^T, c I]] for every candidate's covariance K and B = [1, values].

    The lower left part of its Cholesky factor is (L^-1 B)^T for any c that is large enough:
    array libraries have no triangular solve. Shape (..., g, n + 7, n + 7).
    """
    xp = namespace(samples.values)
    is_valid = samples.is_valid
    known = xp.concat([is_valid, samples.values * is_valid], axis=-2)
    bound = 1 + xp.sum(known * known, axis=(-2, -1), keepdims=True) / _WHITE
    corner = bound * constant(np.eye(known.shape[-2]), bound)
    upper = xp.concat([_error_covariance(samples), known.mT], axis=-1)
    bordered = xp.concat([upper, xp.concat([known, corner], axis=-1)], axis=-2)
    ages = xp.concat([samples.ages_m * is_valid, xp.zeros_like(known[..., :1, :7])], axis=-1)
    covariances = constant(_RATES, bordered) * _since_later(ages)[..., None, :, :]
    covariances += bordered[..., None, :, :]
    return covariances


def _error_covariance(samples: Samples) -> Array:
    """Without drift; samples that are not there are independent of the others."""
    xp = namespace(samples.values)
    is_valid, exponents = samples.is_valid, samples.exponents
    # A mixture of a smooth and a rough kernel: what regressors' errors look like.
    errors = xp.exp(-xp.sqrt(-2 * xp.minimum(exponents, 0.0)))
    errors += xp.exp(exponents)
    errors *= 0.5 * is_valid.mT * is_valid
    own = (_WHITE + samples.excess) * is_valid + (1 - is_valid)
    errors += constant(np.eye(is_valid.shape[-1]), own) * own
    errors += _since_later(samples.jumps * is_valid)
    return errors


def _since_later(values: Array) -> Array:
    """What two samples share of something that grows with age, (..., 1, n) to (..., n, n)."""
    return namespace(values).minimum(values.mT, values)
