"""EuRoC csv: `t[ns],x,y,z,qw,qx,qy,qz,...`, world_from_body."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.files.tables import all_numbers, format_rows, head_rows, parse_rows, to_ticks
from vioapr.files.text import read_text, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, poses_of, require_times
from vioapr.formats.times import find_time_unit, seconds_of
from vioapr.trajectory import Trajectory

_COLUMNS = "timestamp_ns,x,y,z,qw,qx,qy,qz"
_WIDTHS = range(8, 65)  # velocities and biases may follow
_NANOSECONDS = 1_000_000_000
_LEAST_SNIFFED_NS = 1e12


def sniff(path: Path, head: bytes) -> float:
    """Likely of 8 or more numbers a row, the first too large for seconds."""
    del path
    rows = head_rows(head, ",")
    if not all_numbers(rows, _WIDTHS) or not all(row[0].isdecimal() for row in rows):
        return 0.0
    has_header = head.lstrip().startswith(b"#timestamp")
    is_large = all(float(row[0]) > _LEAST_SNIFFED_NS for row in rows)
    return 0.6 * is_large + 0.35 * has_header


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read poses of the IMU body (not of a camera) in the world, timed in seconds.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows = parse_rows(path, read_text(path), _WIDTHS, what=_COLUMNS, delimiter=",")
    values = rows.numbers(slice(1, 8))
    poses = poses_of(rows, values[:, :3], values[:, [4, 5, 6, 3]])
    ticks = rows.ticks(0)
    # Whole numbers are nanoseconds by the format, unless they are dates in another unit.
    is_date = find_time_unit(np.array(ticks, dtype=np.float64)).is_date
    is_whole = all(isinstance(tick, int) for tick in ticks)
    times = seconds_of(path, ticks, options, fixed="ns" if is_whole and not is_date else None)
    return build_trajectory(rows, times, poses, options, source="body")


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
