"""Ground truth between mapped images, interpolated by VIO over fractions of a second."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Frames, Tracking

MAX_GAP_S = 1.5
"""Mapped images further apart in time tell nothing of what is between."""

MAX_DISAGREEMENT_M, MAX_DISAGREEMENT_DEG = 0.05, 1.0
"""If VIO and the map differ by more on the way from one mapped image to the next, neither is
trusted in between: a jump of the tracker, or an image in a wrong place."""


def interpolate_by_vio(
    frames: Frames, mapped_rows: NDArray[np.intp], world_from_cam: Rigid3
) -> tuple[NDArray[np.intp], Rigid3]:
    """Interpolate the poses of frames between mapped ones, as VIO moves.

    Args:
        frames: Of one recording, n of them.
        mapped_rows: Increasing rows of the mapped frames, m of them.
        world_from_cam: Their poses, shape (m,).

    Returns:
        Rows that are not mapped and lie between two trusted mapped ones, and their poses: those
        by VIO from both sides, blended by time.
    """
    nothing = np.zeros(0, dtype=np.intp), Rigid3(np.zeros((0, 3)), np.zeros((0, 4)))
    if len(mapped_rows) < 2:
        return nothing
    rows = np.setdiff1d(np.flatnonzero(frames.has_pose), mapped_rows)
    after = np.searchsorted(mapped_rows, rows)
    is_between = (after > 0) & (after < len(mapped_rows))
    rows, after = rows[is_between], after[is_between]
    kept = find_trusted_gaps(frames, mapped_rows, world_from_cam)[after - 1]
    kept &= frames.tracking[rows] != Tracking.LIMITED
    rows, after = rows[kept], after[kept]
    if not len(rows):
        return nothing
    vio, times = frames.vio_from_cam, frames.timestamp_s
    start, end = (
        world_from_cam.at(side) @ rigid.between(vio.at(mapped_rows[side]), vio.at(rows))
        for side in (after - 1, after)
    )
    start_s, end_s = times[mapped_rows[after - 1]], times[mapped_rows[after]]
    return rows, rigid.interpolate(start, end, (times[rows] - start_s) / (end_s - start_s))


def find_trusted_gaps(
    frames: Frames, mapped_rows: NDArray[np.intp], world_from_cam: Rigid3
) -> NDArray[np.bool_]:
    """Find between which mapped frames VIO agrees with the map, so that it can be interpolated.

    Args:
        frames: Of one recording.
        mapped_rows: Increasing rows of the mapped frames, m of them.
        world_from_cam: Their poses, shape (m,).

    Returns:
        Shape (m - 1,).
    """
    first, second = mapped_rows[:-1], mapped_rows[1:]
    vio = frames.vio_from_cam
    with np.errstate(invalid="ignore"):
        in_map = rigid.between(
            world_from_cam.at(slice(None, -1)), world_from_cam.at(slice(1, None))
        )
        in_vio = rigid.between(vio.at(first), vio.at(second))
        agrees = rigid.distance_m(in_map, in_vio) <= MAX_DISAGREEMENT_M
        agrees &= rigid.angle_deg(in_map, in_vio) <= MAX_DISAGREEMENT_DEG
    agrees &= frames.tracking_world[first] == frames.tracking_world[second]
    agrees &= np.diff(frames.timestamp_s[mapped_rows]) <= MAX_GAP_S
    lost = np.concatenate([[0], np.cumsum(frames.tracking == Tracking.LOST)])
    return agrees & (lost[second] == lost[first])
