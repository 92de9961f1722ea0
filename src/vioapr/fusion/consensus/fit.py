"""Robust means of the votes of method `consensus`: first of rotation, then of position.

Iteratively reweighted least squares with Cauchy weights, started from the vote that most others
support, not from a mean: several votes may be wild. A vote's weight is
share / (1 + (residual / scatter)^2 + drift): its share of its view's one weight, its distance
from the others, and what VIO has drifted since.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.votes import (
    Odometer,
    ViewGaps,
    Votes,
    squared_distances,
    viewing_direction,
)
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import Array, constant, namespace, select
from vioapr.geometry.rigid import Rigid3

_ITERATIONS = 3
_UPRIGHT_RAD = 0.35
"""A tracking world whose tilt is below this is taken for one that knows up: among worlds of
any tilt, one in thirty is so near upright."""

_TILT_RAD = 0.1
"""Tilt that a map may have that is meant to be gravity-aligned."""

_SCALE_ERROR = 0.03
"""Error of VIO's scale: a phone's is about 1 %."""

_DEPTH_M = 5.0
"""How far away what a camera looks at may be, at most some times this."""

_GATE = 4.0
"""Squared errors, in units of the typical one, from which a vote counts as an outlier."""

_MEDIAN_CHI2 = 2.366
"""Median of the chi-squared distribution with three degrees of freedom."""

_NEWEST = 7
"""Votes whose common disagreement with the mean raises doubt."""

_FEW = 5
"""Votes from which on a median residual says something."""

_SCATTER_LIMITS_M, _SCATTER_LIMITS_RAD = (0.005, 4.0), (0.0035, 0.26)
"""Within which regressors err."""


class Fit(NamedTuple):
    """A robust mean.

    Attributes:
        mean: Rotation as quaternion xyzw of world_from_vio, or the camera's position in m.
        samples: The votes relative to the start, shape (..., n, 3), m or rad.
        independent: Shape (..., 3): how many independent votes each axis rests on.
        scatter: Shape (...), typical error of a vote per axis.
        distrust: Shape (..., n), (residual / scatter)^2.
        excess: Shape (..., n), by how much outliers' variance is larger than that of the others.
            What VIO has drifted does not make a vote an outlier.
        doubt: Shape (...), variance by which the newest votes disagree with the mean.
        is_upright: Shape (...), whether both worlds seem to know up (rotation only).
    """

    mean: Array
    samples: Array
    independent: Array
    scatter: Array
    distrust: Array
    excess: Array
    doubt: Array
    is_upright: Array


def view_shares(
    params: ConsensusParams,
    is_valid: Array,
    gaps: ViewGaps,
    length_m: Array,
    length_rad: float,
) -> Array:
    """Each vote's share of the one weight that its view has, shape (..., n)."""
    if not params.view_weights:
        return is_valid
    kernel = namespace(length_m).exp(-0.5 * gaps.normalized(length_m[..., None, None], length_rad))
    density = namespace(kernel).sum(kernel * is_valid[..., None, :], axis=-1)
    return is_valid / (density + (1 - is_valid))


def fit_rotation(
    params: ConsensusParams,
    votes: Votes,
    ages: Odometer,
    shares: Array,
    rates: tuple[Array, Array],
    scatter_rad: Array,
    noise_rad: Array,
) -> Fit:
    """world_from_vio's rotation.

    Args:
        params: Of the method.
        votes: With tracking world z up.
        ages: What the odometer has read since each vote, shape (..., n).
        shares: See `view_shares`.
        rates: Drift of tilt and of heading: variance a metre, in units of the scatter's.
        scatter_rad: The last one.
        noise_rad: Typical error of a prediction.
    """
    xp = namespace(shares)
    rotations = quaternion.multiply(
        votes.apr_world_from_cam.quat_xyzw, quaternion.inverse(votes.vio_from_cam.quat_xyzw)
    )
    jumps = _jump_variance(shares, ages.jumps_rad2, noise_rad)
    drifts = [rate[..., None] * ages.motion_m + jumps for rate in rates]
    cosines = xp.matmul(rotations, xp.matrix_transpose(rotations))
    squared_angles = 4 * (1 - cosines * cosines)
    start = _best_supported(rotations, squared_angles, 2 * scatter_rad, shares, drifts[1])
    centre, is_upright = _upright(params, start)
    turns = quaternion.multiply(rotations, quaternion.inverse(centre)[..., None, :])
    samples = quaternion.to_rotvec(turns)
    typical = _since_jumps(votes, ages.jumps_rad2, noise_rad)
    mean = xp.zeros_like(samples[..., 0, :])
    for _ in range(_ITERATIONS):
        residuals = samples - mean[..., None, :]
        distrust, scatter = _distrust(residuals, typical, scatter_rad, _SCATTER_LIMITS_RAD)
        suspicion = distrust if params.heavy_tails else xp.zeros_like(distrust)
        tilt, heading = (shares / (1 + suspicion + drift) for drift in drifts)
        weights = xp.stack([tilt, tilt, heading], axis=-1)
        mean = _mean(weights, samples)
        tilt_weight = xp.sum(tilt, axis=-1)
        mean = _shrink_tilt(params, mean, tilt_weight, scatter, is_upright)
    rotation = quaternion.multiply(quaternion.from_rotvec(mean), centre)
    independent = _independent(weights, shares)
    doubt = _doubt(distrust, scatter, votes, noise_rad)
    excess = _excess(distrust / (1 + drifts[1]))
    return Fit(rotation, samples, independent, scatter, distrust, excess, doubt, is_upright)


def _upright(params: ConsensusParams, start: Array) -> tuple[Array, Array]:
    """Where to start: without its tilt where both worlds know up; and whether they do."""
    xp = namespace(start)
    heading = 2 * xp.atan2(start[..., 2], start[..., 3])
    nothing = xp.zeros_like(heading)
    upright = quaternion.from_rotvec(xp.stack([nothing, nothing, heading], axis=-1))
    if params.gravity == "known":
        return upright, nothing == 0
    tilt = quaternion.angle_rad(quaternion.multiply(start, quaternion.inverse(upright)))
    is_upright = (tilt < _UPRIGHT_RAD) & (params.gravity != "none")
    return select(is_upright, upright, start), is_upright


def _shrink_tilt(
    params: ConsensusParams, mean: Array, weight: Array, scatter: Array, is_upright: Array
) -> Array:
    """Upright worlds have no tilt, unless the votes make one likelier (a Bayes factor)."""
    xp = namespace(mean)
    if params.gravity == "known":
        return mean * constant(np.array([0.0, 0.0, 1.0]), mean)
    squared = xp.sum(mean[..., :2] ** 2, axis=-1)
    known = weight / scatter**2
    favour = 0.5 * squared * known - xp.log(1 + known * _TILT_RAD**2) - 1.0
    most = xp.ones_like(favour) * 30.0
    probability = 1 / (1 + xp.exp(xp.minimum(-favour, most)))
    factor = xp.where(is_upright, probability, xp.ones_like(probability))
    return xp.concat([mean[..., :2] * factor[..., None], mean[..., 2:]], axis=-1)


def fit_position(
    params: ConsensusParams,
    votes: Votes,
    directions: Array,
    vio_from_cam: Rigid3,
    ages: Odometer,
    shares: Array,
    rate: Array,
    rotation: Fit,
    scatter_m: Array,
    noise_m: Array,
) -> Fit:
    """Where the camera is now: the votes carried on by VIO's motion.

    Regressors err as if turned about what they look at: too far left goes with turned too far
    right. The votes' wrong directions are known once the rotation is; how far away the pivot
    is (`depth`) is found with the mean. So is a common error of VIO's scale.

    Args:
        params: Of the method.
        votes: With tracking world z up.
        directions: Their viewing directions in the tracking world, shape (..., n, 3).
        vio_from_cam: The tracker's pose now, z up too.
        ages: What the odometer has read since each vote, shape (..., n).
        shares: See `view_shares`.
        rate: Drift of position: variance a metre, in units of the scatter's.
        rotation: The fit of rotation.
        scatter_m: The last one.
        noise_m: Typical error of a prediction.
    """
    xp = namespace(shares)
    turn = rotation.mean[..., None, :]
    moved = vio_from_cam.translation_m[..., None, :] - votes.vio_from_cam.translation_m
    way = quaternion.rotate(turn, moved)
    places = votes.apr_world_from_cam.translation_m + way
    seen = viewing_direction(votes.apr_world_from_cam)
    off = seen - quaternion.rotate(turn, directions)
    way2 = xp.sum(way * way, axis=-1)
    jumps = _jump_variance(shares, ages.jumps_m2, noise_m)
    drift = rate[..., None] * ages.motion_m + jumps
    squared_gaps = squared_distances(places - places[..., :1, :])
    start = _best_supported(places, squared_gaps, 1.5 * scatter_m, shares, drift)
    samples = places - start[..., None, :]
    typical = _since_jumps(votes, ages.jumps_m2, noise_m)
    mean, corrected = xp.zeros_like(start), samples
    for _ in range(_ITERATIONS):
        residuals = corrected - mean[..., None, :]
        distrust, scatter = _distrust(residuals, typical, scatter_m, _SCATTER_LIMITS_M)
        suspicion = distrust + rotation.distrust
        suspicion = suspicion if params.heavy_tails else xp.zeros_like(distrust)
        variance = (scatter**2)[..., None]
        weights = shares / (1 + suspicion + drift + _SCALE_ERROR**2 * way2 / variance)
        corrected = samples
        if params.look_at:
            depth = -_slope(weights, samples - mean[..., None, :], off, scatter / _DEPTH_M)
            depth = xp.maximum(depth, xp.zeros_like(depth))
            corrected = samples + depth[..., None, None] * off
        residuals = corrected - mean[..., None, :]
        scale = _slope(weights, residuals, way, scatter / _SCALE_ERROR)
        corrected = corrected - scale[..., None, None] * way
        mean = _mean(weights[..., None], corrected)
    independent = _independent(weights[..., None], shares)
    independent = independent / _uneven(weights, corrected - mean[..., None, :])
    doubt = _doubt(distrust, scatter, votes, noise_m)
    excess = _excess(distrust / (1 + drift))
    upright = rotation.is_upright
    return Fit(start + mean, samples, independent, scatter, distrust, excess, doubt, upright)


def _slope(weights: Array, values: Array, along: Array, ridge: Array) -> Array:
    """Least squares of `values` = slope * `along`, with a prior about zero, shape (...)."""
    xp = namespace(weights)
    product = xp.sum(weights[..., None] * values * along, axis=(-2, -1))
    return product / (xp.sum(weights[..., None] * along * along, axis=(-2, -1)) + ridge**2)


def _mean(weights: Array, samples: Array) -> Array:
    """Weighted mean over the votes; zero where no vote has weight."""
    xp = namespace(weights)
    total = xp.sum(weights, axis=-2)
    return xp.sum(weights * samples, axis=-2) / xp.maximum(total, xp.ones_like(total) * 1e-12)


def _excess(distrust: Array) -> Array:
    xp = namespace(distrust)
    return xp.maximum(distrust / 3 - _GATE, xp.zeros_like(distrust))


def _doubt(distrust: Array, scatter: Array, votes: Votes, noise: Array) -> Array:
    """Variance per axis by which most of the newest votes disagree with the mean, shape (...).

    Either they are wrong, as when the camera is covered, or the mean is. Zero while they are as
    near as predictions usually are.
    """
    xp = namespace(distrust)
    newest = (..., slice(0, _NEWEST))
    squares = _typical(votes.is_valid[newest]).median(distrust[newest]) * scatter**2 / 3
    return xp.maximum(squares - _GATE * noise**2, xp.zeros_like(squares))


def _independent(weights: Array, shares: Array) -> Array:
    """How many independent votes a mean rests on: views count, not votes, shape (..., k).

    Args:
        weights: Shape (..., n, k).
        shares: Shape (..., n), of the votes in their views' one weight.
    """
    xp = namespace(weights)
    own = shares[..., None]
    squares = xp.sum(xp.where(own > 0, weights * weights / (own + 1e-12), own * 0), axis=-2)
    number = xp.sum(weights, axis=-2) ** 2 / (squares + 1e-12)
    return xp.maximum(number, xp.ones_like(number))


def _uneven(weights: Array, residuals: Array) -> Array:
    """How much larger the votes' variance is along each axis than on average, (..., 3)."""
    xp = namespace(weights)
    squares = xp.sum(weights[..., None] * residuals**2, axis=-2) + 1e-12
    return xp.clip(squares / xp.mean(squares, axis=-1, keepdims=True), 0.3, 2.0)


class _Typical(NamedTuple):
    """Picks the lower median of some votes' values.

    Attributes:
        absent: Shape (..., n), a huge number for votes that do not count, else 0.
        is_middle: Shape (..., n), 1 at the median's place in the sorted values, else 0.
        number: Shape (...), of votes that count.
    """

    absent: Array
    is_middle: Array
    number: Array

    def median(self, values: Array) -> Array:
        """Of values of shape (..., n)."""
        xp = namespace(values)
        return xp.sum(xp.sort(values + self.absent, axis=-1) * self.is_middle, axis=-1)


def _typical(counts: Array) -> _Typical:
    """Of the votes where `counts` is 1 and not 0."""
    xp = namespace(counts)
    number = xp.sum(counts, axis=-1)
    index = constant(np.arange(counts.shape[-1]), counts)
    middle = xp.floor((number - 1) / 2)
    is_middle = xp.astype(index == middle[..., None], counts.dtype)
    return _Typical((1 - counts) * 1e12, is_middle, number)


def _since_jumps(votes: Votes, jumps: Array, noise: Array) -> _Typical:
    """The votes that the tracker has not jumped away from since."""
    xp = namespace(jumps)
    return _typical(votes.is_valid * xp.astype(jumps < (noise**2)[..., None], jumps.dtype))


def _jump_variance(shares: Array, jumps: Array, noise: Array) -> Array:
    """What jumps add to votes' variance, in units of the usual one, shape (..., n).

    Times the number of views: all votes from before a jump err together, and together they
    must not outweigh one vote from after it.
    """
    views = namespace(shares).sum(shares, axis=-1, keepdims=True)
    return jumps * views / (noise**2)[..., None]


def _distrust(
    residuals: Array, typical: _Typical, last: Array, limits: tuple[float, float]
) -> tuple[Array, Array]:
    """(residual / scatter)^2, shape (..., n), and the scatter, from the median residual.

    Args:
        residuals: Shape (..., n, 3).
        typical: The votes that the scatter is judged by.
        last: The last scatter, which holds until there are some votes, shape (...).
        limits: Of the scatter.
    """
    xp = namespace(residuals)
    squares = xp.sum(residuals * residuals, axis=-1)
    scatter = xp.sqrt(typical.median(squares) / _MEDIAN_CHI2)
    scatter = xp.where(typical.number < _FEW, last, scatter)
    least, most = (constant(limit, scatter) for limit in limits)
    scatter = xp.minimum(xp.maximum(scatter, least), most)
    return squares / (scatter**2)[..., None], scatter


def _best_supported(
    candidates: Array, squared_gaps: Array, scale: Array, shares: Array, drift: Array
) -> Array:
    """The vote that most others are near to, shape (..., d): where to start among outliers.

    Votes count the less, and are the less eligible, the more VIO has drifted since.
    """
    xp = namespace(shares)
    nearness = 1 / (1 + squared_gaps / (scale**2)[..., None, None])
    fresh = shares / (1 + drift)
    support = xp.sum(nearness * fresh[..., None, :], axis=-1)
    support = support * xp.astype(shares > 0, shares.dtype) / (1 + drift)
    index = xp.arange(shares.shape[-1])
    is_best = xp.astype(index == xp.argmax(support, axis=-1)[..., None], shares.dtype)
    return xp.sum(candidates * is_best[..., None], axis=-2)
