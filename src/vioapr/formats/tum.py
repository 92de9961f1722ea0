"""TUM RGB-D trajectories: `timestamp_s x y z qx qy qz qw`, world_from_cam."""

from __future__ import annotations

from pathlib import Path

from vioapr.files.tables import all_numbers, format_rows, head_rows, parse_numbers
from vioapr.files.text import has_suffix, read_text, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, poses_of, require_times
from vioapr.formats.times import seconds_of
from vioapr.trajectory import Trajectory

_COLUMNS = "timestamp x y z qx qy qz qw"


def sniff(path: Path, head: bytes) -> float:
    """Sure of 8 numbers a row under the name .tum; likely under any other name."""
    if not all_numbers(head_rows(head), range(8, 9)):
        return 0.0
    return 1.0 if has_suffix(path, ".tum") else 0.7


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses; timestamps are in seconds, or in a unit that their values tell.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows, values = parse_numbers(path, read_text(path), range(8, 9), what=_COLUMNS)
    poses = poses_of(rows, values[:, 1:4], values[:, 4:8])
    times = seconds_of(path, values[:, 0], options)
    return build_trajectory(rows, times, poses, options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits, so that reading gives the same doubles.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "a TUM file")
    columns = pose_columns(trajectory.target_from_source)
    times = trajectory.timestamp_s.tolist()
    rows = [(time, *row) for time, row in zip(times, columns, strict=True)]
    write_text(path, f"# {_COLUMNS}\n" + format_rows(rows, " "))


FORMAT = Format(
    name="tum",
    title="TUM RGB-D trajectory",
    convention=f"{_COLUMNS}; world_from_cam, quaternion xyzw, seconds, metres",
    extensions=(".tum", ".txt"),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    default_for=(".tum",),
)
