"""LaMAR's ScanCapture `poses.txt`: ARKit poses with tracking status and intrinsics."""

from __future__ import annotations

from pathlib import Path

from vioapr.files.tables import all_numbers, format_rows, head_rows, is_number, parse_rows, to_ticks
from vioapr.files.text import plain_name, read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.headed import build_timed
from vioapr.formats.poses import pose_columns, require_times
from vioapr.formats.tracking_states import mark_lost_rows
from vioapr.trajectory import Trajectory

_COLUMNS = "timestamp_us,status,tx,ty,tz,qx,qy,qz,qw,w,h,fx,fy,cx,cy"
_MICROSECONDS = 1_000_000


def sniff(path: Path, head: bytes) -> float:
    """Likely of 15 columns, all numbers but the second."""
    rows = head_rows(head, ",")
    numbers = [row[:1] + row[2:] for row in rows if len(row) == 15 and not is_number(row[1])]
    if len(numbers) != len(rows) or not all_numbers(numbers, range(14, 15)):
        return 0.0
    return 1.0 if plain_name(path) == "poses.txt" else 0.8


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses of the rows whose status is not one of a lost tracker.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows = parse_rows(path, read_text(path), range(15, 16), what=_COLUMNS, delimiter=",")
    mark_lost_rows(path, rows, "status", rows.column(1), options)
    return build_timed(
        rows,
        options,
        conventions.world_from_arcam,
        pose=slice(2, 9),
        per_second=_MICROSECONDS,
    )


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits of the poses; times are rounded to microseconds, intrinsics are 0.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "a ScanCapture file")
    ticks = to_ticks(trajectory.timestamp_s, _MICROSECONDS)
    columns = pose_columns(conventions.world_from_arcam(trajectory.target_from_source))
    rows = [(t, "normal", *row, *[0] * 6) for t, row in zip(ticks, columns, strict=True)]
    write_text(path, f"# {_COLUMNS}\n" + format_rows(rows, ","))


FORMAT = Format(
    name="scancapture",
    title="LaMAR ScanCapture poses",
    convention=(
        f"{_COLUMNS}; world_from_cam, ARKit's y-up world, OpenGL camera axes, quaternion xyzw"
    ),
    extensions=(".txt",),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    up="+y",
)
