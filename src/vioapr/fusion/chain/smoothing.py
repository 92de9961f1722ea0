"""How method `chain` smooths both hypotheses over the window of predictions.

Carried to now by VIO, a prediction says what the newest pose is: its turn of `world_from_vio`
and its place. What these would be without errors moves as VIO drifts, by a random walk over the
odometer. So each of six axes (turns about and positions along the world's axes) is a local level
model, which `solver` smooths. Errors have heavy tails: a prediction's precision is
share / (stated + (residual / scatter)^2) / scatter^2, its share of its view's one weight, over
Cauchy's weights. One step of iteratively reweighted least squares a prediction is enough, as
the path is kept from the one before.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.columns import cross, rotation_matrix, turns_from
from vioapr.fusion.chain.hypotheses import Hypotheses
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.solver import older_by, smooth
from vioapr.fusion.chain.sums import row_sum, squared_length, total
from vioapr.fusion.chain.window import Window
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

_DEPTH_M = 5.0
"""Expected distance of what the regressor looks at, m; its prior's standard deviation."""

_HEADING_PARTS = np.array([[0.0], [0.0], [1.0], [1.0]])
_STEADY = np.array([[1e-10]] * 3 + [[1e-8]] * 3)
"""Variance of a step that drifts nowhere, rad^2 and m^2: keeps the system regular."""


class Residuals(NamedTuple):
    """Predictions about the newest frame of both hypotheses, carried to now, n of them.

    Attributes:
        values: Turns about and positions along the world's axes, rad and m, (..., 2, 6, n).
        ways_m: The way that VIO has come since, in the world, shape (..., 2, 3, n).
        legs_m: The ways from prediction to prediction in the tracking world, shape (..., 3, n).
        swings: Predicted viewing directions less the expected ones, shape (..., 2, 3, n).
    """

    values: Array
    ways_m: Array
    legs_m: Array
    swings: Array


def residuals_of(window: Window, hypotheses: Hypotheses) -> Residuals:
    """Of all predictions, the newest first."""
    xp = namespace(window.rows)
    turns = turns_from(window.rotation[..., None, :, :], hypotheses.world_from_vio)
    known = window.is_valid * _next(window.is_valid)
    legs_m = (window.vio_place_m - _next(window.vio_place_m)) * known
    # Both kinds of vectors are turned into the world as the path has it at their time.
    vectors = xp.concat([legs_m, window.vio_gaze], axis=-1)[..., None, :, :]
    drifted = hypotheses.path[..., :3, :]
    drifted = xp.concat([_next(drifted), drifted], axis=-1)
    level = rotation_matrix(hypotheses.world_from_vio) @ vectors
    level = level + cross(drifted, level)
    count = window.is_valid.shape[-1]
    ways_m = level[..., :count] @ constant(_since(count), level)
    places = window.place_m[..., None, :, :] + ways_m - hypotheses.place_m
    swings = window.gaze[..., None, :, :] - level[..., count:]
    return Residuals(xp.concat([turns, places], axis=-2), ways_m, legs_m, swings)


def _next(values: Array) -> Array:
    """The next older prediction's values, 0 for the oldest, shape (..., k, n)."""
    return older_by(values, 1)


@cache
def _since(count: int) -> np.ndarray:
    """Sums of the legs since each prediction."""
    return np.triu(np.ones((count, count)), 1)


class Weights(NamedTuple):
    """Precisions of predictions, 1/rad^2 and 1/m^2.

    Attributes:
        turn: Shape (..., 2, 1, n).
        place: Shape (..., 2, 1, n).
    """

    turn: Array
    place: Array


def weights_of(
    params: ChainParams, counts: Array, stated: Array, squares: Array, scatter2: Array
) -> Weights:
    """Cauchy's.

    Args:
        params: Of the method.
        counts: How much each prediction counts, 0 to 1, shape (..., 2, 1, n).
        stated: Variances over the usual ones, shape (..., 2, n).
        squares: Squared residuals about the path, rad^2 and m^2, shape (..., 2, 2, n).
        scatter2: The typical ones per axis, shape (..., 2, 1).
    """
    usual = scatter2[..., None, :, :]
    distrust = squares / usual if params.heavy_tails else 0 * squares
    base = stated[..., None, :, :] + distrust
    turn = counts / base[..., :1, :] / usual[..., :1, :]
    # Whoever errs in direction errs in position too.
    place = counts / (base[..., 1:, :] + distrust[..., :1, :]) / usual[..., 1:, :]
    return Weights(turn, place)


def look_at_depth(weights: Weights, places: Array, swings: Array) -> Array:
    """How far in front of the camera the point lies about which predictions err, (..., 2, 1, 1).

    Args:
        weights: Of predictions.
        places: Residuals of their positions, shape (..., 2, 3, n).
        swings: See `Residuals`.
    """
    xp = namespace(places)
    weighted = weights.place * swings
    against = row_sum(total(weighted * places))
    squares = row_sum(total(weighted * swings))
    return xp.maximum(-against / (squares + 1 / _DEPTH_M**2), 0.0)


class Drift(NamedTuple):
    """Variances by which the tracker drifts in a metre, shape (..., 1, 1): rad^2/m and m^2/m."""

    tilt: Array
    heading: Array
    position: Array


def step_variances(
    params: ChainParams, window: Window, legs_m: Array, drift: Drift, is_upright: Mask
) -> Array:
    """Of the six axes from each prediction to the next newer one, shape (..., 2, 6, n).

    Args:
        params: Of the method.
        window: Past predictions.
        legs_m: See `Residuals`.
        drift: Of the tracker.
        is_upright: Whether tracker and map know up, by each hypothesis, shape (..., 2, 1, 1).
    """
    xp = namespace(legs_m)
    since = window.odometer - _next(window.odometer)
    metres, jumps = since[..., :1, :], since[..., 1:, :]
    heading = drift.heading * metres + jumps[..., :1, :]
    tilt = drift.tilt * metres + jumps[..., :1, :]
    scaled = params.scale_error**2 * squared_length(legs_m)
    place = drift.position * metres + scaled + jumps[..., 1:, :]
    tilt = xp.where(is_upright, tilt[..., None, :, :], heading[..., None, :, :])
    heading, place = (part[..., None, :, :] + 0 * tilt for part in (heading, place))
    axes = xp.concat([tilt, tilt, heading, place, place, place], axis=-2)
    return axes + constant(_STEADY, axes)


def smoothed(
    values: Array, weights: Array, variances: Array, is_valid: Array
) -> tuple[Array, Array]:
    """The path, and the newest entry's precision, shapes (..., 2, 6, n) and (..., 2, 6, 1).

    Args:
        values: See `Residuals`.
        weights: Their precisions, of the same shape.
        variances: See `step_variances`.
        is_valid: Shape (..., 1, n).
    """
    links = (is_valid * _next(is_valid))[..., None, :, :] / variances
    path, precision = smooth(values, weights, links)
    return path * is_valid[..., None, :, :], precision[..., :1]


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
