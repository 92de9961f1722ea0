"""The robust mean of world_from_vio's rotation, of method `consensus`.

Iteratively reweighted least squares with Cauchy weights, started from the vote that most others
support, not from a mean: several votes may be wild. A vote's weight is
share / (1 + (residual / scatter)^2 + drift): its share of its view's one weight, its distance
from the others, and what VIO has drifted since.

Residuals are the doubled imaginary parts of quaternions, 2 sin(angle / 2) times the axis: the
rotation vector, for all angles that count.
"""

from __future__ import annotations

import math

import numpy as np

from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.robust import (
    ITERATIONS,
    Ballot,
    Fit,
    best_supported,
    independent_votes,
    squared_length,
    total,
)
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import Array, Mask, constant, namespace

_UPRIGHT_RAD = 0.35
"""A tracking world whose tilt is below this is taken for one that knows up: among worlds of
any tilt, one in thirty is so near upright."""

_TILT_RAD = 0.1
"""Tilt that a map may have that is meant to be gravity-aligned."""

_SCATTER_LIMITS_RAD = (0.0035, 0.26)
"""Within which regressors err."""

_MOST_FAVOUR = 30.0
"""Of a tilt against none, as a logarithm: beyond this nothing changes."""

_TILT_AXES = np.array([[1.0], [1.0], [0.0]])
_HEADING_PARTS = np.array([[0.0], [0.0], [1.0], [1.0]])


def fit_rotation(params: ConsensusParams, ballot: Ballot) -> tuple[Fit, Mask]:
    """world_from_vio's rotation, and whether both worlds seem to know up, shape (..., 1, 1).

    Args:
        params: Of the method.
        ballot: Its `base` is of tilt and heading, shape (..., 2, n).
    """
    xp = namespace(ballot.shares)
    rotations = ballot.votes.rotation
    start = best_supported(rotations, _nearness(rotations, 2 * ballot.last), ballot)
    centre, is_upright = _upright(params, start)
    centre_from_start = _right_factor(centre)
    samples = _rotation_vectors(centre_from_start.mT @ rotations)
    base = xp.concat([ballot.base[..., :1, :], ballot.base], axis=-2)
    mean = xp.zeros_like(samples[..., :1])
    for _ in range(ITERATIONS):
        squares = squared_length(samples - mean)
        scatter2 = ballot.scatter2(squares, _SCATTER_LIMITS_RAD)
        denominators = base + squares / scatter2 if params.heavy_tails else base
        weights = ballot.shares / denominators
        weight = total(weights)
        mean = total(weights * samples) / xp.maximum(weight, 1e-12)
        mean = _shrink_tilt(params, mean, weight[..., :1, :] / scatter2, is_upright)
    half = mean / 2
    real = xp.sqrt(1 - squared_length(half))
    rotation = centre_from_start @ xp.concat([half, real], axis=-2)
    independent = independent_votes(weights, denominators)
    return ballot.finish(rotation, samples, independent, squares, scatter2), is_upright


def _nearness(rotations: Array, scale: Array) -> Array:
    """1 / (1 + (angle / scale)^2) of each two, up to a factor, shape (..., n, n)."""
    xp = namespace(rotations)
    if rotations.dtype != xp.float64:  # 1 - cosine^2 would cancel most of the few digits
        turns = _half_turns(rotations)
        return 1 / (xp.sum(turns * turns, axis=-3) + scale**2 / 4)
    pairs = rotations.mT @ rotations
    # In place: in a batch, new memory for all pairs costs more than the arithmetic.
    pairs *= pairs
    pairs -= 1 + scale**2 / 4
    return -1 / pairs


def _half_turns(rotations: Array) -> Array:
    """Imaginary parts of p^-1 q for each two, shape (..., 4, n) to (..., 3, n, n)."""
    right = constant(_IMAGINARY, rotations) @ rotations
    shape = (*right.shape[:-2], 3, 4, right.shape[-1])
    return rotations.mT[..., None, :, :] @ namespace(right).reshape(right, shape)


def _factors(left: np.ndarray) -> np.ndarray:
    """What of q makes component i of p q from component j of p, shape (4, 4, 4).

    Args:
        left: The four units, or their inverses for p^-1 q.
    """
    return np.moveaxis(quaternion.multiply(left[:, None], np.eye(4)), -1, 0)


_IMAGINARY = _factors(quaternion.inverse(np.eye(4)))[:3].reshape(12, 4)


def _upright(params: ConsensusParams, start: Array) -> tuple[Array, Mask]:
    """Where to start: without its tilt where both worlds know up; and whether they do."""
    xp = namespace(start)
    heading = start * constant(_HEADING_PARTS, start)
    # The cosine of half the tilt; a half turn's heading is not defined, and does not matter.
    cosine = xp.sqrt(heading.mT @ heading)
    upright = heading / xp.maximum(cosine, 1e-6)
    if params.gravity == "known":
        return upright, cosine >= 0
    is_upright = cosine > math.cos(_UPRIGHT_RAD / 2)
    if params.gravity == "none":
        is_upright = cosine < 0
    return xp.where(is_upright, upright, start), is_upright


def _right_factor(quat: Array) -> Array:
    """The matrix of p -> p q for quaternions xyzw, shapes (..., 4, 1) to (..., 4, 4).

    It is orthogonal: its transpose multiplies by the inverse.
    """
    flat = constant(_RIGHT_FACTOR, quat) @ quat
    return namespace(flat).reshape(flat, (*flat.shape[:-2], 4, 4))


_RIGHT_FACTOR = _factors(np.eye(4)).reshape(16, 4)


def _rotation_vectors(quats: Array) -> Array:
    vectors = 2 * quats[..., :3, :]
    return namespace(quats).where(quats[..., 3:, :] < 0, -vectors, vectors)


def _shrink_tilt(
    params: ConsensusParams, mean: Array, information: Array, is_upright: Mask
) -> Array:
    """Upright worlds have no tilt, unless the votes make one likelier (a Bayes factor)."""
    xp = namespace(mean)
    tilts = constant(_TILT_AXES, mean)
    if params.gravity == "known":
        return mean * (1 - tilts)
    squared = tilts.mT @ (mean * mean)
    favour = 0.5 * squared * information - xp.log(1 + information * _TILT_RAD**2) - 1.0
    doubt = xp.exp(xp.minimum(-favour, _MOST_FAVOUR))
    lost = xp.astype(is_upright, mean.dtype) * doubt / (1 + doubt)
    return mean * (1 - tilts * lost)
