"""The model of method `chain` over a whole walk, linearized: what `offline` solves.

The unknowns are, for every tracked frame, the turn of world_from_vio about the world's axes and
the camera's position. From frame to frame they follow VIO but for a random walk, whose variance
grows with the odometer. Predictions are priors with heavy-tailed errors (Cauchy's weights), and
those from one view share one weight. A map and a tracker that both know up are level.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.passes import Passes
from vioapr.fusion.chain.tridiagonal import BlockTridiagonal
from vioapr.fusion.chain.views import VIEW_RAD, view_length_m
from vioapr.geometry import quaternion

Floats = NDArray[np.float64]

_REACH = 512
"""Predictions to either side that may share a view: so time is linear in the walk's length."""

_MEDIAN_CHI2 = 2.366
"""Median of the chi-squared distribution with three degrees of freedom."""

_SCATTER_LIMITS2 = np.array([[0.0035, 0.26], [0.005, 4.0]]) ** 2
"""Within which regressors err per axis, rad^2 and m^2."""

_DEPTH_M = 5.0
"""Expected distance of what the regressor looks at, m; its prior's standard deviation."""

_STEADY_RAD2, _STEADY_M2 = 1e-10, 1e-8
"""Variance of a step that drifts nowhere: keeps the system regular."""

_GRAVITY_RAD = 0.004
"""Error of a tracker's gravity, rad."""

_UPRIGHT_RAD = 0.35
"""A tracking world whose tilt is below this is taken for one that knows up."""

_TILT_RAD = 0.1
"""Tilt that a map may have that is meant to be gravity-aligned."""

TAIL_INFORMATION = 4.0
"""Cauchy's weights of vectors in three dimensions are 4 / (1 + d^2): for what is likeliest the
factor can be left out, if drifts are as much larger, but not for how certain it is."""

_MOST_FAVOUR = 8.0
"""Of upright against tilted, as a logarithm: beyond this nothing changes."""

_FORWARD = np.array([0.0, 0.0, 1.0])
_LEVEL_PARTS = np.array([0.0, 0.0, 1.0, 1.0])


class Path(NamedTuple):
    """Estimates of n frames.

    Attributes:
        turn: world_from_vio's rotation, from a z-up tracking world, quaternions, shape (n, 4).
        place_m: Where the camera is in the world, shape (n, 3).
    """

    turn: Floats
    place_m: Floats

    def moved(self, change: Floats) -> Path:
        """By turns about and ways along the world's axes, rad and m, shape (n, 6)."""
        turned = quaternion.multiply(quaternion.from_rotvec(change[:, :3]), self.turn)
        return Path(quaternion.normalize(turned), self.place_m + change[:, 3:])


class Errors(NamedTuple):
    """Of k predictions, as a path has it.

    Attributes:
        turn: Rotation vectors from the path to the predictions, rad, shape (k, 3).
        place_m: From the path to the predictions, shape (k, 3).
        swing: Predicted viewing directions less those of the path, shape (k, 3).
    """

    turn: Floats
    place_m: Floats
    swing: Floats


class Noise(NamedTuple):
    """Of the predictions, estimated with the path.

    Attributes:
        turn_rad: Scale of errors about each axis.
        place_m: Scale of errors along each axis.
        depth_m: Distance of what the regressor looks at.
        shares: Share of each prediction in its view's one weight, shape (k,).
    """

    turn_rad: float
    place_m: float
    depth_m: float
    shares: Floats


class Weights(NamedTuple):
    """Precisions of the predictions, 1/rad^2 and 1/m^2, shape (k,) each."""

    turn: Floats
    place: Floats


def errors_of(passes: Passes, path: Path) -> Errors:
    """Of the predictions, without regard to where the regressor looks."""
    turn, vio_quat = path.turn[passes.predicted], passes.vio_from_cam.quat_xyzw[passes.predicted]
    quat = quaternion.multiply(turn, vio_quat)
    apr = passes.world_from_cam
    return Errors(
        quaternion.to_rotvec(quaternion.multiply(apr.quat_xyzw, quaternion.inverse(quat))),
        apr.translation_m - path.place_m[passes.predicted],
        quaternion.rotate(apr.quat_xyzw, _FORWARD) - quaternion.rotate(quat, _FORWARD),
    )


def scales_of(errors: Errors, noise: Noise, variances: Floats) -> tuple[float, float]:
    """The errors' scales per axis, rad and m, by the median over views.

    A path that may follow the predictions leaves small errors, whatever theirs are; so its own
    uncertainty is added, as in expectation maximization.

    Args:
        errors: About the path.
        noise: Of before.
        variances: Of the path at the predictions, rad^2 and m^2 along axes, shape (k, 6).
    """
    least, most = _SCATTER_LIMITS2.T
    places = errors.place_m + noise.depth_m * errors.swing
    medians = [
        _weighted_median(_squared(vectors), noise.shares) / _MEDIAN_CHI2
        + _weighted_median(own.mean(axis=1), noise.shares)
        for vectors, own in zip((errors.turn, places), np.split(variances, 2, axis=1), strict=True)
    ]
    turn_rad, place_m = np.sqrt(np.clip(medians, least, most)).tolist()
    return turn_rad, place_m


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    sums = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(sums, sums[-1] / 2)])


def _squared(vectors: Floats) -> Floats:
    return np.sum(vectors * vectors, axis=-1)


def view_shares(passes: Passes, place_m: float) -> Floats:
    """Each prediction's share of the one weight that its view has, shape (k,).

    Args:
        passes: Of the walk.
        place_m: Scale of the predictions' errors.
    """
    vio = passes.vio_from_cam.at(passes.predicted)
    length_m = float(view_length_m(np.asarray(place_m)))
    gaze = quaternion.rotate(vio.quat_xyzw, _FORWARD)
    views = np.concatenate([vio.translation_m / length_m, gaze / VIEW_RAD], axis=1)
    way_m = np.concatenate([[0.0], np.cumsum(passes.since[:, 0])])[passes.predicted]
    world = np.concatenate([[0], np.cumsum(~passes.is_linked)])[passes.predicted]
    drift = passes.traits.position_drift / place_m**2
    density = np.empty(len(views))
    for first in range(0, len(views), _REACH):
        own = slice(first, first + _REACH)
        near = slice(max(first - _REACH, 0), first + 2 * _REACH)
        gaps2 = (
            _squared(views[own])[:, None] + _squared(views[near]) - 2 * views[own] @ views[near].T
        )
        shared = np.exp(-np.maximum(gaps2, 0.0) / 2) * (world[own][:, None] == world[near])
        apart_m = np.abs(way_m[own][:, None] - way_m[near])
        density[own] = np.sum(shared / (1 + drift * apart_m), axis=1)
    return 1 / np.maximum(density, 1.0)


def weights_of(
    params: ChainParams, passes: Passes, errors: Errors, noise: Noise, width: float
) -> Weights:
    """Cauchy's, of errors whose scale is wider by a factor."""
    scales2 = np.array([noise.turn_rad**2, noise.place_m**2])
    places = errors.place_m + noise.depth_m * errors.swing
    distrust = np.stack([_squared(errors.turn), _squared(places)], axis=1) / (scales2 * width**2)
    if not params.heavy_tails:
        distrust = 0 * distrust
    turn = noise.shares / (passes.stated[:, 0] + distrust[:, 0]) / scales2[0]
    # Whoever errs in direction errs in position too.
    place = noise.shares / (passes.stated[:, 1] + distrust.sum(axis=1)) / scales2[1]
    return Weights(turn, place)


def look_at_depth(weights: Weights, errors: Errors) -> float:
    """How far in front of the camera the point lies about which predictions err, m."""
    weighted = weights.place[:, None] * errors.swing
    against = -np.sum(weighted * errors.place_m)
    return max(0.0, float(against / (np.sum(weighted * errors.swing) + 1 / _DEPTH_M**2)))


class Steps(NamedTuple):
    """From each frame to the next one, n - 1 of them.

    Attributes:
        residual: By how much the path differs from VIO: turn and way in the world, rad and m,
            shape (n - 1, 6).
        by_turn: The residual way by the first frame's turn, shape (n - 1, 3, 3).
        precision: Of the six, shape (n - 1, 6); 0 from one tracking world to the next.
    """

    residual: Floats
    by_turn: Floats
    precision: Floats


def steps_of(params: ChainParams, passes: Passes, path: Path, knows_up: bool) -> Steps:
    """As a path has them."""
    moved = np.diff(passes.vio_from_cam.translation_m, axis=0)
    way = quaternion.rotate(path.turn[:-1], moved)
    turn = quaternion.multiply(path.turn[1:], quaternion.inverse(path.turn[:-1]))
    off_m = np.diff(path.place_m, axis=0) - way
    metres, jump_rad2, jump_m2 = passes.since.T
    traits = passes.traits
    heading = traits.heading_drift * metres + jump_rad2 + _STEADY_RAD2
    tilt = traits.tilt_drift * metres + jump_rad2 + _STEADY_RAD2 if knows_up else heading
    scaled = params.scale_error**2 * _squared(moved)
    place = traits.position_drift * metres + scaled + jump_m2 + _STEADY_M2
    variances = np.stack([tilt, tilt, heading, place, place, place], axis=1)
    return Steps(
        np.concatenate([quaternion.to_rotvec(turn), off_m], axis=1),
        _cross_matrix(way),
        passes.is_linked[:, None] / variances,
    )


def _cross_matrix(vectors: Floats) -> Floats:
    return np.cross(vectors[:, None, :], np.eye(3)).mT


class Level(NamedTuple):
    """What a map and a tracker that both know up add, at m frames.

    Attributes:
        rows: The frames, shape (m,).
        tilt: Turns about x and y away from being level, rad, shape (m, 2).
        precision: Of their being none, 1/rad^2, shape (m,).
    """

    rows: NDArray[np.intp]
    tilt: Floats
    precision: Floats


def tilt_of(turn: Floats) -> Floats:
    """Turns about x and y from level to world_from_vio's rotation, rad, shapes (n, 4), (n, 2)."""
    level = quaternion.normalize(turn * _LEVEL_PARTS + np.array([0.0, 0.0, 0.0, 1e-12]))
    return quaternion.to_rotvec(quaternion.multiply(turn, quaternion.inverse(level)))[:, :2]


def level_of(
    params: ChainParams, passes: Passes, path: Path, errors: Errors, weights: Weights
) -> Level:
    """Level for certain, or as far as the predictions speak for it (a Bayes factor)."""
    if params.gravity == "known":
        tilt = tilt_of(path.turn)
        return Level(np.arange(len(tilt)), tilt, np.full(len(tilt), _GRAVITY_RAD**-2))
    rows = passes.predicted
    tilt = tilt_of(path.turn[rows])
    if params.gravity in ("none", "estimate") or not knows_up(params, path):
        return Level(rows[:0], tilt[:0], weights.turn[:0])
    mean = np.average(errors.turn[:, :2] + tilt, axis=0, weights=weights.turn)
    information = TAIL_INFORMATION * float(weights.turn.sum())
    against = 0.5 * float(mean @ mean) * information - np.log1p(information * _TILT_RAD**2) - 1
    return Level(rows, tilt, np.exp(min(-against, _MOST_FAVOUR)) * weights.turn)


def knows_up(params: ChainParams, path: Path) -> bool:
    """Whether tracker and map seem to."""
    if params.gravity in ("none", "known"):
        return params.gravity == "known"
    tilts = np.linalg.norm(tilt_of(path.turn), axis=1)
    return bool(np.median(tilts) < _UPRIGHT_RAD)


class System(NamedTuple):
    """The normal equations for a change of the path, six unknowns a frame."""

    matrix: BlockTridiagonal
    right: Floats


def system_of(
    passes: Passes,
    path: Path,
    errors: Errors,
    noise: Noise,
    weights: Weights,
    steps: Steps,
    level: Level,
) -> System:
    """Predictions, steps and what is level, added up."""
    count, rows = len(path.place_m), passes.predicted
    diagonal, right = np.zeros((count, 6, 6)), np.zeros((count, 6))
    places = errors.place_m + noise.depth_m * errors.swing
    for first, weight, values in ((0, weights.turn, errors.turn), (3, weights.place, places)):
        for axis in range(first, first + 3):
            diagonal[rows, axis, axis] += weight
        right[rows, first : first + 3] += weight[:, None] * values
    for axis in range(2):
        diagonal[level.rows, axis, axis] += level.precision
        right[level.rows, axis] -= level.precision * level.tilt[:, axis]
    # The residual of a step changes by the second frame's change less (1 + by_turn) the first's.
    by_first = np.zeros((count - 1, 6, 6))
    by_first[:, 3:, :3] = steps.by_turn
    by_first -= np.eye(6)
    weighted = steps.precision[:, :, None] * by_first
    diagonal[:-1] += by_first.mT @ weighted
    diagonal[1:] += steps.precision[:, :, None] * np.eye(6)
    pull = steps.precision * steps.residual
    right[:-1] -= (by_first.mT @ pull[..., None])[..., 0]
    right[1:] -= pull
    return System(BlockTridiagonal(diagonal, weighted.mT), right)


def cost_of(errors: Errors, noise: Noise, steps: Steps) -> float:
    """Minus the logarithm of the path's probability, up to a constant."""
    places = errors.place_m + noise.depth_m * errors.swing
    scales = np.log([noise.turn_rad, noise.place_m])
    tails = np.log1p(_squared(errors.turn) / noise.turn_rad**2)
    tails += np.log1p(_squared(places) / noise.place_m**2)
    predictions = noise.shares @ (3 * scales.sum() + 2 * tails)
    return float(predictions + 0.5 * np.sum(steps.precision * steps.residual**2))
