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

from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.gravity import knows_up, levelled
from vioapr.fusion.chain.hypotheses import CHALLENGES, Hypotheses
from vioapr.fusion.chain.learning import Trust
from vioapr.fusion.chain.params import ChainParams, in_a_column
from vioapr.fusion.chain.residuals import Residuals
from vioapr.fusion.chain.solver import older_by, smooth
from vioapr.fusion.chain.sums import (
    largest,
    row_sum,
    squared_length,
    squared_lengths,
    total,
    typical_of,
)
from vioapr.fusion.chain.window import Window
from vioapr.geometry.arrays import Array, Mask, constant, namespace

_DEPTH_M = 5.0
"""Expected distance of what the regressor looks at, m; its prior's standard deviation."""

_SCATTER_LIMITS2 = np.array([[0.0035, 0.26], [0.005, 4.0]]) ** 2
"""Within which regressors err per axis, rad^2 and m^2."""

_NOISE_SHOWN2 = 0.25
"""Share of the noise's variance that the scatter has at least. A path that follows predictions
leaves none, which must not make it follow them the more."""

_MEDIAN_CHI2 = 2.366
"""Median of the chi-squared distribution with three degrees of freedom."""

_LEAST_PRECISION = 1e-6
"""Of a frame that no prediction speaks for."""

_STEADY = np.array([[1e-10]] * 3 + [[1e-8]] * 3)
"""Variance of a step that drifts nowhere, rad^2 and m^2: keeps the system regular."""


class Problem(NamedTuple):
    """What is smoothed.

    Attributes:
        window: Past predictions, n of them, newest first.
        residuals: Of them, about where the hypotheses expect the newest frame.
        last: Both hypotheses, with the path moved on to the newest frame.
        trust: What has been learned.
        ages: What the odometer has read since each prediction, shape (..., 3, n).
        shares: See `views.view_shares`.
        drift: Of tilt, heading and position in a metre, rad^2 and m^2, shape (..., 3, 1).
        gates: Squared distances within which predictions fit, rad^2 and m^2, (..., 2, 2, 1).
    """

    window: Window
    residuals: Residuals
    last: Hypotheses
    trust: Trust
    ages: Array
    shares: Array
    drift: Array
    gates: Array


class Solution(NamedTuple):
    """Both hypotheses, smoothed.

    Attributes:
        path: See `Hypotheses`, about where the newest frame was expected.
        precision: See `Hypotheses`.
        depth_m: See `Hypotheses`.
        values: What was smoothed: residuals, drawn to level and corrected for what the
            regressor looks at, shape (..., 2, 6, n).
        scatter2: Typical squared residual per axis, of the leader, rad^2 and m^2, (..., 2, 1).
        beyond: What of it was beyond what regressors may err by.
        is_near: Which predictions fit, shape (..., 2, 1, n).
        is_upright: Whether map and tracker know up, by each hypothesis, shape (..., 2, 1, 1).
    """

    path: Array
    precision: Array
    depth_m: Array
    values: Array
    scatter2: Array
    beyond: Array
    is_near: Mask
    is_upright: Mask


def solve(params: ChainParams, problem: Problem) -> Solution:
    """One step of iteratively reweighted least squares, from the path as it was."""
    window, residuals, last = problem.window, problem.residuals, problem.last
    xp = namespace(problem.ages)
    turns, places = residuals.values[..., :3, :], residuals.values[..., 3:, :]
    swings = residuals.swings if params.look_at else 0 * residuals.swings
    values = xp.concat([turns, places + last.depth_m * swings], axis=-2)
    errors2 = squared_lengths(values - last.path)
    scatter2, beyond = _scatter(problem, errors2[..., 0, :, :])
    is_near = largest(errors2 / problem.gates) < 1
    # The challenger asks all: those that it will fit are not known yet.
    asked = xp.astype(is_near | (constant(CHALLENGES, errors2) > 0), errors2.dtype)
    counts = problem.shares[..., None, :, :] * asked
    by_turn, by_place = _precisions(params, counts, window.stated, errors2, scatter2)
    depth_m = _look_at_depth(by_place, places - last.path[..., 3:, :], swings)
    is_upright, tilt = knows_up(params, last.world_from_vio)
    turns, turn_precisions = levelled(params, turns, by_turn, is_upright, tilt)
    values = xp.concat([turns, places + depth_m * swings], axis=-2)
    precisions = xp.concat([turn_precisions, by_place, by_place, by_place], axis=-2)
    steps = _step_variances(params, window, residuals.legs_m, problem.drift, is_upright)
    is_valid = window.is_valid
    links = (is_valid * older_by(is_valid, 1))[..., None, :, :] / steps
    path, precision = smooth(values, precisions, links)
    path = path * is_valid[..., None, :, :]
    newest = xp.maximum(precision[..., :1], _LEAST_PRECISION)
    return Solution(path, newest, depth_m, values, scatter2, beyond, is_near, is_upright)


def _scatter(problem: Problem, errors2: Array) -> tuple[Array, Array]:
    """The typical squared residual per axis, and what of it is beyond its limit, (..., 2, 1).

    Args:
        problem: What is smoothed.
        errors2: Squared residuals about the leading path, shape (..., 2, n).
    """
    xp = namespace(errors2)
    trust = problem.trust
    # Those from before a jump of the tracker say nothing about the regressor.
    jumps = row_sum(problem.ages[..., 1:, :] / (trust.noise * trust.noise))
    typical = typical_of(problem.window.is_valid * xp.astype(jumps < 1, errors2.dtype))
    median = typical.median(errors2) / _MEDIAN_CHI2
    median = xp.where(typical.is_few, trust.scatter * trust.scatter, median)
    least, most = (constant(_SCATTER_LIMITS2[:, k : k + 1], median) for k in range(2))
    beyond = xp.maximum(median - most, 0.0)
    median = xp.maximum(xp.maximum(median, least), _NOISE_SHOWN2 * trust.noise * trust.noise)
    return xp.minimum(median, most), beyond


def _precisions(
    params: ChainParams, counts: Array, stated: Array, errors2: Array, scatter2: Array
) -> tuple[Array, Array]:
    """Of predictions' turns and places, with Cauchy's weights, 1/rad^2 and 1/m^2.

    Args:
        params: Of the method.
        counts: How much each prediction counts, 0 to 1, shape (..., 2, 1, n).
        stated: Variances over the usual ones, shape (..., 2, n).
        errors2: Squared residuals about the path, rad^2 and m^2, shape (..., 2, 2, n).
        scatter2: The typical ones per axis, shape (..., 2, 1).

    Returns:
        Both of shape (..., 2, 1, n).
    """
    usual = scatter2[..., None, :, :]
    distrust = errors2 / usual if params.heavy_tails else 0 * errors2
    base = stated[..., None, :, :] + distrust
    turn = counts / (base[..., :1, :] * usual[..., :1, :])
    # Whoever errs in direction errs in position too.
    place = counts / ((base[..., 1:, :] + distrust[..., :1, :]) * usual[..., 1:, :])
    return turn, place


def _look_at_depth(precision: Array, places: Array, swings: Array) -> Array:
    """How far in front of the camera the point lies about which predictions err, (..., 2, 1, 1).

    Args:
        precision: Of predictions' places, shape (..., 2, 1, n).
        places: Residuals of their places about the path, shape (..., 2, 3, n).
        swings: See `Residuals`.
    """
    xp = namespace(places)
    weighted = precision * swings
    against, squares = total(row_sum(weighted * places)), total(row_sum(weighted * swings))
    return xp.maximum(-against / (squares + 1 / _DEPTH_M**2), 0.0)


def _step_variances(
    params: ChainParams, window: Window, legs_m: Array, drift: Array, is_upright: Mask
) -> Array:
    """Of the six axes from each prediction to the next newer one, shape (..., 2, 6, n).

    Args:
        params: Of the method.
        window: Past predictions.
        legs_m: See `Residuals`.
        drift: Of tilt, heading and position in a metre, rad^2 and m^2, shape (..., 3, 1).
        is_upright: Whether tracker and map know up, by each hypothesis, shape (..., 2, 1, 1).
    """
    xp = namespace(legs_m)
    since = window.odometer - older_by(window.odometer, 1)
    # A tracker that does not know up tilts as its heading drifts.
    drifts = xp.where(
        is_upright, drift[..., None, :, :], (constant(_AS_HEADING, drift) @ drift)[..., None, :, :]
    )
    metres = since[..., None, :1, :]
    error = in_a_column([params.scale_error], legs_m)
    scaled = error * error * squared_length(legs_m)
    rest = xp.concat([since[..., 1:, :], scaled], axis=-2)[..., None, :, :]
    axes = constant(_DRIFTS_OF_AXES, drifts) @ (drifts * metres)
    return axes + constant(_REST_OF_AXES, rest) @ rest + constant(_STEADY, rest)


_AS_HEADING = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_DRIFTS_OF_AXES = np.array([[1.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1]])
_REST_OF_AXES = np.kron(np.eye(2), np.ones((3, 1)))[:, [0, 1, 1]]
"""Jumps of turn and of place, and what an error of scale makes of the way."""
