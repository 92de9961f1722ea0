"""TUM RGB-D trajectories: `timestamp_s x y z qx qy qz qw`, world_from_cam."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.formats.base import (
    Format,
    ReadOptions,
    build_trajectory,
    parse_rows,
    read_text,
    write_text,
)
from vioapr.trajectory import Trajectory

_COLUMNS = "timestamp x y z qx qy qz qw"


def sniff(path: Path, head: bytes) -> float:
    """Sure of 8 numbers a row under the name .tum; likely under any other name."""
    rows = [line.split() for line in head.decode("utf-8", "replace").splitlines()[:20]]
    rows = [row for row in rows if row and not row[0].startswith("#")]
    try:
        looks_right = bool(rows) and all([float(f) for f in row] and len(row) == 8 for row in rows)
    except ValueError:
        return 0.0
    if not looks_right:
        return 0.0
    return 1.0 if ".tum" in path.suffixes else 0.7


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses; timestamps are in seconds.

    Raises:
        FormatError: Naming file and line.
    """
    del options  # a TUM file says everything of itself
    rows = parse_rows(path, read_text(path), range(8, 9), what=_COLUMNS)
    values = rows.numbers(slice(0, 8))
    return build_trajectory(rows, values[:, 0], values[:, 1:4], values[:, 4:8])


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits, so that reading gives the same doubles."""
    values = np.column_stack(
        [trajectory.timestamps_s, trajectory.positions_m, trajectory.quats_xyzw]
    )
    lines = [" ".join(repr(float(value)) for value in row) for row in values]
    write_text(path, f"# {_COLUMNS}\n" + "\n".join(lines) + "\n")


FORMAT = Format(
    name="tum",
    title="TUM RGB-D trajectory",
    convention=f"{_COLUMNS}; world_from_cam, quaternion xyzw, seconds, metres",
    extensions=(".tum", ".txt"),
    sniff=sniff,
    read=read,
    write=write,
)
