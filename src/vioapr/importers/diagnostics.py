"""What a walk's numbers say of it: counts, gravity, divergence; the same for every importer."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vioapr.formats.anomalies import MAX_SPEED_M_S, find_anomalies
from vioapr.formats.readings import MIN_COMMON_FRAMES, up_of
from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import Walk
from vioapr.scene.divergence import WINDOW_S, find_divergence
from vioapr.scene.frames import Tracking
from vioapr.trajectory import Trajectory, nearest_rows

UP = np.array([0.0, 1.0, 0.0])
"""Of the tracker's world."""

_ACCEL_TOLERANCE_DEG = 10.0
_GRAVITY_M_S2 = 9.80665


def judge(walk: Walk) -> None:
    """Add findings on counts, gravity and divergence, and set what follows of them.

    Gravity is only looked for where there is a tracker.
    """
    _judge_counts(walk)
    rows = np.flatnonzero(walk.tracking != Tracking.LOST)
    if not walk.info.tracker or len(rows) < MIN_COMMON_FRAMES:
        return
    _judge_gravity(walk, walk.vio_from_cam.quat_xyzw[rows])
    _judge_accelerometer(walk, rows)
    if walk.info.clock == "device":
        _judge_divergence(walk, rows)
    if not walk.info.is_diverging:
        _judge_defects(walk, rows)


def _judge_counts(walk: Walk) -> None:
    images = sum(1 for name in walk.image_names if name)
    poses = int((walk.tracking != Tracking.LOST).sum())
    text = f"{len(walk)} frames: {images} with image, {poses} with tracker's pose"
    if walk.gt is not None:
        text += f", {len(walk.gt)} with ground truth"
    walk.note(text)
    if walk.info.has_images and images < len(walk):
        missing = [row for row, name in enumerate(walk.image_names) if not name]
        walk.warn(f"images: {len(missing)} frames have none, the first is frame {missing[0] + 1}")
    if walk.info.tracker and poses == 0:
        walk.warn("tracking was lost throughout: no frame has a pose")
    elif walk.info.tracker and poses < len(walk):
        walk.warn(f"poses: {len(walk) - poses} of {len(walk)} frames have none (tracking lost)")


def _judge_gravity(walk: Walk, quat_xyzw: NDArray[np.float64]) -> None:
    """Hand-held cameras are held level, so the mean of their up-vectors is up."""
    up, spread_deg, is_portrait = up_of(quat_xyzw)
    axis = int(np.argmax(np.abs(up)))
    name = ("+" if up[axis] > 0 else "-") + "xyz"[axis]
    off_deg = float(np.degrees(np.arccos(np.clip(up @ UP, -1, 1))))
    held = ", held in portrait" if is_portrait else ""
    # A phone may be held tilted all the time, but hardly by half a right angle.
    if name == "+y":
        walk.note(
            f"gravity: the tracker's +y is up, as the camera is held ({off_deg:.0f} deg off, "
            f"spread {spread_deg:.0f} deg{held})"
        )
        return
    walk.warn(
        f"gravity: expected +y to be up in the tracker's world, but the camera's up is "
        f"{off_deg:.0f} deg off, nearest to {name}: marked as not gravity-aligned"
    )
    walk.info = replace(walk.info, is_gravity_aligned=False)


def _judge_accelerometer(walk: Walk, rows: NDArray[np.intp]) -> None:
    """The mean specific force of a walk points up."""
    if walk.imu is None:
        return
    off_deg = accelerometer_off_deg(walk, rows)
    if off_deg is None:
        return
    if off_deg <= _ACCEL_TOLERANCE_DEG:
        walk.note(f"accelerometer: agrees with the tracker's up to {off_deg:.1f} deg")
    else:
        walk.warn(
            f"accelerometer: its up is {off_deg:.0f} deg off the tracker's: other axes, another "
            "clock, or a world that is not y up"
        )


def accelerometer_off_deg(walk: Walk, rows: NDArray[np.intp]) -> float | None:
    """Angle between the tracker's up and that of the accelerometer, or None where it has none.

    Args:
        walk: With `imu`.
        rows: Frames with a pose.
    """
    assert walk.imu is not None
    force = walk.imu.accel_m_s2
    known = np.isfinite(force).all(axis=1)
    if not known.any() or np.median(np.linalg.norm(force[known], axis=1)) < _GRAVITY_M_S2 / 2:
        return None
    frame = rows[nearest_rows(walk.imu.timestamp_s[known], walk.timestamp_s[rows])]
    mean = quaternion.rotate(walk.vio_from_cam.quat_xyzw[frame], force[known]).mean(axis=0)
    return float(np.degrees(np.arccos(np.clip(mean @ UP / np.linalg.norm(mean), -1, 1))))


def _judge_divergence(walk: Walk, rows: NDArray[np.intp]) -> None:
    onset_s = find_divergence(walk.timestamp_s[rows], walk.vio_from_cam.translation_m[rows])
    if onset_s is None:
        return
    extent_m = float(np.ptp(walk.vio_from_cam.translation_m[rows], axis=0).max())
    walk.warn(
        f"the tracker is diverging: faster than {MAX_SPEED_M_S:.0f} m/s for {WINDOW_S:.0f} s "
        f"from {onset_s:.3f} s on, over {extent_m:.0f} m: left out of train and test"
    )
    walk.info = replace(walk.info, is_diverging=True)


def _judge_defects(walk: Walk, rows: NDArray[np.intp]) -> None:
    """What `vioapr inspect` would say of the track: gaps, jumps, scale, camera axes."""
    poses = walk.vio_from_cam.at(rows)
    is_timed = walk.info.clock == "device"
    track = Trajectory(walk.timestamp_s[rows], *poses, is_timed=is_timed, target="vio")
    for text in find_anomalies(track):
        walk.warn(text)


def turn_y_up(poses: Trajectory) -> tuple[str, Rigid3]:
    """Poses in a y-up world, judged by how cameras are held: many tools keep z up.

    Returns:
        What was done, for people; target_from_cam.
    """
    up = up_of(poses.quat_xyzw)[0]
    if up[2] > max(abs(up[0]), abs(up[1])):
        return "z up, turned to y up", y_up_from_z_up(poses.target_from_source)
    return "kept as it is", poses.target_from_source


def map_up(
    gt: Trajectory, vio_from_cam: Rigid3, rows: NDArray[np.intp]
) -> tuple[str, float, float]:
    """Which axis of a map is up, judged by the tracker.

    Args:
        gt: Poses in the map.
        vio_from_cam: The tracker's poses of all frames.
        rows: The frame of each pose of `gt`.

    Returns:
        The nearest axis, e.g. "+z"; the angle to it; the median angle of single frames to the
        mean, degrees. The axis is "" where no frame has both poses.
    """
    quats, known = vio_from_cam.quat_xyzw[rows], vio_from_cam.at(rows).is_known
    if not known.any():
        return "", np.nan, np.nan
    world_from_vio = quaternion.multiply(gt.quat_xyzw[known], quaternion.inverse(quats[known]))
    ups = quaternion.rotate(world_from_vio, np.broadcast_to(UP, (int(known.sum()), 3)))
    mean = np.median(ups, axis=0)
    mean = mean / max(float(np.linalg.norm(mean)), 1e-9)
    axis = int(np.argmax(np.abs(mean)))
    off_deg = float(np.degrees(np.arccos(np.clip(abs(mean[axis]), 0, 1))))
    spread_deg = float(np.degrees(np.median(np.arccos(np.clip(ups @ mean, -1, 1)))))
    return ("+" if mean[axis] > 0 else "-") + "xyz"[axis], off_deg, spread_deg
