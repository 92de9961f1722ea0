"""Phone and headset recordings as comma-separated tables of timed poses with one clock column.

Stray Scanner, Aria and LaMAR's ScanCapture differ in names, units and axes of their columns
only; each has its module, and shares what is here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vioapr.files.tables import Rows
from vioapr.formats.base import ReadOptions
from vioapr.formats.poses import build_trajectory, poses_of
from vioapr.formats.times import UNIT_OF, seconds_of
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory

POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")


def build_timed(
    rows: Rows,
    options: ReadOptions,
    convert: Callable[[Rigid3], Rigid3],
    *,
    pose: slice | Sequence[int],
    per_second: int = 1,
    target: str = "vio",
    source: str = "cam",
) -> Trajectory:
    """A trajectory of rows whose first column is a time.

    Args:
        rows: Fields, the first a time.
        options: Whether to be strict, the unit of times, and where notes go.
        convert: From the file's convention to ours, of `vioapr.formats.conventions`.
        pose: Columns of x, y, z, qx, qy, qz, qw.
        per_second: Ticks of the clock in a second: 1, a thousand, a million or a billion.
        target: Name of the target frame.
        source: Name of the source frame.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    values = rows.numbers(pose)
    poses = convert(poses_of(rows, values[:, :3], values[:, 3:7]))
    times = seconds_of(rows.path, rows.ticks(0), options, fixed=UNIT_OF[per_second])
    return build_trajectory(rows, times, poses, options, target=target, source=source)
