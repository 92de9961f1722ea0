"""ARKitScenes `.traj`: `timestamp rx ry rz tx ty tz`, cam_from_world with an axis-angle rotation.

Angles are in radians, the axes of the camera OpenCV's, the world is z up. Stated by Apple:
apple/ARKitScenes, threedod/benchmark_scripts/utils/tenFpsDataLoader.py, whose `TrajStringToMatrix`
inverts the matrix to camera-to-world, and whose `generate_point` applies it to OpenCV rays.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.files.tables import all_numbers, format_rows, head_rows, parse_rows
from vioapr.files.text import has_suffix, read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, poses_of, quaternions_of_rotvecs, require_times
from vioapr.formats.times import seconds_of
from vioapr.geometry import quaternion
from vioapr.trajectory import Trajectory

_COLUMNS = "timestamp rx ry rz tx ty tz"


def sniff(path: Path, head: bytes) -> float:
    """Sure of 7 numbers a row under the name .traj; other files of 7 numbers mean other things."""
    return 0.95 if has_suffix(path, ".traj") and all_numbers(head_rows(head), range(7, 8)) else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses, timed in seconds.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows = parse_rows(path, read_text(path), range(7, 8), what=_COLUMNS)
    values = rows.numbers(slice(0, 7))
    poses = poses_of(rows, values[:, 4:7], quaternions_of_rotvecs(values[:, 1:4]))
    times = seconds_of(path, values[:, 0], options, fixed="s")
    return build_trajectory(rows, times, conventions.cam_from_world(poses), options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "an ARKitScenes file")
    poses = conventions.cam_from_world(trajectory.target_from_source)
    columns = [trajectory.timestamp_s, quaternion.to_rotvec(poses.quat_xyzw), poses.translation_m]
    write_text(path, format_rows(np.column_stack(columns).tolist(), " "))


FORMAT = Format(
    name="arkitscenes",
    title="ARKitScenes .traj",
    convention=(
        f"{_COLUMNS}; cam_from_world (t is not the camera's position), axis-angle in radians, "
        "OpenCV axes, z-up world, seconds, metres"
    ),
    extensions=(".traj",),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    default_for=(".traj",),
    up="+z",
)
