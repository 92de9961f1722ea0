"""Diagnostics of a walk by its numbers: counts, gravity, divergence, images."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.formats.anomalies import MAX_SPEED_M_S, find_anomalies
from vioapr.formats.readings import MIN_COMMON_FRAMES, up_of
from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.vectors import STANDARD_GRAVITY_M_S2, angle_between_deg
from vioapr.importers.base import Walk
from vioapr.scene.divergence import WINDOW_S, find_divergence
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.trajectory import Trajectory, nearest_rows

UP = np.array([0.0, 1.0, 0.0])
"""Of the tracker's world."""

MAX_NAMED = 3
"""Images or sizes that a finding names."""

_ACCEL_TOLERANCE_DEG = 10.0


def diagnose(walk: Walk) -> None:
    """Add findings on counts, gravity and divergence, and set what follows of them.

    Gravity is only looked for where there is a tracker.
    """
    rows = np.flatnonzero(walk.tracking != Tracking.LOST)
    images = sum(1 for name in walk.image_names if name)
    text = f"{len(walk)} frames: {images} with image, {len(rows)} with tracker's pose"
    walk.note(text if walk.gt is None else f"{text}, {len(walk.gt)} with ground truth")
    if walk.info.has_images and images < len(walk):
        missing = [row for row, name in enumerate(walk.image_names) if not name]
        walk.warn(f"images: {len(missing)} frames have none, the first is frame {missing[0] + 1}")
    if walk.info.tracker and len(rows) == 0:
        walk.warn("tracking was lost throughout: no frame has a pose")
    elif walk.info.tracker and len(rows) < len(walk):
        lost = len(walk) - len(rows)
        walk.warn(f"poses: {lost} of {len(walk)} frames have none (tracking lost)")
    if not walk.info.tracker or len(rows) < MIN_COMMON_FRAMES:
        return
    diagnose_gravity(walk, rows)
    poses, is_timed = walk.vio_from_cam.at(rows), walk.info.clock == "device"
    onset_s = find_divergence(walk.timestamp_s[rows], poses.translation_m) if is_timed else None
    if onset_s is not None:
        extent_m = float(np.ptp(poses.translation_m, axis=0).max())
        walk.warn(
            f"the tracker is diverging: faster than {MAX_SPEED_M_S:.0f} m/s for {WINDOW_S:.0f} s "
            f"from {onset_s:.3f} s on, over {extent_m:.0f} m: left out of train and test"
        )
        walk.info = replace(walk.info, is_diverging=True)
    if not walk.info.is_diverging:
        # As `vioapr inspect` would: gaps, jumps, scale, camera axes.
        track = Trajectory(
            walk.timestamp_s[rows],
            poses.translation_m,
            poses.quat_xyzw,
            is_timed=is_timed,
            target="vio",
        )
        for text in find_anomalies(track):
            walk.warn(text)


def diagnose_gravity(walk: Walk, rows: NDArray[np.intp]) -> None:
    """Add findings on whether y is up in the tracker's world, and set `is_gravity_aligned`.

    Hand-held cameras are held level, so the mean of their up-vectors is up; and the mean
    specific force of a walk points up.

    Args:
        walk: With a tracker.
        rows: Frames with a pose.
    """
    up, spread_deg, is_portrait = up_of(walk.vio_from_cam.quat_xyzw[rows])
    name, off_deg = nearest_axis(up), float(angle_between_deg(up, UP))
    # A phone may be held tilted all the time, but hardly by half a right angle.
    if name == "+y":
        held = ", held in portrait" if is_portrait else ""
        walk.note(
            f"gravity: the tracker's +y is up, as the camera is held ({off_deg:.0f} deg off, "
            f"spread {spread_deg:.0f} deg{held})"
        )
    else:
        walk.warn(
            f"gravity: expected +y to be up in the tracker's world, but the camera's up is "
            f"{off_deg:.0f} deg off, nearest to {name}: marked as not gravity-aligned"
        )
        walk.info = replace(walk.info, is_gravity_aligned=False)
    off_deg = None if walk.imu is None else accelerometer_off_deg(walk, rows)
    if off_deg is not None and off_deg <= _ACCEL_TOLERANCE_DEG:
        walk.note(f"accelerometer: agrees with the tracker's up to {off_deg:.1f} deg")
    elif off_deg is not None:
        walk.warn(
            f"accelerometer: its up is {off_deg:.0f} deg off the tracker's: other axes, another "
            "clock, or a world that is not y up"
        )


def diagnose_images(walk: Walk, broken: Sequence[str], sizes: Collection[tuple[int, int]]) -> None:
    """Add findings on a walk's images.

    Args:
        walk: The walk.
        broken: Images that cannot be used, and why.
        sizes: Widths and heights of the others, pixels.

    Raises:
        FormatError: No image can be used.
    """
    wanted = sum(1 for name in walk.image_names if name)
    if broken:
        named = "; ".join(broken[:MAX_NAMED]) + ("; ..." if len(broken) > MAX_NAMED else "")
        walk.warn(f"images: {len(broken)} are missing or broken, their frames have none: {named}")
    if wanted and len(broken) == wanted:
        raise FormatError(walk.source, f"none of {wanted} images can be used: {broken[0]}")
    size = np.column_stack([np.ravel(walk.intrinsics.width), np.ravel(walk.intrinsics.height)])
    said = {(int(w), int(h)) for w, h in size[np.isfinite(size).all(axis=1)].tolist()}
    found, expected = (
        ", ".join(f"{width}x{height}" for width, height in sorted(some)[:MAX_NAMED])
        for some in (sizes, said)
    )
    if sizes and said and set(sizes) != said:
        walk.warn(f"intrinsics: they are of images of {expected}, and the images are {found}")
    elif sizes:
        known = "known" if np.isfinite(np.asarray(walk.intrinsics.fx)).all() else "not known"
        walk.note(f"images: {found} pixels; focal length {known}")


def drop_impossible_intrinsics(walk: Walk) -> None:
    """Mark cameras that cannot be as not known, and warn of them."""
    table = np.array([np.broadcast_to(column, len(walk)) for column in walk.intrinsics])
    size, pinhole = table[:2], table[2:]
    with np.errstate(invalid="ignore"):
        is_odd_size = ~((size >= 1) & (size == np.round(size))).all(axis=0)
        is_odd = ~(np.isfinite(pinhole).all(axis=0) & (pinhole[:2] > 0).all(axis=0))
    is_wrong = np.isfinite(size).any(axis=0) & is_odd_size
    is_wrong |= np.isfinite(pinhole).any(axis=0) & is_odd
    if is_wrong.any():
        walk.warn(
            f"intrinsics: those of {is_wrong.sum()} frames are left out: sizes must be whole, "
            "focal lengths above 0"
        )
        table[:2, is_odd_size], table[2:, is_odd] = np.nan, np.nan
        walk.intrinsics = Intrinsics(*table)


def accelerometer_off_deg(walk: Walk, rows: NDArray[np.intp]) -> float | None:
    """Angle between the tracker's up and that of the accelerometer, or None where it has none.

    Args:
        walk: With `imu`.
        rows: Frames with a pose.
    """
    assert walk.imu is not None
    force = walk.imu.accel_m_s2
    known = np.isfinite(force).all(axis=1)
    least = STANDARD_GRAVITY_M_S2 / 2
    if not known.any() or np.median(np.linalg.norm(force[known], axis=1)) < least:
        return None
    frame = rows[nearest_rows(walk.imu.timestamp_s[known], walk.timestamp_s[rows])]
    mean = quaternion.rotate(walk.vio_from_cam.quat_xyzw[frame], force[known]).mean(axis=0)
    return float(angle_between_deg(mean, UP))


def nearest_axis(direction: NDArray[np.float64]) -> str:
    """The coordinate axis that a direction, shape (3,), is nearest to, e.g. "+z"."""
    axis = int(np.argmax(np.abs(direction)))
    return ("+" if direction[axis] > 0 else "-") + "xyz"[axis]


def turn_y_up(poses: Trajectory) -> tuple[str, Rigid3]:
    """Turn poses into a y-up world, by how cameras are held: many tools keep z up.

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
    """Find which axis of a map is up by the tracker.

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
    name = nearest_axis(mean)
    axis = np.zeros(3)
    axis["xyz".index(name[1])] = 1.0 if name[0] == "+" else -1.0
    spread_deg = float(np.median(angle_between_deg(ups, mean)))
    return name, float(angle_between_deg(mean, axis)), spread_deg
