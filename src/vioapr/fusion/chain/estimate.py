"""What method `chain` answers: its leading hypothesis, carried on by VIO, and how sure it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.agreement import Agreement
from vioapr.fusion.chain.columns import column, product, turns_from, y_up_turn
from vioapr.fusion.chain.hypotheses import Hypotheses
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.sums import largest_of_three, squared_lengths, to_axes
from vioapr.fusion.types import Estimate, FrameInput, LocalizationState, Status
from vioapr.geometry.arrays import Array, Mask, constant, namespace
from vioapr.geometry.rigid import Rigid3

_COMMON_BIAS = 0.1
"""Share of a prediction's variance that all views of a place have in common, and that no
comparison of predictions can show."""

_USUAL_AGREEMENT = 0.75
"""Of predictions of which every fourth is wild; what is less raises doubt."""

SCALES = np.array([[0.8], [0.65]])
"""From the model's standard deviations to the scales of the heavy-tailed distribution that is
stated, Student's t with two degrees of freedom: a compromise between sets of walks, which a
calibration replaces (docs/results/accuracy.md, Calibration)."""

_DEGREES = np.array([[180 / np.pi], [1.0]])
_OF_POSITION = np.array([[0.0]] * 3 + [[1.0]] * 3)
_MEANS = np.kron(np.eye(2), np.full((1, 3), 1 / 3))


class Knowledge(NamedTuple):
    """What an answer rests on.

    Attributes:
        hypotheses: Both, as of the last prediction.
        agreement: Of predictions and motion.
        noise: Typical error of a prediction, rad and m, shape (..., 2, 1).
        drift: Of orientation and position that is to be expected in a metre, rad^2 and m^2,
            shape (..., 2, 1).
        since: What the odometer has read since the last prediction, shape (..., 3, 1).
        moved_m: The tracker's way since, shape (..., 3, 1).
        is_known: Whether a prediction has been used in this tracking world, shape (..., 1, 1).
    """

    hypotheses: Hypotheses
    agreement: Agreement
    noise: Array
    drift: Array
    since: Array
    moved_m: Array
    is_known: Mask


def answer(
    params: ChainParams,
    known: Knowledge,
    is_used: Mask,
    vio_from_cam: Array,
    frame: FrameInput,
) -> Estimate:
    """The leading hypothesis, carried on by VIO; without tracking, the raw prediction.

    Args:
        params: Of the method.
        known: What is known.
        is_used: Whether this frame's prediction was used for it, shape (...).
        vio_from_cam: The tracker's pose, z up, as a column.
        frame: As it came in.
    """
    both, agreement = known.hypotheses, known.agreement
    xp = namespace(known.noise)
    matrices, turns = both.matrices, both.world_from_vio
    places_m = both.place_m + matrices @ known.moved_m[..., None, :, :]
    turn, matrix, place_m = (part[..., 0, :, :] for part in (turns, matrices, places_m))
    pose = xp.concat([place_m, product(turn, vio_from_cam[..., 3:, :])], axis=-2)
    origin_m = place_m - matrix @ vio_from_cam[..., :3, :]
    world = xp.concat([origin_m, y_up_turn(turn)], axis=-2)
    is_known = known.is_known[..., 0, 0]
    is_placed = frame.tracking_ok & is_known
    if params.not_here:
        is_placed = is_placed & agreement.is_here[..., 0, 0]
    is_raw = frame.has_apr & ~frame.tracking_ok
    placed, raw = is_placed[..., None, None], is_raw[..., None, None]
    apr = xp.where(raw, column(frame.apr_world_from_cam), np.nan)
    spread = xp.where(raw, to_axes(known.noise * known.noise), np.nan)
    gap = xp.concat(
        [
            turns_from(turns[..., 1, :, :], turn),
            places_m[..., 1, :, :] - place_m,
        ],
        axis=-2,
    )
    axes = xp.sqrt(xp.where(placed, _variances(known, gap), spread)) * _scales(params, spread)
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
        _state(frame.tracking_ok, is_known, agreement),
        xp.where(placed, agreement.confidence, 0.0)[..., 0, 0],
    )


def _variances(known: Knowledge, gap: Array) -> Array:
    """Of the leading pose about and along the six axes, rad^2 and m^2, shape (..., 6, 1).

    Args:
        known: What is known.
        gap: From the leading to the other hypothesis, rad and m, shape (..., 6, 1).
    """
    hypotheses, agreement = known.hypotheses, known.agreement
    xp = namespace(gap)
    growth = known.drift * known.since[..., :1, :] + known.since[..., 1:, :]
    # What predictions deny is as wrong as they say; and of two that compete, either may be right.
    denied = xp.maximum(_USUAL_AGREEMENT - hypotheses.agreement[..., 0, :, :], 0.0)
    doubt = denied * agreement.surprise
    doubt = (doubt + hypotheses.other_share * squared_lengths(gap)) / 3
    both = growth + _COMMON_BIAS * known.noise * known.noise + agreement.beyond + doubt
    variances = 1 / hypotheses.precision[..., 0, :, :] + to_axes(both)
    way2 = known.moved_m.mT @ known.moved_m
    by_turn = largest_of_three(variances[..., :3, :]) * way2
    return variances + constant(_OF_POSITION, variances) * by_turn


def _scales(params: ChainParams, like: Array) -> Array:
    """From standard deviations in rad and m to what is stated, in deg and m, shape (6, 1)."""
    factors = np.array([[params.sigma_orientation_factor], [params.sigma_position_factor]])
    return to_axes(constant(_DEGREES * SCALES * factors, like))


def _state(tracking_ok: Mask, is_known: Mask, agreement: Agreement) -> Array:
    """Numbers of `LocalizationState`, shape (...)."""
    xp = namespace(tracking_ok)
    is_here, is_sure, was_found = (
        flag[..., 0, 0] for flag in (agreement.is_here, agreement.is_sure, agreement.was_found)
    )
    state = 0 * agreement.verdict[..., 0, 0]
    found = is_known & was_found
    for flag, value in (
        (found & ~is_sure, LocalizationState.UNCERTAIN),
        (found & is_sure, LocalizationState.LOCALIZED),
        (is_known & ~is_here, LocalizationState.NOT_HERE),
        (~tracking_ok, LocalizationState.LOST),
    ):
        state = xp.where(flag, float(value), state)
    return xp.astype(state, xp.int32)


def _rigid(pose: Array) -> Rigid3:
    return Rigid3(pose[..., :3, 0], pose[..., 3:, 0])


def _status(is_placed: Mask, is_raw: Mask, is_used: Mask) -> Array:
    """Of these three only the first and the last may hold together."""
    xp = namespace(is_used)
    placed, raw, used = (xp.astype(one, xp.int32) for one in (is_placed, is_raw, is_used))
    further = int(Status.OPTIMIZED) - int(Status.TRACKED)
    return placed * int(Status.TRACKED) + used * further + raw * int(Status.PREDICTED)
