"""Which formats a text table may have: by a header that names its columns, or by its rows.

The columns of TUM, EuRoC and ADVIO differ in the order of the quaternion, which no row tells.
The motion does on longer walks: seen from the camera, people walk in a steady direction, and in
the wrong order it wanders (`vioapr.formats.anomalies`).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vioapr.formats.anomalies import motion_directions
from vioapr.formats.columns import names_degrees, names_euler_angles
from vioapr.formats.poses import MATRIX_TOLERANCE
from vioapr.formats.table_head import TableHead, look_at
from vioapr.formats.times import find_time_unit
from vioapr.geometry import quaternion
from vioapr.trajectory import UNIT_TOLERANCE

TRANSPOSED = "matrices are written column by column, the translation last: transposed"
"""What a reader notes of such matrices."""

NEEDED_COLUMNS = "a position and a quaternion (x, y, z, qx, qy, qz, qw)"
"""What the header of a table names, for messages."""

_UNNAMED_MOST = 0.5
"""How sure rows can be at most whose header says something, and nobody knows what."""

_STEADY, _CLEARLY_LESS = 0.85, 0.15
_MOSTLY = 0.9
_FORWARD = 0.75
_MAX_INDEX, _MAX_INDEX_STEP = 1e7, 10.0


@dataclass(frozen=True)
class MatrixColumns:
    """Where a row has its matrix.

    Attributes:
        first: Its first column; what is before is a number or time of the frame.
        columns: The 12 columns of r11 r12 r13 tx r21 ... tz, counted from `first`.
        is_transposed: Whether the matrix is written column by column.
    """

    first: int
    columns: tuple[int, ...]
    is_transposed: bool


_ROW_MAJOR = tuple(range(12))
_AFTER_TIME = tuple(range(1, 13))
_COLUMN_MAJOR_4X4 = (0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14)
_COLUMN_MAJOR_3X4 = (0, 3, 6, 9, 1, 4, 7, 10, 2, 5, 8, 11)


@functools.lru_cache(maxsize=8)
def guess_formats(head: bytes) -> dict[str, float]:
    """Guess which formats a table of poses may have.

    Args:
        head: The first bytes of the file.

    Returns:
        By name of a format, how sure one can be, 0 to 1.
    """
    table = look_at(head)
    if table is None:
        return {}
    return _guess_named(table) if table.names is not None else _guess_numbers(table)


def explain_table(head: bytes) -> tuple[str, str] | None:
    """Say what keeps a text table from being poses.

    Args:
        head: The first bytes of a file that is of no known format.

    Returns:
        The name of the nearest format and why it is not that, after "but"; None for no table.
    """
    table = look_at(head)
    if table is None or table.width < 3:
        return None
    if table.names is not None and not table.is_comment:
        if not np.isfinite(table.numbers()).any():
            return None
        named = ", ".join(name for name in table.names if name)[:200]
        if table.layout is not None and table.layout.matrix:
            return "table", f"the columns that its header names hold no rotation matrix: {named}"
        return "table", f"its header does not name {NEEDED_COLUMNS}: {named}"
    values = table.numbers()
    if not np.isfinite(values).any(axis=0).all():
        return None
    width = table.width
    if width < 8:
        return "tum", f"its rows have {width} columns where 8 (time, position, quaternion) belong"
    if width < 12 or not np.isfinite(values[:, :8]).any():
        return "tum", "columns 5 to 8 of its rows hold no unit quaternion"
    return "kitti", f"its rows of {width} columns hold neither a quaternion nor a rotation matrix"


def unknown_header(head: bytes) -> str | None:
    """The names in a table's header, if they are not those of a pose.

    Args:
        head: The first bytes of the file.
    """
    table = look_at(head)
    if table is None or table.names is None or table.layout is not None:
        return None
    return ", ".join(name for name in table.names if name)[:200]


def is_in_degrees(head: bytes) -> bool:
    """Whether a table's header names latitudes and longitudes instead of a position.

    Args:
        head: The first bytes of the file.
    """
    table = look_at(head)
    return table is not None and table.layout is None and names_degrees(table.names or ())


def _guess_named(table: TableHead) -> dict[str, float]:
    """A table whose header, or a comment above its rows, names the columns."""
    layout, names = table.layout, table.names or ()
    if layout is None:
        if names_euler_angles(names):
            return {"table": 0.6}
        if names_degrees(names):
            return {}
        guesses = _guess_numbers(table)
        return {name: min(share, _UNNAMED_MOST) for name, share in guesses.items()}
    if not all(i < table.width for i in layout.pose):
        return {}
    if layout.matrix:
        values = table.numbers()
        matrix = find_matrix(values[:, list(layout.entries)])
        if matrix is None:
            return {}
        if table.is_comment and layout.time_unit == "ns" and layout.entries == _AFTER_TIME:
            return _guess_matrix_rows(table, values, replace(matrix, first=1))
        return {"table": 0.9}
    if table.is_comment and layout.is_in_order("xyzw"):
        return {"tum": 0.95}
    if table.is_comment and table.delimiter == "," and layout.is_in_order("wxyz"):
        unit = layout.time_unit or find_time_unit(table.numbers()[:, 0]).unit
        return {"euroc": 0.95} if unit == "ns" else {"table": 0.9}
    return {"table": 0.9}


def _guess_numbers(table: TableHead) -> dict[str, float]:
    width = _width_of(table)
    if any(len(row) != table.width for row in table.rows):
        return {}
    values = table.numbers()[:, :width]
    is_number_column = np.asarray(np.isfinite(values).any(axis=0))
    if width < 8 or not is_number_column[:8].all():
        return {}
    if width in (12, 13, 16, 17) and is_number_column.all():
        if (matrix := find_matrix(values)) is not None:
            return _guess_matrix_rows(table, values, matrix)
        if width == 12 and not _holds_unit(values[:, 4:8]):
            return {"kitti": 0.6}
    if _holds_unit(values[:, 4:8]):
        return _guess_pose_rows(table, values)
    if _holds_unit(values[:, 1:5]):
        return {"arcore-logger": 0.5}
    # Nothing is a quaternion: rows as wide as TUM's are read as such, and say so.
    return {"tum": 0.6} if width == 8 and table.delimiter is None else {}


def _guess_matrix_rows(
    table: TableHead, values: NDArray[np.float64], matrix: MatrixColumns
) -> dict[str, float]:
    """Rows of a matrix, which may be ARKit-Data-Logger's: its camera looks along -z."""
    if matrix.first == 0:
        return {"kitti": 0.9}
    times = values[:, 0][np.isfinite(values[:, 0])]
    is_ns = np.array_equal(times, np.trunc(times)) and find_time_unit(times).unit == "ns"
    if values.shape[1] != 13 or matrix.is_transposed or table.delimiter is not None or not is_ns:
        return {"kitti": 0.8}
    forward = _forward_of_matrices(values[:, 1:])
    if abs(forward) < _FORWARD:
        return {"kitti": 0.5, "arkit-logger": 0.5}
    return {"kitti": 0.8} if forward > 0 else {"arkit-logger": 0.7, "kitti": 0.3}


def _forward_of_matrices(entries: NDArray[np.float64]) -> float:
    """The mean cosine between motion and the camera's z axis; 0 if the motion does not tell."""
    matrices = entries[np.isfinite(entries).all(axis=1)].reshape(-1, 3, 4)
    matrices = matrices[np.abs(matrices).max(axis=(1, 2)) < 1e9]
    directions = motion_directions(matrices[:, :, 3]) if len(matrices) else None
    if directions is None:
        return 0.0
    looks = matrices[: len(directions), :, 2]
    cosines = np.asarray((directions * looks).sum(axis=1))
    return float(np.nanmean(cosines))


def _width_of(table: TableHead) -> int:
    """Columns without those at the end that are empty, as after a last delimiter."""
    width = table.width
    while width > 8 and all(not row[width - 1] for row in table.rows if len(row) >= width):
        width -= 1
    return width


def _guess_pose_rows(table: TableHead, values: NDArray[np.float64]) -> dict[str, float]:
    """Rows of time, position and quaternion, of one order or the other."""
    has_commas = table.delimiter in (",", ";")
    order, forward = find_quaternion_order(values[:, 1:4], values[:, 4:8])
    times = values[:, 0]
    finite = times[np.isfinite(times)]
    is_whole = np.array_equal(finite, np.trunc(finite))
    is_ns = is_whole and has_commas and find_time_unit(times).unit == "ns"
    if order == "xyzw":
        return {"tum": 0.85, "euroc": 0.2}
    if order == "wxyz":
        if is_ns:
            return {"euroc": 0.85, "tum": 0.2}
        if not has_commas or abs(forward) < _FORWARD:
            return {"euroc": 0.5, "tum": 0.4, **({"advio-vio": 0.45} if has_commas else {})}
        best, other = ("euroc", "advio-vio") if forward > 0 else ("advio-vio", "euroc")
        return {best: 0.7, other: 0.3, "advio-gt": 0.2, "tum": 0.2}
    if not has_commas:
        return {"tum": 0.7 if values.shape[1] == 8 else 0.65}
    if is_ns:
        # Velocities and biases follow in EuRoC's ground truth and VINS-Mono's results.
        return {"euroc": 0.7 if values.shape[1] >= 11 else 0.55, "tum": 0.4}
    if values.shape[1] > 8:
        return {"tum": 0.45, "euroc": 0.4}
    return {"tum": 0.45, "advio-vio": 0.4, "advio-gt": 0.3, "euroc": 0.3}


def _holds_unit(quats: NDArray[np.float64]) -> bool:
    """Whether most rows that hold something hold a unit quaternion."""
    with np.errstate(all="ignore"):
        norms = np.sqrt((quats**2).sum(axis=1))
        has_pose = np.isfinite(norms) & (norms > 0)
        is_unit = np.abs(norms - 1) <= UNIT_TOLERANCE
    return bool(has_pose.any() and is_unit[has_pose].mean() >= _MOSTLY)


def find_quaternion_order(
    position_m: NDArray[np.float64], quat: NDArray[np.float64]
) -> tuple[str | None, float]:
    """Find the order of quaternions' components by the motion, if it tells.

    Args:
        position_m: Shape (n, 3).
        quat: Four columns in an unknown order, xyzw or wxyz, shape (n, 4).

    Returns:
        "xyzw", "wxyz" or None; and the mean cosine between motion and the camera's z axis in
        that order.
    """
    with np.errstate(all="ignore"):
        norms = np.sqrt((quat**2).sum(axis=1))
        sound = (np.abs(norms - 1) <= UNIT_TOLERANCE) & (np.abs(position_m) < 1e9).all(axis=1)
    position_m, quat = position_m[sound], quaternion.normalize(quat[sound])
    directions = motion_directions(position_m) if len(position_m) else None
    if directions is None:
        return None, 0.0
    steadiness: dict[str, float] = {}
    forward: dict[str, float] = {}
    for order, columns in (("xyzw", [0, 1, 2, 3]), ("wxyz", [1, 2, 3, 0])):
        quats = quat[: len(directions), columns]
        means = [
            np.nanmean(quaternion.rotate(turned, directions), axis=0)
            for turned in (quaternion.inverse(quats), quats)
        ]
        steadiness[order] = max(float(np.linalg.norm(mean)) for mean in means)
        forward[order] = float(means[0][2])
    for order, other in (("xyzw", "wxyz"), ("wxyz", "xyzw")):
        if steadiness[order] >= max(_STEADY, steadiness[other] + _CLEARLY_LESS):
            return order, forward[order]
    return None, 0.0


def find_matrix(values: NDArray[np.float64]) -> MatrixColumns | None:
    """Find how rows of 12, 13, 16 or 17 numbers hold a matrix.

    Args:
        values: Shape (n, width).

    Returns:
        Its columns; None if most rows that hold something hold no matrix.
    """
    count = 12 if values.shape[1] in (12, 13) else 16
    first = values.shape[1] - count
    entries = values[:, first:]
    with np.errstate(invalid="ignore"):
        has_pose = np.isfinite(entries).all(axis=1) & (np.abs(entries[:, :3]).max(axis=1) > 0)
    entries = entries[has_pose]
    if not len(entries):
        return None
    if count == 12:
        for columns in (_ROW_MAJOR, _COLUMN_MAJOR_3X4):
            if _are_rotations(entries, columns):
                return MatrixColumns(first, columns, columns != _ROW_MAJOR)
        return None
    is_last_row = _is_bottom(entries[:, 12:16])
    is_last_column = _is_bottom(entries[:, [3, 7, 11, 15]])
    for columns, fits in ((_ROW_MAJOR, is_last_row), (_COLUMN_MAJOR_4X4, is_last_column)):
        if fits and _are_rotations(entries, columns):
            return MatrixColumns(first, columns, columns != _ROW_MAJOR)
    return None


def _is_bottom(rows: NDArray[np.float64]) -> bool:
    """Whether most are 0 0 0 1."""
    return bool((np.abs(rows - [0, 0, 0, 1]) < 1e-6).all(axis=1).mean() >= _MOSTLY)


def _are_rotations(entries: NDArray[np.float64], columns: tuple[int, ...]) -> bool:
    rotations = entries[:, list(columns)].reshape(-1, 3, 4)[:, :, :3]
    is_sane = np.asarray((np.abs(rotations) <= 2).all(axis=(1, 2)))
    rotations = np.where(is_sane[:, None, None], rotations, 0)
    products = rotations @ np.swapaxes(rotations, 1, 2)
    is_rotation = (np.abs(products - np.eye(3)) <= MATRIX_TOLERANCE).all(axis=(1, 2))
    return bool(is_rotation.mean() >= _MOSTLY)


def is_index(values: NDArray[np.float64]) -> bool:
    """Whether a first column counts frames (0, 1, 2, 4) rather than gives their times."""
    finite = values[np.isfinite(values)]
    if not len(finite) or (finite != np.trunc(finite)).any() or np.abs(finite).max() > _MAX_INDEX:
        return False
    steps = np.diff(finite)
    return not len(steps) or bool(np.median(steps) < _MAX_INDEX_STEP)
