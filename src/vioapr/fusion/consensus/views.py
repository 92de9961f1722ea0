"""Which votes of method `consensus` come from one view, and so share their bias."""

from __future__ import annotations

from functools import cache

import numpy as np

from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.votes import Votes
from vioapr.geometry.arrays import Array, constant, namespace

VIEW_RAD = 0.26
"""Turn of the viewing direction after which the regressor's bias is another one."""


def view_length_m(scatter_m: Array) -> Array:
    """Motion after which it is.

    Regressors err in proportion to the place's size, and their bias varies with it too.
    """
    return 0.3 + 3.0 * scatter_m


def view_exponents(
    vio_place_m: Array, vio_gaze: Array, length_m: Array, length_rad: float
) -> Array:
    """-d^2 / 2 for the distance d of each two views, in correlation lengths, (..., n, n).

    Args:
        vio_place_m: Positions in one tracking world, shape (..., 3, n).
        vio_gaze: Viewing directions, shape (..., 3, n). Their distance on the unit sphere is
            about the angle; turns about them do not count.
        length_m: Shape (..., 1, 1).
        length_rad: A turn that counts as much as that length.
    """
    xp = namespace(vio_place_m)
    places = (vio_place_m - vio_place_m[..., :1]) / length_m
    return negative_half_gaps(xp.concat([places, vio_gaze / length_rad], axis=-2))


def negative_half_gaps(points: Array) -> Array:
    """-|a - b|^2 / 2 of each two, shape (..., k, n) to (..., n, n); best near the origin."""
    xp = namespace(points)
    if points.dtype != xp.float64:  # the product below would cancel half of the few digits
        gaps = points[..., :, None] - points[..., None, :]
        return -0.5 * xp.sum(gaps * gaps, axis=-3)
    # a b - |a|^2/2 - |b|^2/2 as one product: one pass over the pairs.
    halves = constant(_minus_half(points.shape[-2]), points) @ (points * points)
    ones = xp.ones_like(halves)
    left = xp.concat([points, halves, ones], axis=-2)
    right = xp.concat([points, ones, halves], axis=-2)
    return left.mT @ right


@cache
def _minus_half(count: int) -> np.ndarray:
    return np.full((1, count), -0.5)


def view_shares(params: ConsensusParams, votes: Votes, length_m: Array) -> Array:
    """Each vote's share of the one weight that its view has, shape (..., 1, n)."""
    is_valid = votes.is_valid
    if not params.view_weights:
        return is_valid
    exponents = view_exponents(votes.vio_place_m, votes.vio_gaze, length_m, VIEW_RAD)
    density = is_valid @ namespace(exponents).exp(exponents)
    return is_valid / (density + (1 - is_valid))
