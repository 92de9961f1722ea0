"""Open3D's and Redwood's `.log`, and Open3D's camera trajectories as JSON.

A `.log` has for each pose a line of three numbers and a 4x4 matrix, world_from_cam with OpenCV
axes; the three numbers are of Redwood's format, the third the frame's. The JSON lists
`parameters` with `extrinsic`, cam_from_world column by column. Stated by the source,
isl-org/Open3D: cpp/open3d/io/file_format/FileLOG.cpp (the extrinsic matrix is the inverse of what
the file has), camera/PinholeCameraParameters.cpp and utility/IJsonConvertible.cpp.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows, all_numbers, format_rows, head_rows, is_number
from vioapr.files.text import read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, index_times, rigid_of_file
from vioapr.schemas.foreign_json import as_numbers, get_list, load_object
from vioapr.trajectory import Trajectory

_LINES = 5
_CLASS = b'"PinholeCameraTrajectory"'
_WHAT = "three whole numbers and four rows of a 4x4 matrix for each pose"


def sniff(path: Path, head: bytes) -> float:
    """Sure of three whole numbers and a 4x4 matrix below, or of JSON that names its class."""
    del path
    if head.lstrip()[:1] == b"{":
        return 0.95 if _CLASS in head else 0.0
    rows = head_rows(head)[:_LINES]
    is_pose = len(rows) == _LINES and len(rows[0]) == 3 and all(map(_is_whole, rows[0]))
    return 0.95 if is_pose and all_numbers(rows[1:], range(4, 5)) else 0.0


def _is_whole(field: str) -> bool:
    return field.lstrip("+-").isdecimal() and len(field) < 16


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses; untimed unless a rate is given.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    text = read_text(path)
    if text.lstrip()[:1] == "{":
        return _read_json(path, text, options)
    numbers: list[list[float]] = []
    starts: list[int] = []
    frames: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        is_first = len(numbers) % _LINES == 0
        if is_first and not (len(fields) == 3 and all(map(_is_whole, fields))):
            raise FormatError(path, f"expected {_WHAT}, got {line.strip()[:60]!r}", number)
        if not is_first and not (len(fields) == 4 and all(map(is_number, fields))):
            problem = f"expected a row of a 4x4 matrix, got {line.strip()[:60]!r}"
            raise FormatError(path, problem, number)
        if is_first:
            starts.append(number)
            frames.append(int(fields[2]))
        numbers.append([0.0] * 4 if is_first else [float(field) for field in fields])
    if not numbers or len(numbers) % _LINES:
        found = "none" if not numbers else "a pose cut off"
        raise FormatError(path, f"expected {_WHAT}, got {found}", starts[-1] if starts else None)
    matrices = np.array(numbers).reshape(-1, _LINES, 4)[:, 1:]
    rows = Rows(path, [[]] * len(starts), starts)
    times = index_times(len(rows), options)
    if options.rate_hz is not None and (np.diff(frames) > 0).all():
        times = (np.array(frames) - frames[0]) / options.rate_hz
    poses = rigid_of_file(rows, matrices, options)
    return build_trajectory(rows, times, poses, options, is_timed=options.rate_hz is not None)


def _read_json(path: Path, text: str, options: ReadOptions) -> Trajectory:
    """Poses of the parameters of a PinholeCameraTrajectory, in their order."""
    matrices: list[NDArray[np.float64]] = []
    for entry, value in enumerate(get_list(path, load_object(path, text), "parameters"), start=1):
        fields = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        columns = as_numbers(path, fields.get("extrinsic"), (16,), '"extrinsic"', entry)
        matrices.append(columns.reshape(4, 4).T)
    rows = Rows.numbered(path, len(matrices))
    poses = conventions.cam_from_world(rigid_of_file(rows, np.array(matrices), options))
    times, is_timed = index_times(len(rows), options), options.rate_hz is not None
    return build_trajectory(rows, times, poses, options, is_timed=is_timed)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits; times and names are lost.

    Raises:
        UnwritableError: The file cannot be written.
    """
    matrices = trajectory.target_from_source.to_matrix().tolist()
    rows = [row for k, matrix in enumerate(matrices) for row in ((k, k, k + 1), *matrix)]
    write_text(path, format_rows(rows, " "))


FORMAT = Format(
    name="open3d",
    title="Open3D or Redwood .log, Open3D trajectory JSON",
    convention=(
        "three numbers and a 4x4 matrix a pose, world_from_cam; in JSON extrinsic by columns, "
        "cam_from_world; OpenCV axes, no times"
    ),
    extensions=(".log",),
    sniff=sniff,
    read=read,
    write=write,
    default_for=(".log",),
)
