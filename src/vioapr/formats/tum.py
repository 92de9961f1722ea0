"""TUM RGB-D trajectories: `timestamp_s x y z qx qy qz qw`, world_from_cam."""

from __future__ import annotations

from pathlib import Path

from vioapr.files.tables import format_rows
from vioapr.files.text import has_suffix, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, require_times
from vioapr.formats.table_guess import guess_formats
from vioapr.formats.table_rows import read_ordered
from vioapr.formats.times import seconds_of
from vioapr.trajectory import Trajectory

_COLUMNS = "timestamp x y z qx qy qz qw"
_WRITTEN_COLUMNS = _COLUMNS.replace("timestamp", "timestamp[s]")


def sniff(path: Path, head: bytes) -> float:
    """Sure of a comment that names the columns; likely of such numbers, surest as .tum."""
    confidence = guess_formats(head).get("tum", 0.0)
    return 1.0 if confidence and has_suffix(path, ".tum") else confidence


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses; commas, semicolons and tabs divide fields as spaces do.

    Timestamps are in seconds, or in a unit that a comment or their values tell. Columns after the
    quaternion, as of covariances, are passed over.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    columns, poses = read_ordered(path, options, _COLUMNS, "xyzw")
    times = seconds_of(path, columns.ticks, options, columns.time_unit)
    return build_trajectory(columns.rows, times, poses, options)


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
    write_text(path, f"# {_WRITTEN_COLUMNS}\n" + format_rows(rows, " "))


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
