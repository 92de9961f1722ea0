"""Stray Scanner `odometry.csv`: `timestamp, frame, x, y, z, qx, qy, qz, qw`, ARKit.

The app multiplies ARKit's rotation by a half turn about x before it writes it, so the camera
axes are OpenCV's; the world is ARKit's, y up.
"""

from __future__ import annotations

from pathlib import Path

from vioapr.files.tables import format_rows, read_headed_csv
from vioapr.files.text import write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.headed import POSE_COLUMNS, build_timed
from vioapr.formats.poses import pose_columns, require_times
from vioapr.trajectory import Trajectory

_COLUMNS = ("timestamp", "frame", *POSE_COLUMNS)


def sniff(path: Path, head: bytes) -> float:
    """Sure by the header line."""
    del path
    first = head[:4096].decode("utf-8", "replace").split("\n")[0]
    columns = tuple(field.strip() for field in first.split(","))
    return 1.0 if columns[: len(_COLUMNS)] == _COLUMNS else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses, timed in seconds; further columns are passed over.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows = read_headed_csv(path, ("timestamp", *POSE_COLUMNS))
    return build_timed(rows, options, conventions.world_from_cam, pose=slice(1, 8))


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits; frames are numbered by row.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "a Stray Scanner file")
    columns = pose_columns(trajectory.target_from_source)
    times = trajectory.timestamp_s.tolist()
    rows = [
        (time, f"{number:06d}", *row)
        for number, (time, row) in enumerate(zip(times, columns, strict=True))
    ]
    write_text(path, ", ".join(_COLUMNS) + "\n" + format_rows(rows, ", "))


FORMAT = Format(
    name="stray",
    title="Stray Scanner odometry",
    convention=(
        "timestamp, frame, x, y, z, qx, qy, qz, qw; world_from_cam, ARKit's y-up world, "
        "OpenCV camera axes, quaternion xyzw, seconds, metres"
    ),
    extensions=(".csv",),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    default_for=("odometry.csv",),
    up="+y",
)
