"""Diagnostics of a walk by its numbers: counts, gravity, divergence, images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
from vioapr.plurals import count_of
from vioapr.scene.divergence import WINDOW_S, find_divergence
from vioapr.scene.frames import Tracking
from vioapr.trajectory import Trajectory, nearest_rows

UP = np.array([0.0, 1.0, 0.0])
"""Of the tracker's world."""

MAX_NAMED = 3
"""Images or sizes that a finding names."""

_ACCEL_TOLERANCE_DEG, _OPPOSITE_DEG = 10.0, 150.0
_STEADY = 0.9
# Of a way in a plane: its least spread, how flat it is, and how near its normal is to an axis.
_LEAST_SPREAD_M, _FLAT, _CLEAR_COSINE = 0.5, 0.2, 0.95


COUNTS = "counts"
"""The topic of how many frames have what."""


def note_counts(walk: Walk, images: int) -> None:
    """Say how many frames have an image, a tracker's pose and ground truth."""
    rows = np.flatnonzero(walk.tracking != Tracking.LOST)
    text = f"{count_of(len(walk), 'frame')}: {images} with image, {len(rows)} with tracker's pose"
    walk.note(text if walk.gt is None else f"{text}, {len(walk.gt)} with ground truth", COUNTS)


def diagnose(walk: Walk) -> None:
    """Add findings on counts, gravity and divergence, and set what follows of them.

    Gravity is only looked for where there is a tracker.
    """
    rows = np.flatnonzero(walk.tracking != Tracking.LOST)
    images = sum(1 for name in walk.image_names if name)
    note_counts(walk, images)
    if walk.info.has_images and images < len(walk):
        missing = [row for row, name in enumerate(walk.image_names) if not name]
        lacking = count_of(len(missing), "frame has", "frames have")
        text = f"images: {lacking} none, the first is frame {missing[0] + 1}"
        (walk.note if walk.is_thinned else walk.warn)(text)
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

    The accelerometer decides: the mean specific force of a walk points up. Without one, the
    format decides, and only where nobody says how the camera is held: level, mostly. A phone
    may look down all the time, at a desk or at the floor.

    Args:
        walk: With a tracker.
        rows: Frames with a pose.
    """
    held = describe_holding(walk, rows)
    measured = measure_up(walk, rows)
    if measured is not None:
        off_deg, is_steady = measured
        if off_deg <= _ACCEL_TOLERANCE_DEG:
            odd = "" if held.is_y_up else "the tracker's +y is up by the accelerometer; "
            walk.note(f"gravity: {odd}{held.text}")
            walk.note(f"accelerometer: agrees with the tracker's up to {off_deg:.1f} deg")
            return
        text = f"accelerometer: its up is {off_deg:.0f} deg off the tracker's: other axes, another "
        if is_steady and off_deg < _OPPOSITE_DEG:
            walk.warn(f"{text}clock, or a world that is not y up: marked as not gravity-aligned")
            walk.info = replace(walk.info, is_gravity_aligned=False)
            return
        walk.warn(f"{text}sign or another clock: it is not trusted")
    if walk.up == "first-pose":
        walk.note(
            "gravity: the world is the first camera's, whose tilt nobody knows: marked as not "
            "gravity-aligned"
        )
        walk.info = replace(walk.info, is_gravity_aligned=False)
    elif held.is_y_up:
        walk.note(f"gravity: {held.text}")
    elif walk.up == "definition":
        walk.note(f"gravity: the tracker's +y is up by its definition; {held.text}")
    else:
        walk.warn(
            f"gravity: expected +y to be up in the tracker's world, but {held.text}: marked as not "
            "gravity-aligned"
        )
        walk.info = replace(walk.info, is_gravity_aligned=False)


class Holding(NamedTuple):
    """How a camera is held in its tracker's world.

    Attributes:
        is_y_up: Whether +y is the axis nearest to the camera's up.
        text: For people.
    """

    is_y_up: bool
    text: str


def describe_holding(walk: Walk, rows: NDArray[np.intp]) -> Holding:
    """Describe how the camera is held in the frames with a pose."""
    up, spread_deg, is_portrait = up_of(walk.vio_from_cam.quat_xyzw[rows])
    name, off_deg = nearest_axis(up), float(angle_between_deg(up, UP))
    # A phone may be held tilted all the time, but hardly by half a right angle.
    if name != "+y":
        return Holding(False, f"the camera's up is {off_deg:.0f} deg off, nearest to {name}")
    level = level_axis(walk.vio_from_cam.translation_m[rows])
    if level not in (None, "y"):
        return Holding(False, f"the way lies in a plane across {level}")
    portrait = ", held in portrait" if is_portrait else ""
    return Holding(
        True,
        f"the tracker's +y is up, as the camera is held ({off_deg:.0f} deg off, spread "
        f"{spread_deg:.0f} deg{portrait})",
    )


def level_axis(position_m: NDArray[np.float64]) -> str | None:
    """The axis that is across the plane of a walk, or None where the way is in no clear plane.

    People walk on floors: over some metres, the way is flat and spreads along two axes.

    Args:
        position_m: Shape (n, 3), in whatever unit.
    """
    centred = position_m - position_m.mean(axis=0)
    spreads, axes = np.linalg.eigh(centred.T @ centred / len(centred))
    flat, middle, _ = np.sqrt(np.maximum(spreads, 0)).tolist()
    normal = axes[:, 0]
    if middle < _LEAST_SPREAD_M or flat > _FLAT * middle or np.abs(normal).max() < _CLEAR_COSINE:
        return None
    return nearest_axis(normal)[1]


def diagnose_images(walk: Walk, broken: Sequence[str]) -> None:
    """Add findings on a walk's images, and count them again.

    Args:
        walk: The walk.
        broken: Images that cannot be used, and why.

    Raises:
        FormatError: No image can be used.
    """
    wanted = sum(1 for name in walk.image_names if name)
    if broken:
        named = "; ".join(broken[:MAX_NAMED]) + ("; ..." if len(broken) > MAX_NAMED else "")
        walk.warn(f"images: {len(broken)} are missing or broken, their frames have none: {named}")
    if wanted and len(broken) == wanted:
        raise FormatError(walk.source, f"none of {wanted} images can be used: {broken[0]}")
    note_counts(walk, wanted - len(broken))


def measure_up(walk: Walk, rows: NDArray[np.intp]) -> tuple[float, bool] | None:
    """Measure the tracker's up by the accelerometer.

    Args:
        walk: The walk.
        rows: Frames with a pose.

    Returns:
        The angle between the tracker's up and the accelerometer's, degrees, and whether the
        latter is steady in the tracker's world; None where there is no accelerometer.
    """
    if walk.imu is None or not len(walk.imu.timestamp_s):
        return None
    force = walk.imu.accel_m_s2
    known = np.isfinite(force).all(axis=1)
    least = STANDARD_GRAVITY_M_S2 / 2
    if not known.any() or np.median(np.linalg.norm(force[known], axis=1)) < least:
        return None
    frame = rows[nearest_rows(walk.imu.timestamp_s[known], walk.timestamp_s[rows])]
    forces = quaternion.rotate(walk.vio_from_cam.quat_xyzw[frame], force[known])
    mean = forces.mean(axis=0)
    length = float(np.linalg.norm(mean))
    is_steady = length > _STEADY * float(np.linalg.norm(forces, axis=1).mean())
    return float(angle_between_deg(mean, UP)), is_steady


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
    # A camera that looks down has its up along the floor, maybe along z.
    is_level = level_axis(poses.position_m) in (None, "z")
    if up[2] > max(abs(up[0]), abs(up[1])) and is_level:
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
