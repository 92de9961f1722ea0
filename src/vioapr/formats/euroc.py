"""EuRoC csv: `t[ns],x,y,z,qw,qx,qy,qz,...`, world_from_body."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.files.tables import format_rows, to_ticks
from vioapr.files.text import write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, require_times
from vioapr.formats.table_guess import guess_formats
from vioapr.formats.table_rows import read_ordered
from vioapr.formats.times import find_time_unit, seconds_of
from vioapr.trajectory import Trajectory

_COLUMNS = "timestamp_ns,x,y,z,qw,qx,qy,qz"
_NANOSECONDS = 1_000_000_000


def sniff(path: Path, head: bytes) -> float:
    """Sure of a comment that names the columns; likely of such numbers in nanoseconds."""
    del path
    return guess_formats(head).get("euroc", 0.0)


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read poses of the IMU body (not of a camera) in the world, timed in seconds.

    Columns after the quaternion, as of velocities and biases, are passed over.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    columns, poses = read_ordered(path, options, _COLUMNS, "wxyz")
    # Whole numbers are nanoseconds by the format, unless they are dates in another unit.
    is_date = find_time_unit(np.array(columns.ticks, dtype=np.float64)).is_date
    is_whole = all(isinstance(tick, int) for tick in columns.ticks)
    fixed = columns.time_unit or ("ns" if is_whole and not is_date else None)
    times = seconds_of(path, columns.ticks, options, fixed)
    return build_trajectory(columns.rows, times, poses, options, source="body")


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits of the poses; times are rounded to whole nanoseconds.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "a EuRoC file")
    columns = pose_columns(trajectory.target_from_source, (3, 0, 1, 2))
    ticks = to_ticks(trajectory.timestamp_s, _NANOSECONDS)
    rows = [(tick, *row) for tick, row in zip(ticks, columns, strict=True)]
    write_text(path, f"#{_COLUMNS}\n" + format_rows(rows, ","))


FORMAT = Format(
    name="euroc",
    title="EuRoC csv",
    convention=f"{_COLUMNS}; world_from_body (the IMU), quaternion wxyz, nanoseconds, metres",
    extensions=(".csv",),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    default_for=(".csv",),
)
