"""Whether map and tracker share up, and what method `chain` makes of it."""

from __future__ import annotations

import math

import numpy as np

from vioapr.fusion.chain.columns import turns_from
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.sums import squared_length, total
from vioapr.geometry.arrays import Array, Mask, constant, namespace

_GRAVITY_RAD = 0.004
"""Error of a tracker's gravity, rad."""

_UPRIGHT_RAD = 0.35
"""A tracking world whose tilt is below this is taken for one that knows up: among worlds of
any tilt, one in thirty is so near upright."""

_TILT_RAD = 0.1
"""Tilt that a map may have that is meant to be gravity-aligned."""

_MOST_FAVOUR = 8.0
"""Of upright against tilted, as a logarithm: beyond this nothing changes."""

_HEADING_PARTS = np.array([[0.0], [0.0], [1.0], [1.0]])


def knows_up(params: ChainParams, world_from_vio: Array) -> tuple[Mask, Array]:
    """Whether tracker and map seem to, and the turns about x and y away from being level.

    Shapes (..., 2, 1, 1) and (..., 2, 2, 1).
    """
    xp = namespace(world_from_vio)
    heading = world_from_vio * constant(_HEADING_PARTS, world_from_vio)
    # The cosine of half the tilt; a half turn's heading is not defined, and does not matter.
    cosine = xp.sqrt(squared_length(heading))
    tilt = turns_from(world_from_vio, heading / xp.maximum(cosine, 1e-6))[..., :2, :]
    if params.gravity == "none":
        return cosine < 0, tilt
    if params.gravity == "known":
        return cosine >= 0, tilt
    return cosine > math.cos(_UPRIGHT_RAD / 2), tilt


def levelled(
    params: ChainParams, turns: Array, weight: Array, is_upright: Mask, tilt: Array
) -> tuple[Array, Array]:
    """Turns, drawn to level as far as the predictions speak for it; and their precisions.

    Level or tilted by any small angle are two models; how much likelier the one is than the
    other (the Bayes factor of a normal mean) says how hard to draw.

    Args:
        params: Of the method.
        turns: Of predictions about the newest frame, shape (..., 2, 3, n).
        weight: Their precisions, shape (..., 2, 1, n).
        is_upright: See `knows_up`.
        tilt: See `knows_up`.
    """
    xp = namespace(turns)
    if params.gravity in ("none", "estimate"):
        return turns, xp.concat([weight, weight, weight], axis=-2)
    about = turns[..., :2, :]
    if params.gravity == "known":
        level = xp.zeros_like(weight) + 1 / _GRAVITY_RAD**2
    else:
        information = total(weight)
        mean = total(weight * about) / xp.maximum(information, 1e-12) + tilt
        against = 0.5 * squared_length(mean) * information
        against = against - xp.log(1 + information * _TILT_RAD**2) - 1.0
        odds = xp.exp(xp.minimum(-against, _MOST_FAVOUR))
        level = xp.astype(is_upright, weight.dtype) * odds * weight
    both = weight + level
    about = (weight * about - level * tilt) / xp.maximum(both, 1e-12)
    return (
        xp.concat([about, turns[..., 2:, :]], axis=-2),
        xp.concat([both, both, weight], axis=-2),
    )
