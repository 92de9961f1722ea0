"""What method `chain` answers: its leading hypothesis, carried on by VIO, and how sure it is."""

from __future__ import annotations

import numpy as np

from vioapr.fusion.chain.agreement import Agreement
from vioapr.fusion.chain.columns import column, product, turns_from, y_up_turn
from vioapr.fusion.chain.hypotheses import Hypotheses
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.sums import largest_of_three, squared_lengths, to_axes
from vioapr.fusion.types import Estimate, FrameInput, Status
from vioapr.geometry.arrays import Array, Mask, constant, namespace
from vioapr.geometry.rigid import Rigid3

_COMMON_BIAS = 0.1
"""Share of a prediction's variance that all views of a place have in common, and that no
comparison of predictions can show."""

_USUAL_AGREEMENT = 0.7
"""Of predictions of which every fourth is wild; what is less raises doubt."""

_SCALES = np.array([[0.8], [0.65]])
"""From the model's standard deviations to the scales of the heavy-tailed distribution that is
stated, Student's t with two degrees of freedom: a compromise between sets of walks, which a
calibration replaces (docs/results/accuracy.md, Calibration)."""

_DEGREES = np.array([[180 / np.pi], [1.0]])
_MEANS = np.kron(np.eye(2), np.full((1, 3), 1 / 3))


def variances_of(
    hypotheses: Hypotheses,
    agreement: Agreement,
    noise: Array,
    drift: Array,
    since: Array,
    moved_m: Array,
    places_m: Array,
) -> Array:
    """Of the leading pose about and along the six axes, rad^2 and m^2, shape (..., 6, 1).

    Args:
        hypotheses: Both.
        agreement: Of predictions and motion.
        noise: Typical error of a prediction, rad and m, shape (..., 2, 1).
        drift: That is to be expected in a metre, rad^2 and m^2, shape (..., 2, 1).
        since: What the odometer has read since the last prediction, shape (..., 3, 1).
        moved_m: The tracker's way since, shape (..., 3, 1).
        places_m: Where both hypotheses have the camera, shape (..., 2, 3, 1).
    """
    xp = namespace(noise)
    growth = drift * since[..., :1, :] + since[..., 1:, :]
    # Of two that compete, either may be right.
    lead = hypotheses.evidence[..., 1, :, :] - hypotheses.evidence[..., 0, :, :]
    odds = xp.exp(xp.minimum(lead / 2, 0.0))
    odds = odds * xp.astype(hypotheses.evidence[..., 1, :, :] > 0.5, odds.dtype)
    turns = turns_from(
        hypotheses.world_from_vio[..., 1, :, :], hypotheses.world_from_vio[..., 0, :, :]
    )
    gap = xp.concat([turns, places_m[..., 1, :, :] - places_m[..., 0, :, :]], axis=-2)
    apart = squared_lengths(gap) / 3
    # And what predictions deny is as wrong as they say.
    denied = xp.maximum(_USUAL_AGREEMENT - hypotheses.agreement[..., 0, :, :], 0.0)
    doubt = denied * denied * agreement.surprise / 3 + odds / (1 + odds) * apart
    both = growth + _COMMON_BIAS * noise * noise + agreement.beyond + doubt
    variances = 1 / hypotheses.precision[..., 0, :, :] + to_axes(both)
    by_turn = largest_of_three(variances[..., :3, :]) * (moved_m.mT @ moved_m)
    return variances + constant(_OF_POSITION, variances) * by_turn


_OF_POSITION = np.array([[0.0]] * 3 + [[1.0]] * 3)


def answer(
    params: ChainParams,
    turn: Array,
    matrix: Array,
    position_m: Array,
    variances: Array,
    noise: Array,
    is_placed: Mask,
    is_used: Mask,
    vio_from_cam: Array,
    frame: FrameInput,
) -> Estimate:
    """The leading hypothesis, carried on by VIO; without tracking, the raw prediction.

    Args:
        params: Of the method.
        turn: The leading world_from_vio, shape (..., 4, 1).
        matrix: The same rotation, shape (..., 3, 3).
        position_m: Where it has the camera, shape (..., 3, 1).
        variances: See `variances_of`.
        noise: Typical error of a prediction, rad and m, shape (..., 2, 1).
        is_placed: Whether there is an answer, shape (...).
        is_used: Whether this frame's prediction was used for it, shape (...).
        vio_from_cam: The tracker's pose, z up, as a column.
        frame: As it came in.
    """
    xp = namespace(noise)
    pose = xp.concat([position_m, product(turn, vio_from_cam[..., 3:, :])], axis=-2)
    origin_m = position_m - matrix @ vio_from_cam[..., :3, :]
    world = xp.concat([origin_m, y_up_turn(turn)], axis=-2)
    is_raw = frame.has_apr & ~frame.tracking_ok
    placed, raw = is_placed[..., None, None], is_raw[..., None, None]
    apr = xp.where(raw, column(frame.apr_world_from_cam), np.nan)
    spread = to_axes(noise * noise)
    variances = xp.where(placed, variances, xp.where(raw, spread, np.nan))
    factors = [params.sigma_orientation_factor, params.sigma_position_factor]
    scales = constant(_DEGREES * _SCALES * np.array([factors]).T, noise)
    axes = xp.sqrt(variances) * to_axes(scales)
    means = xp.sqrt(constant(_MEANS, axes) @ (axes * axes))
    status = _status(is_placed, is_raw, is_placed & is_used)
    return Estimate(
        _rigid(xp.where(placed, pose, apr)),
        _rigid(xp.where(placed, world, np.nan)),
        status,
        status * 0,
        means[..., 1, 0],
        means[..., 0, 0],
        axes[..., 3:, 0],
        axes[..., :3, 0],
    )


def _rigid(pose: Array) -> Rigid3:
    return Rigid3(pose[..., :3, 0], pose[..., 3:, 0])


def _status(is_placed: Mask, is_raw: Mask, is_used: Mask) -> Array:
    """Of these three only the first and the last may hold together."""
    xp = namespace(is_used)
    placed, raw, used = (xp.astype(one, xp.int32) for one in (is_placed, is_raw, is_used))
    further = int(Status.OPTIMIZED) - int(Status.TRACKED)
    return placed * int(Status.TRACKED) + used * further + raw * int(Status.PREDICTED)
