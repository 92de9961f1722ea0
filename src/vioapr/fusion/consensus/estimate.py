"""What method `consensus` answers: its latest mean, carried on by VIO."""

from __future__ import annotations

import numpy as np

from vioapr.fusion.consensus.anchor import Anchor
from vioapr.fusion.consensus.columns import column, product, y_up_turn
from vioapr.fusion.types import Estimate, FrameInput, Status
from vioapr.geometry.arrays import Array, Mask, constant, namespace
from vioapr.geometry.rigid import Rigid3

_SCALES = np.array([[0.65 * 180 / np.pi], [0.75]])
"""From standard deviations in rad and m to the scales, in deg and m, of the heavy-tailed
distribution that is stated: Student's t with two degrees of freedom (docs/results/accuracy.md,
Calibration)."""

_MEAN = np.full((3, 1), 1 / 3)


def estimate(
    anchor: Anchor, noise: Array, odometer: Array, vio_from_cam: Array, frame: FrameInput
) -> Estimate:
    """The anchor, carried on by VIO; without tracking, the raw prediction.

    Args:
        anchor: The latest one.
        noise: Typical error of a prediction, rad and m, shape (..., 2, 1).
        odometer: Its readings now.
        vio_from_cam: The tracker's pose, z up, as a column.
        frame: As it came in.
    """
    xp = namespace(noise)
    is_placed = frame.tracking_ok & anchor.is_known[..., 0, 0]
    is_raw = frame.has_apr & ~frame.tracking_ok
    placed, raw = is_placed[..., None, None], is_raw[..., None, None]
    position, turn = anchor.carry(vio_from_cam[..., :3, :]), anchor.world_from_vio
    pose = xp.concat([position, product(turn, vio_from_cam[..., 3:, :])], axis=-2)
    apr = xp.where(raw, column(frame.apr_world_from_cam), np.nan)
    world = xp.concat([anchor.carry(xp.zeros_like(position)), y_up_turn(turn)], axis=-2)
    deviations = anchor.deviations(vio_from_cam[..., :3, :], odometer)
    deviations = xp.where(placed, deviations, xp.where(raw, noise, np.nan))
    sigmas = deviations * constant(_SCALES, deviations)
    means = xp.sqrt((sigmas * sigmas) @ constant(_MEAN, sigmas))
    status = _status(is_placed, is_raw, frame.has_apr & frame.tracking_ok)
    return Estimate(
        _rigid(xp.where(placed, pose, apr)),
        _rigid(xp.where(placed, world, np.nan)),
        status,
        status * 0,
        means[..., 1, 0],
        means[..., 0, 0],
        sigmas[..., 1, :],
        sigmas[..., 0, :],
    )


def _rigid(pose: Array) -> Rigid3:
    return Rigid3(pose[..., :3, 0], pose[..., 3:, 0])


def _status(is_placed: Mask, is_raw: Mask, is_vote: Mask) -> Array:
    """Of these three only the first and the last may hold together."""
    xp = namespace(is_vote)
    placed, raw, vote = (xp.astype(one, xp.int32) for one in (is_placed, is_raw, is_vote))
    further = int(Status.OPTIMIZED) - int(Status.TRACKED)
    return placed * int(Status.TRACKED) + vote * further + raw * int(Status.PREDICTED)
