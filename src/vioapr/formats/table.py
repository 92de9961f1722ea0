"""Tables whose header names their columns, with any delimiter: the logs that people have.

Rotations are quaternions or matrices: `r11` to `r33` beside a position, or a whole 3x4 or 4x4.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError
from vioapr.files.tables import Rows, format_rows, is_number
from vioapr.files.text import read_text, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.columns import Layout, names_euler_angles
from vioapr.formats.named import build_named, writable_names
from vioapr.formats.poses import (
    build_trajectory,
    index_times,
    pose_columns,
    poses_of,
    rigid_of_matrices,
)
from vioapr.formats.table_guess import TRANSPOSED, find_matrix, find_quaternion_order, guess_formats
from vioapr.formats.table_head import look_at_text
from vioapr.formats.table_rows import read_columns, say_passed_over
from vioapr.formats.times import seconds_of
from vioapr.formats.tracking_states import mark_lost_rows
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory


def sniff(path: Path, head: bytes) -> float:
    """Sure of a header that names position and quaternion, or a matrix."""
    del path
    if b"device_id" in head[:1024]:
        return 0.0  # kapture's or LaMAR's, whose poses are each other's inverse
    return guess_formats(head).get("table", 0.0)


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read poses of the columns that a header names, timed or named where it has such columns.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line, or its header does
            not name a position and a rotation.
        ParameterError: The options do not fit the file's sequences.
    """
    text = read_text(path)
    head = look_at_text(text)
    if head is None or head.names is None:
        raise FormatError(path, "expected a header that names the columns of poses, found none")
    layout = head.layout
    if layout is None:
        raise FormatError(path, _why_no_layout(head.names), max(head.header_lines, 1))
    is_timed = layout.time is not None
    leading = [i for i in (layout.time,) if i is not None]
    leading += [i for i in (layout.nanoseconds,) if i is not None]
    full = next((row for row in head.rows if len(row) >= len(head.names)), ())
    image = next((i for i in layout.images if full and not is_number(full[i])), None)
    what = ",".join(head.names)
    texts = [i for i in (image, layout.tracking) if i is not None]
    columns = read_columns(path, head, text, [*leading, *layout.pose], what, texts)
    names = columns.texts[0] if image is not None else None
    values = columns.values[:, len(leading) :]
    poses = _poses_of(path, columns.rows, values, layout, options)
    _say_columns(path, options, layout)
    _check_numbered(path, head.names, layout, values, options)
    if layout.tracking is not None:
        name = head.names[layout.tracking]
        mark_lost_rows(path, columns.rows, name, columns.texts[-1], options)
    if not is_timed and names is not None:
        return build_named(columns.rows, names, poses, options)
    if layout.time is not None:
        ticks: list[int | float] = columns.ticks
        fixed = layout.time_unit
        if layout.nanoseconds is not None:
            ticks = [a + b / 1e9 for a, b in zip(ticks, columns.values[:, 1].tolist(), strict=True)]
            fixed = "s"
        times = seconds_of(path, ticks, options, fixed)
    else:
        times = index_times(len(columns.rows), options)
    is_timed = is_timed or options.rate_hz is not None
    return build_trajectory(columns.rows, times, poses, options, names=names, is_timed=is_timed)


def _poses_of(
    path: Path, rows: Rows, values: NDArray[np.float64], layout: Layout, options: ReadOptions
) -> Rigid3:
    """Poses of the columns of a position, and of a quaternion or a matrix."""
    if not layout.matrix:
        return poses_of(rows, values[:, :3] * layout.metres, values[:, 3:])
    found = find_matrix(values)
    if found is None:
        raise FormatError(path, "expected a rotation matrix in every row", rows.lines[0])
    if found.is_transposed:
        options.note(path, TRANSPOSED, is_warning=False)
    matrices = values[:, list(found.columns)].reshape(-1, 3, 4)
    return rigid_of_matrices(rows, matrices * [1.0, 1.0, 1.0, layout.metres])


def _check_numbered(
    path: Path,
    names: Sequence[str],
    layout: Layout,
    values: NDArray[np.float64],
    options: ReadOptions,
) -> None:
    """See whether the motion agrees that q0 of q0 to q3 is w, as textbooks have it.

    Libraries that store x first number their components as well.
    """
    if layout.matrix or not names[layout.quat_xyzw[3]].rstrip("])} ").endswith("0"):
        return
    first, second = names[layout.quat_xyzw[3]], names[layout.quat_xyzw[0]]
    as_written = values[:, 3:][:, [3, 0, 1, 2]]
    order, _ = find_quaternion_order(values[:, :3], as_written)
    if order == "xyzw":
        problem = f"expected {first} to be w, but by the motion it is x"
        raise FormatError(path, f"{problem}: name the columns qx, qy, qz, qw")
    if order is None:
        text = f"{first} is taken for w and {second} for x: if they are not, name them qx, qy, ..."
        options.note(path, text, is_warning=True)


def _why_no_layout(names: Sequence[str]) -> str:
    named = ", ".join(name for name in names if name)
    if names_euler_angles(names):
        return (
            f"expected a quaternion, got angles ({named}): Euler angles have many conventions "
            "and are not read: write qx, qy, qz, qw instead"
        )
    return f"expected a header that names x, y, z, qx, qy, qz and qw, got {named[:200]}"


def _say_columns(path: Path, options: ReadOptions, layout: Layout) -> None:
    for rival in layout.rivals:
        options.note(path, rival, is_warning=True)
    if layout.time_rival is not None:
        options.note(path, layout.time_rival, is_warning=False)
    if layout.metres != 1:
        options.note(path, f"positions are in units of {layout.metres:g} m", is_warning=False)
    say_passed_over(path, options, len(layout.passed_over), layout.passed_over)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits, with an image column where the trajectory has names.

    Raises:
        ParameterError: The trajectory has neither timestamps nor names, or a name that the
            format cannot hold.
        UnwritableError: The file cannot be written.
    """
    names = None if trajectory.names is None else writable_names(trajectory, ",")
    if not trajectory.is_timed and names is None:
        raise ParameterError(
            "a table needs timestamps or image names, and the trajectory has none: give the rate "
            "of its frames (`rate_hz`)"
        )
    header = ["x", "y", "z", "qx", "qy", "qz", "qw"]
    rows: list[list[object]] = [list(row) for row in pose_columns(trajectory.target_from_source)]
    if names is not None:
        header = ["image", *header]
        rows = [[name, *row] for name, row in zip(names, rows, strict=True)]
    if trajectory.is_timed:
        header = ["timestamp_s", *header]
        times = trajectory.timestamp_s.tolist()
        rows = [[time, *row] for time, row in zip(times, rows, strict=True)]
    write_text(path, ",".join(header) + "\n" + format_rows(rows, ","))


FORMAT = Format(
    name="table",
    title="Table with named columns",
    convention=(
        "a header that names time or image, and position and quaternion or a matrix, with any "
        "delimiter; taken for world_from_cam, OpenCV axes, metres; unit of time as named or found"
    ),
    extensions=(".csv", ".txt", ".tsv"),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    has_names=True,
)
