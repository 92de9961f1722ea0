"""The robust mean of the camera's position, of method `consensus`.

The votes are carried on by VIO's motion and averaged as `rotation.py` does. Regressors err as
if turned about what they look at: too far left goes with turned too far right. The votes' wrong
directions are known once the rotation is; how far away the pivot is (`depth`) is found with the
mean. So is a common error of VIO's scale.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.robust import (
    ITERATIONS,
    Ballot,
    Fit,
    best_supported,
    independent_votes,
    squared_length,
)
from vioapr.fusion.consensus.views import negative_half_gaps
from vioapr.geometry.arrays import Array, constant, namespace

_SCALE_ERROR = 0.03
"""Error of VIO's scale: a phone's is about 1 %."""

_DEPTH_M = 5.0
"""How far away what a camera looks at may be, at most some times this."""

_SCATTER_LIMITS_M = (0.005, 4.0)
"""Within which regressors err."""


class _Line(NamedTuple):
    """Votes' positions: samples + depth * off - scale * way, each of shape (..., 3, n)."""

    samples: Array
    off: Array
    way: Array

    def at(self, depth: Array, scale: Array) -> Array:
        return self.samples + depth * self.off - scale * self.way

    def features(self) -> Array:
        """What the mean, depth and scale are linear in, shape (..., 15, n)."""
        xp = namespace(self.samples)
        samples, off, way = self
        pairs = [samples * off, off * off, samples * way, off * way, way * way]
        products = constant(_PRODUCTS, samples) @ xp.concat(pairs, axis=-2)
        return xp.concat([*self, products, xp.ones_like(samples[..., :1, :])], axis=-2)


_PRODUCTS = np.kron(np.eye(5), np.ones((1, 3)))
"""Scalar products of five pairs of vectors, from the products of their components."""


def fit_position(
    params: ConsensusParams,
    ballot: Ballot,
    world_from_vio: Array,
    vio_place_m: Array,
    rotation: Fit,
) -> Fit:
    """Where the camera is now.

    Args:
        params: Of the method.
        ballot: Its `base` is of position, shape (..., 1, n).
        world_from_vio: Rotation matrix, shape (..., 3, 3).
        vio_place_m: Where the tracker is now, shape (..., 3, 1).
        rotation: The fit of rotation.
    """
    xp = namespace(ballot.shares)
    votes, heavy = ballot.votes, params.heavy_tails
    way = world_from_vio @ (vio_place_m - votes.vio_place_m)
    places = votes.place_m + way
    off = votes.gaze - world_from_vio @ votes.vio_gaze
    start = best_supported(places, _nearness(places, 1.5 * ballot.last), ballot)
    line = _Line(places - start, off, way)
    features = line.features()
    base = ballot.base + rotation.distrust if heavy else ballot.base
    scale_error2 = _SCALE_ERROR**2 * features[..., 13:14, :]
    mean, positions = xp.zeros_like(start), line.samples
    for _ in range(ITERATIONS):
        squares = squared_length(positions - mean)
        scatter2 = ballot.scatter2(squares, _SCATTER_LIMITS_M)
        loose2 = squares + scale_error2 if heavy else scale_error2
        denominators = base + loose2 / scatter2
        weights = ballot.shares / denominators
        mean, depth, scale = _solve(params, features @ weights.mT, mean, scatter2)
        positions = line.at(depth, scale)
    independent = independent_votes(weights, denominators) / _uneven(weights, positions - mean)
    return ballot.finish(start + mean, line.samples, independent, squares, scatter2)


def _nearness(places: Array, scale: Array) -> Array:
    """1 / (1 + (distance / scale)^2) of each two, shape (..., n, n)."""
    xp = namespace(places)
    pairs = xp.minimum(negative_half_gaps((places - places[..., :1]) / scale), 0.0)
    pairs -= 0.5
    return -0.5 / pairs


def _solve(
    params: ConsensusParams, moments: Array, mean: Array, scatter2: Array
) -> tuple[Array, Array, Array]:
    """Mean, depth and scale, each by least squares with the ones before it.

    Args:
        params: Of the method.
        moments: Weighted sums of `_Line.features`, shape (..., 15, 1).
        mean: The last one.
        scatter2: Of the votes, for the priors about zero.
    """
    xp = namespace(moments)
    samples, off, way = (moments[..., i : i + 3, :] for i in (0, 3, 6))
    s_off, off2, s_way, off_way, way2, weight = (moments[..., i : i + 1, :] for i in range(9, 15))
    from_mean = mean.mT
    depth = (from_mean @ off - s_off) / (off2 + scatter2 / _DEPTH_M**2)
    depth = xp.maximum(depth, 0.0)
    if not params.look_at:
        depth = xp.zeros_like(depth)
    along = s_way + depth * off_way - from_mean @ way
    scale = along / (way2 + scatter2 / _SCALE_ERROR**2)
    mean = samples + depth * off - scale * way
    return mean / xp.maximum(weight, 1e-12), depth, scale


def _uneven(weights: Array, residuals: Array) -> Array:
    """How much larger the votes' variance is along each axis than on average, (..., 3, 1)."""
    xp = namespace(weights)
    squares = (residuals * residuals) @ weights.mT + 1e-12
    ratio = squares / (constant(_MEAN, squares) @ squares)
    return xp.minimum(xp.maximum(ratio, 0.3), 2.0)


_MEAN = np.full((1, 3), 1 / 3)
