"""Poses and trajectories from the rows of a file, checked so that errors name the line."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError
from vioapr.files.tables import Rows
from vioapr.formats.base import ReadOptions
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory, find_problem

MAX_DISTANCE_M = 1e9
"""Farther positions are not metres; also keeps the geometry from overflowing."""

MAX_TIME_S = 1e11
"""Later timestamps (year 5138) are not seconds, but milli-, micro- or nanoseconds."""

MATRIX_TOLERANCE = 0.01
"""How far from orthonormal a rotation matrix may be: text files round to 3 digits and more."""


def poses_of(rows: Rows, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]) -> Rigid3:
    """Check the numbers of a file and make them poses, in whatever convention it has.

    To be called before any conversion, so that messages quote the file's own numbers.

    Raises:
        FormatError: Not finite, too far or not a unit quaternion, naming the line.
    """
    _raise_problem(
        rows, find_problem(np.arange(len(rows), dtype=np.float64), position_m, quat_xyzw)
    )
    is_far = (np.abs(position_m) > MAX_DISTANCE_M).any(axis=1)
    if is_far.any():
        row = int(np.argmax(is_far))
        farthest = np.abs(position_m[row]).max()
        problem = f"expected positions within {MAX_DISTANCE_M:.0e} m, got {farthest:.3g}"
        raise FormatError(rows.path, problem, rows.lines[row])
    return Rigid3(position_m, quaternion.normalize(quat_xyzw))


def rigid_of_matrices(rows: Rows, matrices: NDArray[np.float64]) -> Rigid3:
    """Check 3x4 or 4x4 matrices of a file and make them poses, in whatever convention it has.

    Args:
        rows: Where each came from.
        matrices: Shape (n, 3 or 4, 4).

    Raises:
        FormatError: Not finite, too far, or the left 3x3 part is not a rotation.
    """
    rotations, positions = matrices[:, :3, :3], matrices[:, :3, 3]
    # Bounded before they are multiplied, so that nothing overflows.
    is_sane = (np.abs(rotations) <= 2).all(axis=(1, 2)) & np.isfinite(positions).all(axis=1)
    if not is_sane.all():
        row = int(np.argmin(is_sane))
        raise FormatError(
            rows.path, "expected finite numbers and a rotation matrix", rows.lines[row]
        )
    products = rotations @ np.swapaxes(rotations, -1, -2)
    is_orthonormal = (np.abs(products - np.eye(3)) <= MATRIX_TOLERANCE).all(axis=(1, 2))
    if not is_orthonormal.all():
        row = int(np.argmin(is_orthonormal))
        raise FormatError(
            rows.path, "expected a rotation matrix, got one not orthonormal", rows.lines[row]
        )
    is_mirror = np.linalg.det(rotations) < 0
    if is_mirror.any():
        row = int(np.argmax(is_mirror))
        raise FormatError(
            rows.path,
            "expected a rotation matrix, got a mirror image (determinant -1): left-handed axes?",
            rows.lines[row],
        )
    return poses_of(rows, positions, quaternion.from_matrix(rotations))


def build_trajectory(
    rows: Rows,
    timestamp_s: NDArray[np.float64],
    target_from_source: Rigid3,
    options: ReadOptions,
    *,
    names: Sequence[str] | None = None,
    is_timed: bool = True,
    target: str = "world",
    source: str = "cam",
) -> Trajectory:
    """Build a trajectory from the checked poses of a file.

    Args:
        rows: Where each pose came from.
        timestamp_s: Shape (n,), s; the row's index where there is no clock.
        target_from_source: Poses from `poses_of`, already in our conventions.
        options: Whether rows out of order are skipped.
        names: Image names.
        is_timed: Whether the timestamps are seconds of a clock.
        target: Name of the target frame.
        source: Name of the source frame.

    Raises:
        FormatError: A time is not later than the one before or is no second, naming the line.
    """
    kept = list(range(len(rows)))
    if options.skipped is not None:
        kept.clear()
        latest_s = -math.inf
        for row, time_s in enumerate(timestamp_s.tolist()):
            # NaN is kept, for find_problem to report.
            if time_s <= latest_s:
                relation = "a duplicate of" if time_s == latest_s else "earlier than"
                problem = f"timestamp {time_s:.6f} s is {relation} one before ({latest_s:.6f} s)"
                options.skipped.append(FormatError(rows.path, problem, rows.lines[row]))
            else:
                kept.append(row)
                latest_s = time_s
    rows, timestamp_s = rows.at(kept), timestamp_s[kept]
    poses = target_from_source.at(kept)
    names = None if names is None else [names[i] for i in kept]
    position_m, quat_xyzw = poses.translation_m, poses.quat_xyzw
    _raise_problem(rows, find_problem(timestamp_s, position_m, quat_xyzw, names=names))
    is_late = np.abs(timestamp_s) > MAX_TIME_S
    if is_late.any():
        row = int(np.argmax(is_late))
        problem = f"expected a timestamp in seconds, got {timestamp_s[row]:.6g} s: another unit?"
        raise FormatError(rows.path, problem, rows.lines[row])
    return Trajectory.from_arrays(
        timestamp_s,
        position_m,
        quat_xyzw,
        names,
        is_timed=is_timed,
        target=target,
        source=source,
    )


def _raise_problem(rows: Rows, problem: tuple[int | None, str] | None) -> None:
    if problem is not None:
        row, what = problem
        raise FormatError(rows.path, what, None if row is None else rows.lines[row])


def index_times(count: int, options: ReadOptions) -> NDArray[np.float64]:
    """Times of rows without clock or names: the index, or seconds if a rate is given."""
    return np.arange(count) / (options.rate_hz or 1.0)


def require_times(trajectory: Trajectory, title: str) -> None:
    """Check that a trajectory may be written in a format with timestamps.

    Raises:
        ParameterError: It has none; row numbers must not pass for seconds.
    """
    if not trajectory.is_timed:
        raise ParameterError(
            f"{title} needs timestamps, and the trajectory has none: give the rate of its frames "
            "(`rate_hz`)"
        )


def pose_columns(poses: Rigid3, order: Sequence[int] = (0, 1, 2, 3)) -> list[list[float]]:
    """Position and quaternion of each pose as plain floats, 7 a pose.

    Args:
        poses: Shape (n,).
        order: The quaternion's components in the file, as indices of xyzw: wxyz is
            (3, 0, 1, 2).
    """
    quats = poses.quat_xyzw[:, list(order)]
    return np.column_stack([poses.translation_m, quats]).tolist()
