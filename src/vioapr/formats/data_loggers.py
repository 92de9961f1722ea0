"""ARKit-Data-Logger and ARCore-Data-Logger: text logs of the trackers' poses, nanoseconds.

`ARKit_camera_pose.txt` is `time r11 r12 r13 tx r21 ... tz`, the camera's pose with OpenGL axes.
`ARCore_sensor_pose.txt` is `time qx qy qz qw x y z`, the pose of Android's sensors: x to the
right and y up of the phone held upright, z to its user. So the camera looks along -z, and the
axes are OpenGL's of a picture held upright.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.tables import format_rows, to_ticks
from vioapr.files.text import plain_name, read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.kitti import read_matrices
from vioapr.formats.poses import (
    build_trajectory,
    pose_columns,
    poses_of,
    require_times,
    rigid_of_matrices,
)
from vioapr.formats.table_guess import guess_formats
from vioapr.formats.table_head import look_at_text
from vioapr.formats.table_rows import read_columns
from vioapr.formats.times import seconds_of
from vioapr.trajectory import Trajectory

_ARKIT_FILE, _ARCORE_FILE = "arkit_camera_pose.txt", "arcore_sensor_pose.txt"
_ARKIT_COLUMNS = "timestamp_ns r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz"
_ARCORE_COLUMNS = "timestamp_ns qx qy qz qw x y z"
_NANOSECONDS = 1_000_000_000


def sniff_arkit(path: Path, head: bytes) -> float:
    """Sure by the name, of a number and a matrix in each row; likely if it looks along -z."""
    guesses = guess_formats(head)
    is_named = plain_name(path).endswith(_ARKIT_FILE)
    return 1.0 if is_named and guesses.get("kitti") else guesses.get("arkit-logger", 0.0)


def sniff_arcore(path: Path, head: bytes) -> float:
    """Sure by the name, of a number, a quaternion and three more in each row."""
    confidence = guess_formats(head).get("arcore-logger", 0.0)
    return 1.0 if confidence and plain_name(path).endswith(_ARCORE_FILE) else confidence


def read_arkit(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses, timed in seconds.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows, matrices, times = read_matrices(path, options)
    if times is None:
        raise FormatError(path, f"expected 13 columns ({_ARKIT_COLUMNS}), got no time", 1)
    poses = conventions.world_from_arcam(rigid_of_matrices(rows, matrices))
    seconds = seconds_of(path, times, options, fixed="ns")
    return build_trajectory(rows, seconds, poses, options, target="vio")


def read_arcore(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses of a camera held upright, timed in seconds.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    text = read_text(path)
    head = look_at_text(text)
    if head is None or head.width < 8:
        got = "none" if head is None else f"{head.width}"
        raise FormatError(path, f"expected 8 columns ({_ARCORE_COLUMNS}), got {got}", 1)
    table = read_columns(path, head, text, range(8), _ARCORE_COLUMNS)
    poses = poses_of(table.rows, table.values[:, 5:8], table.values[:, 1:5])
    poses = conventions.world_from_arcam(poses)
    seconds = seconds_of(path, table.ticks, options, fixed="ns")
    return build_trajectory(table.rows, seconds, poses, options, target="vio")


def write_arkit(path: Path, trajectory: Trajectory) -> None:
    """Write all digits of the poses; times are rounded to whole nanoseconds.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "a file of ARKit-Data-Logger")
    poses = conventions.world_from_arcam(trajectory.target_from_source)
    entries = np.asarray(poses.to_matrix()[:, :3, :]).reshape(-1, 12).tolist()
    ticks = to_ticks(trajectory.timestamp_s, _NANOSECONDS)
    rows = [(tick, *row) for tick, row in zip(ticks, entries, strict=True)]
    write_text(path, f"# {_ARKIT_COLUMNS}\n" + format_rows(rows, " "))


def write_arcore(path: Path, trajectory: Trajectory) -> None:
    """Write all digits of the poses; times are rounded to whole nanoseconds.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "a file of ARCore-Data-Logger")
    columns = pose_columns(conventions.world_from_arcam(trajectory.target_from_source))
    ticks = to_ticks(trajectory.timestamp_s, _NANOSECONDS)
    rows = [(tick, *row[3:], *row[:3]) for tick, row in zip(ticks, columns, strict=True)]
    write_text(path, format_rows(rows, " "))


ARKIT_FORMAT = Format(
    name="arkit-logger",
    title="ARKit-Data-Logger's ARKit_camera_pose.txt",
    convention=f"{_ARKIT_COLUMNS}; world_from_cam, y up, OpenGL camera axes",
    extensions=(".txt",),
    sniff=sniff_arkit,
    read=read_arkit,
    write=write_arkit,
    has_times=True,
    default_for=(_ARKIT_FILE,),
    up="+y",
)

ARCORE_FORMAT = Format(
    name="arcore-logger",
    title="ARCore-Data-Logger's ARCore_sensor_pose.txt",
    convention=f"{_ARCORE_COLUMNS}; world_from_cam, y up, OpenGL camera axes, held upright",
    extensions=(".txt",),
    sniff=sniff_arcore,
    read=read_arcore,
    write=write_arcore,
    has_times=True,
    default_for=(_ARCORE_FILE,),
    up="+y",
)
