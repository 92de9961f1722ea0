"""KITTI odometry poses: 12 numbers a row, a 3x4 matrix row by row, world_from_cam, no time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.tables import all_numbers, format_rows, head_rows, parse_rows
from vioapr.files.text import has_suffix, read_text, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, index_times, rigid_of_matrices
from vioapr.trajectory import Trajectory

_COLUMNS = "r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz"


def sniff(path: Path, head: bytes) -> float:
    """Likely of 12 numbers a row; 13, a frame number first, are less usual."""
    rows = head_rows(head)
    if all_numbers(rows, range(12, 13)):
        return 1.0 if has_suffix(path, ".kitti") else 0.8
    return 0.6 if all_numbers(rows, range(13, 14)) else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses; untimed unless a rate is given.

    A 13th number in front, as visual odometries write it, is the frame's number.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    rows = parse_rows(path, read_text(path), range(12, 14), what=_COLUMNS)
    width = len(rows.fields[0])
    for fields, line in zip(rows.fields, rows.lines, strict=True):
        if len(fields) != width:
            raise FormatError(path, f"expected {width} columns as above, got {len(fields)}", line)
    poses = rigid_of_matrices(rows, rows.numbers(slice(-12, None)).reshape(-1, 3, 4))
    times = index_times(len(rows), options)
    if width == 13 and options.rate_hz is not None:
        numbers = rows.numbers([0])[:, 0]
        is_whole = (np.abs(numbers) < 1e15) & (numbers == np.trunc(numbers))
        if not is_whole.all():
            line = rows.lines[int(np.argmin(is_whole))]
            raise FormatError(path, "expected a whole frame number in the first of 13", line)
        times = numbers / options.rate_hz
    return build_trajectory(rows, times, poses, options, is_timed=options.rate_hz is not None)


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
