"""Which predictions of method `chain` come from one view, and so share their bias."""

from __future__ import annotations

from functools import cache

import numpy as np

from vioapr.fusion.chain.sums import total
from vioapr.fusion.chain.window import Window
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


def view_kernel(window: Window, length_m: Array) -> Array:
    """How much of their bias each two predictions have in common, 0 to 1, shape (..., n, n)."""
    exponents = view_exponents(window.vio_place_m, window.vio_gaze, length_m, VIEW_RAD)
    return namespace(exponents).exp(exponents) * window.is_valid


def view_shares(window: Window, kernel: Array, drift: Array) -> Array:
    """Each prediction's share of the one weight that its view has, shape (..., 1, n).

    Args:
        window: Past predictions.
        kernel: See `view_kernel`.
        drift: Variance by which position drifts in a metre, over a prediction's, (..., 1, 1):
            what lies further back is another sample of the drift, and crowds less.
    """
    xp = namespace(kernel)
    way = window.odometer[..., :1, :]
    apart = xp.abs(way.mT - way)
    density = total(kernel / (1 + drift * apart)).mT
    return window.is_valid / xp.maximum(density, 1.0)
