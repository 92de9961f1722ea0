"""KITTI odometry poses: 12 numbers a row, a 3x4 matrix row by row, world_from_cam, no time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows, format_rows
from vioapr.files.text import has_suffix, read_text, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, index_times, rigid_of_matrices
from vioapr.formats.table_guess import (
    TRANSPOSED,
    MatrixColumns,
    find_matrix,
    guess_formats,
    is_index,
)
from vioapr.formats.table_head import look_at_text
from vioapr.formats.table_rows import read_columns
from vioapr.formats.times import seconds_of
from vioapr.trajectory import Trajectory

_COLUMNS = "r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz"


def sniff(path: Path, head: bytes) -> float:
    """Likely of 12 or 16 numbers a row that hold a rotation, alone or after one more."""
    confidence = guess_formats(head).get("kitti", 0.0)
    return 1.0 if confidence and has_suffix(path, ".kitti") else confidence


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses; untimed unless the first column or a rate gives times.

    A number before the matrix is the frame's number where it counts (0, 1, 2, 4), as visual
    odometries write it, and else its time. Matrices of 4x4, or written column by column
    (the translation last), are read, too.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows, matrices, leading = read_matrices(path, options)
    poses = rigid_of_matrices(rows, matrices)
    if leading is None:
        times, is_timed = index_times(len(rows), options), options.rate_hz is not None
    else:
        times, is_timed = times_of_leading(path, leading, options)
    return build_trajectory(rows, times, poses, options, is_timed=is_timed)


def read_matrices(
    path: Path, options: ReadOptions
) -> tuple[Rows, NDArray[np.float64], list[int | float] | None]:
    """Read rows of a matrix each, and what is before it.

    Returns:
        The rows; matrices of shape (n, 3, 4); the number in front of each, or None.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    text = read_text(path)
    head = look_at_text(text)
    if head is None or head.width not in (12, 13, 16, 17):
        got = "none" if head is None else f"{head.width}"
        line = None if head is None else head.header_lines + 1
        raise FormatError(path, f"expected 12, 13, 16 or 17 columns ({_COLUMNS}), got {got}", line)
    table = read_columns(path, head, text, range(head.width), _COLUMNS)
    found = find_matrix(table.values)
    if found is None and head.width > 13:
        line = table.rows.lines[0]
        raise FormatError(path, "expected a rotation matrix and 0 0 0 1 in every row", line)
    found = found or MatrixColumns(head.width - 12, tuple(range(12)), is_transposed=False)
    if found.is_transposed:
        options.note(path, TRANSPOSED, is_warning=False)
    entries = table.values[:, found.first :][:, list(found.columns)]
    return table.rows, entries.reshape(-1, 3, 4), table.ticks if found.first else None


def times_of_leading(
    path: Path, leading: list[int | float], options: ReadOptions
) -> tuple[NDArray[np.float64], bool]:
    """Times of the numbers before matrices, and whether they are seconds of a clock."""
    numbers = np.array(leading, dtype=np.float64)
    if options.time_unit is not None or not is_index(numbers):
        return seconds_of(path, leading, options), True
    if options.rate_hz is None:
        return np.arange(len(numbers), dtype=np.float64), False
    return numbers / options.rate_hz, True


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits; times and names are lost.

    Raises:
        UnwritableError: The file cannot be written.
    """
    matrices = trajectory.target_from_source.to_matrix()[:, :3, :]
    write_text(path, format_rows(matrices.reshape(-1, 12).tolist(), " "))


FORMAT = Format(
    name="kitti",
    title="KITTI odometry poses",
    convention=f"{_COLUMNS}; world_from_cam, OpenCV axes, metres, no times",
    extensions=(".txt", ".kitti"),
    sniff=sniff,
    read=read,
    write=write,
    default_for=(".kitti",),
)
