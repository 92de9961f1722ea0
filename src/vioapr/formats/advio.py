"""ADVIO csv, no header: `time_s,x,y,z,qw,qx,qy,qz`, in two conventions.

Measured on the data, as nothing is documented:

- Ground truth (`*_gt_pose.csv`, `pose.csv`): positions are a mirror image, y up, so z is
  negated here; the quaternion is device_from_world of a z-up world, and is inverted and turned
  to the y-up world and OpenCV camera axes here.
- Trackers (`arkit.csv`, `arcore.csv`): world_from_cam, y up, OpenGL camera axes.
- The rotations of both are multiplied on the left by one unknown turn about z, of an angle that
  differs by sequence. One file alone cannot tell it, so reading does **not** correct it:
  distances between positions, and angles of relative rotations, are right; absolute orientations
  are not, and neither are the axes of the ground truth's relative rotations. From both files
  `find_turn` finds it, and `undo_turn` corrects them.
- The first rows of a tracker have the position 0,0,0, not initialised, and are left out. One
  such row alone is kept: it is a tracker's origin.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, FormatError
from vioapr.files.tables import format_rows, parse_rows
from vioapr.files.text import plain_name, read_text, write_text
from vioapr.formats import conventions, tum
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, poses_of, require_times
from vioapr.formats.table_guess import guess_formats
from vioapr.formats.times import seconds_of
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory

_COLUMNS = "time_s,x,y,z,qw,qx,qy,qz"

_Y_UP_FROM_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_QUARTER_TURN_ABOUT_Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_ARCAM_FROM_DEVICE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_CAM_FROM_ARCAM = np.diag([1.0, -1.0, -1.0])

_WORLD_FROM_Z_UP = quaternion.from_matrix(_Y_UP_FROM_Z_UP @ _QUARTER_TURN_ABOUT_Z)
_CAM_FROM_DEVICE = quaternion.from_matrix(_CAM_FROM_ARCAM @ _ARCAM_FROM_DEVICE)
_MIRROR_Z = np.array([1.0, 1.0, -1.0])


def world_from_cam_of_gt(file_poses: Rigid3) -> Rigid3:
    """Convert ground truth from the file's convention to ours."""
    z_up_from_device = quaternion.inverse(file_poses.quat_xyzw)
    world_from_device = quaternion.multiply(_WORLD_FROM_Z_UP, z_up_from_device)
    device_from_cam = quaternion.inverse(_CAM_FROM_DEVICE)
    return Rigid3(
        file_poses.translation_m * _MIRROR_Z,
        quaternion.multiply(world_from_device, device_from_cam),
    )


def gt_of_world_from_cam(world_from_cam: Rigid3) -> Rigid3:
    """Convert ground truth from our convention to the file's."""
    world_from_device = quaternion.multiply(world_from_cam.quat_xyzw, _CAM_FROM_DEVICE)
    z_up_from_device = quaternion.multiply(quaternion.inverse(_WORLD_FROM_Z_UP), world_from_device)
    return Rigid3(world_from_cam.translation_m * _MIRROR_Z, quaternion.inverse(z_up_from_device))


def _sniff(path: Path, head: bytes, *, is_tracker: bool) -> float:
    guesses = guess_formats(head)
    guess = guesses.get("advio-vio" if is_tracker else "advio-gt", 0.0)
    # The data set's own names: advio-01/iphone/arkit.csv, advio-01/ground-truth/pose.csv. The
    # short ones are also other people's, and do not count against the rows.
    name = plain_name(path)
    is_own = "advio" in name and guesses.keys() & {"tum", "euroc"}
    is_alike = name in ("arkit.csv", "arcore.csv", "pose.csv") and "advio-gt" in guesses
    names_tracker = any(word in name for word in ("arkit", "arcore"))
    names_truth = not names_tracker and ("gt_pose" in name or name == "pose.csv")
    if (is_own or is_alike) and (names_tracker or names_truth):
        return 0.9 if is_tracker == names_tracker else 0.1
    return guess


def _read(path: Path, options: ReadOptions, *, is_tracker: bool) -> Trajectory:
    rows = parse_rows(path, read_text(path), range(8, 9), what=_COLUMNS, delimiter=",")
    has_position = (rows.numbers(slice(1, 4)) != 0).any(axis=1)
    if not has_position.any() and len(rows) > 1:
        raise FormatError(
            path, "expected positions, got 0,0,0 in every row: the tracker never started"
        )
    first = int(np.argmax(has_position))
    rows = rows.at(range(first if first > 1 else 0, len(rows)))
    values = rows.numbers(slice(0, 8))
    poses = poses_of(rows, values[:, 1:4], values[:, [5, 6, 7, 4]])
    poses = conventions.world_from_arcam(poses) if is_tracker else world_from_cam_of_gt(poses)
    target = "vio" if is_tracker else "world"
    times = seconds_of(path, values[:, 0], options, fixed="s")
    return build_trajectory(rows, times, poses, options, target=target)


def _write(path: Path, trajectory: Trajectory, *, is_tracker: bool) -> None:
    require_times(trajectory, "an ADVIO file")
    poses = trajectory.target_from_source
    poses = conventions.world_from_arcam(poses) if is_tracker else gt_of_world_from_cam(poses)
    columns = pose_columns(poses, (3, 0, 1, 2))
    times = trajectory.timestamp_s.tolist()
    rows = [(time, *row) for time, row in zip(times, columns, strict=True)]
    write_text(path, format_rows(rows, ","))


def read_corrected(path: Path, *, is_tracker: bool) -> Trajectory:
    """Read a track that others have corrected: TUM columns, y up, ARKit's camera axes.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    trajectory = tum.read(path, ReadOptions())
    poses = conventions.world_from_arcam(trajectory.target_from_source)
    return replace(trajectory.with_transforms(poses), target="vio" if is_tracker else "world")


MAX_RESIDUAL_DEG = 5.0
"""Tracker and ground truth of one walk agree on what happens in a second better than this."""

_SPAN_S, _LEAST_TIMES = 1.0, 10
_MAX_OFFSET_S = 5.0


class Turn(NamedTuple):
    """The turn about z that a sequence's rotations were multiplied with.

    Attributes:
        angle_deg: Its angle, -180 to 180.
        residual_deg: Median angle between relative rotations over a second once it is undone.
    """

    angle_deg: float
    residual_deg: float


def find_turn(gt: Trajectory, vio: Trajectory) -> Turn:
    """The unknown turn of a sequence, from its two tracks as `read` gives them.

    The tracker's relative rotations do not depend on the turn, and those of the ground truth do.

    Raises:
        AssociationError: The tracks have too few times in common.
    """
    times = vio.timestamp_s
    times = times[(times >= gt.timestamp_s[0]) & (times <= gt.timestamp_s[-1])]
    times = times[(times + _SPAN_S) <= times[-1]] if len(times) else times
    if len(times) < _LEAST_TIMES:
        raise AssociationError("tracker and ground truth have too few times in common")
    moved, truth = (
        _relative(track.interpolate(times), track.interpolate(times + _SPAN_S))
        for track in (vio, gt)
    )

    def residual_deg(angle_deg: float) -> float:
        turned = _turn_about_z(angle_deg)
        expected = quaternion.multiply(
            quaternion.multiply(turned, truth), quaternion.inverse(turned)
        )
        return float(np.median(quaternion.angle_between_deg(expected, moved)))

    # The median has several minima: a coarse search first, then a fine one about the best.
    best = min(np.arange(-180.0, 180.0, 2.0), key=residual_deg)
    best = min(np.arange(best - 2.0, best + 2.05, 0.05), key=residual_deg)
    return Turn(float((best + 180) % 360 - 180), residual_deg(best))


def find_clock_offset(gt: Trajectory, vio: Trajectory) -> float:
    """Seconds to add to a tracker's timestamps to meet those of the ground truth.

    ARCore's are of another phone with a clock of its own. Angles of relative rotations depend
    neither on the unknown turn nor on the world.

    Raises:
        AssociationError: The tracks have too few times in common.
    """
    (gt_times, gt_angles), (vio_times, vio_angles) = _turning(gt), _turning(vio)

    def residual_deg(offset_s: float) -> float:
        times = vio_times + offset_s
        common = (times >= gt_times[0]) & (times <= gt_times[-1])
        if common.sum() < len(times) / 2:
            return np.inf
        expected = np.interp(times[common], gt_times, gt_angles)
        return float(np.median(np.abs(expected - vio_angles[common])))

    best = min(np.arange(-_MAX_OFFSET_S, _MAX_OFFSET_S, 0.1), key=residual_deg)
    best = min(np.arange(best - 0.1, best + 0.105, 0.01), key=residual_deg)
    if not np.isfinite(residual_deg(best)):
        raise AssociationError("tracker and ground truth have too few times in common")
    return float(best)


def _turning(track: Trajectory) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times, and how far the camera turns in the second that begins there, degrees."""
    times = track.timestamp_s
    times = times[times + _SPAN_S <= times[-1]]
    if len(times) < _LEAST_TIMES:
        raise AssociationError("tracker and ground truth have too few times in common")
    moved = _relative(track.interpolate(times), track.interpolate(times + _SPAN_S))
    return times, np.degrees(quaternion.angle_rad(moved))


def undo_turn(trajectory: Trajectory, angle_deg: float, *, is_tracker: bool) -> Trajectory:
    """A track as `read` gives it, with right orientations: still y up, OpenCV camera axes."""
    turn = _turn_about_z(angle_deg)
    if is_tracker:
        quats = quaternion.multiply(quaternion.inverse(turn), trajectory.quat_xyzw)
    else:
        # The turn is of the device on one side, and of a z-up world on the other.
        world_turn = quaternion.from_rotvec(np.array([0.0, -np.deg2rad(angle_deg), 0.0]))
        quats = quaternion.multiply(
            quaternion.multiply(world_turn, trajectory.quat_xyzw), quaternion.inverse(turn)
        )
    return trajectory.with_transforms(Rigid3(trajectory.position_m, quats))


def _relative(earlier: Trajectory, later: Trajectory) -> NDArray[np.float64]:
    return quaternion.multiply(quaternion.inverse(earlier.quat_xyzw), later.quat_xyzw)


def _turn_about_z(angle_deg: float) -> NDArray[np.float64]:
    return quaternion.from_rotvec(np.array([0.0, 0.0, np.deg2rad(angle_deg)]))


FORMAT = Format(
    name="advio-gt",
    title="ADVIO ground truth",
    convention=(
        f"{_COLUMNS}; position mirrored in z, y up; rotation device_from_world, z up, up to an "
        "unknown turn: distances and relative angles are right, orientations are not"
    ),
    extensions=(".csv",),
    sniff=partial(_sniff, is_tracker=False),
    read=partial(_read, is_tracker=False),
    write=partial(_write, is_tracker=False),
    has_times=True,
)

VIO_FORMAT = Format(
    name="advio-vio",
    title="ADVIO ARKit and ARCore tracks",
    convention=(
        f"{_COLUMNS}; world_from_cam, y up, OpenGL camera axes, rotations up to an unknown "
        "turn of the world; first rows of position 0,0,0 are left out"
    ),
    extensions=(".csv",),
    sniff=partial(_sniff, is_tracker=True),
    read=partial(_read, is_tracker=True),
    write=partial(_write, is_tracker=True),
    has_times=True,
)
