"""Poses and trajectories from the rows of a file, checked so that errors name the line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError
from vioapr.files.tables import RowProblem, Rows
from vioapr.formats.base import ReadOptions
from vioapr.formats.left_out import NO_POSE, distance_text, find_sound_rows
from vioapr.formats.matrix_order import (
    TRANSPOSED,
    are_transposed,
    explain_transposed,
    to_rows,
)
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import UNIT_TOLERANCE, Trajectory

MAX_DISTANCE_M = 1e9
"""Farther positions are not metres; also keeps the geometry from overflowing."""

MAX_TIME_S = 1e11
"""Later timestamps (year 5138) are not seconds, but milli-, micro- or nanoseconds."""

MAX_ANGLE_RAD = 1e3
"""Larger rotations are not radians, nor degrees."""

MATRIX_TOLERANCE = 0.01
"""How far from orthonormal a rotation matrix may be: text files round to 3 digits and more."""


def poses_of(rows: Rows, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]) -> Rigid3:
    """Check the numbers of a file and make them poses, in whatever convention it has.

    To be called before any conversion, so that messages quote the file's own numbers. Rows that
    give no pose (not finite, a zero or no unit quaternion, too far) are noted in
    `rows.problems` and get NaN: `build_trajectory` leaves them out or raises.
    """
    with np.errstate(all="ignore"):
        norms = np.asarray(np.sqrt((quat_xyzw**2).sum(axis=1)))
        numbers = np.column_stack([position_m, quat_xyzw])
        is_finite = np.asarray(np.isfinite(numbers).all(axis=1))
        is_unit = np.abs(norms - 1) <= UNIT_TOLERANCE
        is_near = (np.abs(position_m) <= MAX_DISTANCE_M).all(axis=1)
    bad: NDArray[np.bool_] = ~(is_finite & is_unit & is_near)
    for row in np.flatnonzero(bad).tolist():
        norm, far_m = f"{norms[row]:.6g}", np.abs(position_m[row]).max()
        if not is_finite[row]:
            problem = RowProblem("expected finite numbers, got NaN or inf", NO_POSE)
        elif not is_unit[row]:
            text = f"expected a unit quaternion, got one of norm {norm}"
            problem = RowProblem(text, f"quaternion has norm {norm}" if norms[row] else NO_POSE)
        else:
            text = f"expected positions within {MAX_DISTANCE_M:.0e} m, got {far_m:.3g}"
            problem = RowProblem(text, f"position is {distance_text(far_m)} away")
        rows.problems.setdefault(rows.lines[row], problem)
    positions = np.where(bad[:, None], np.nan, position_m)
    quats = np.where(bad[:, None], np.nan, quat_xyzw)
    return Rigid3(positions, quats / np.where(bad, np.nan, norms)[:, None])


def rigid_of_matrices(rows: Rows, matrices: NDArray[np.float64]) -> Rigid3:
    """Check 3x4 or 4x4 matrices of a file and make them poses, in whatever convention it has.

    Rows that give no pose (not finite, too far, transposed, or no rotation in the left 3x3 part)
    are noted and get NaN, as in `poses_of`.

    Args:
        rows: Where each came from.
        matrices: Shape (n, 3 or 4, 4).
    """
    rotations, positions = matrices[:, :3, :3], matrices[:, :3, 3]
    is_finite = np.isfinite(rotations).all(axis=(1, 2)) & np.isfinite(positions).all(axis=1)
    is_nothing = ~is_finite | (rotations == 0).all(axis=(1, 2))
    # Bounded before they are multiplied, so that nothing overflows.
    is_sane = np.asarray(is_finite & (np.abs(rotations) <= 2).all(axis=(1, 2)))
    rotations = np.where(is_sane[:, None, None], rotations, 0.0)
    products = rotations @ np.swapaxes(rotations, -1, -2)
    is_orthonormal = (np.abs(products - np.eye(3)) <= MATRIX_TOLERANCE).all(axis=(1, 2))
    is_mirror = is_orthonormal & (np.linalg.det(rotations) < 0)
    is_transposed = are_transposed(matrices)
    bad = np.asarray(~is_orthonormal | is_mirror | is_transposed)
    for row in np.flatnonzero(bad).tolist():
        if is_transposed[row]:
            text = explain_transposed(matrices[row])
        elif not is_sane[row]:
            text = "expected finite numbers and a rotation matrix"
        elif is_mirror[row]:
            text = (
                "expected a rotation matrix, got a mirror image (determinant -1): left-handed axes?"
            )
        else:
            text = "expected a rotation matrix, got one not orthonormal"
        what = "matrix is transposed" if is_transposed[row] else "matrix is no rotation"
        summary = NO_POSE if is_nothing[row] else what
        rows.problems.setdefault(rows.lines[row], RowProblem(text, summary))
    quats = quaternion.from_matrix(np.where(bad[:, None, None], np.eye(3), rotations))
    return poses_of(rows, positions, np.where(bad[:, None], np.nan, quats))


def rigid_of_file(rows: Rows, matrices: NDArray[np.float64], options: ReadOptions) -> Rigid3:
    """Make all matrices of a file poses, as `rigid_of_matrices`, and transpose them if need be.

    Args:
        rows: Where each came from.
        matrices: Shape (n, 4, 4), in the order of the file's format.
        options: Where to say that the file has the other order.
    """
    matrices, is_transposed = to_rows(matrices)
    if is_transposed:
        options.note(rows.path, TRANSPOSED, is_warning=True)
    return rigid_of_matrices(rows, matrices)


def quaternions_of_rotvecs(rotvec_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions xyzw of axis-angle rotations of a file; NaN for numbers that are no angle.

    Args:
        rotvec_rad: Shape (n, 3), radians.
    """
    with np.errstate(all="ignore"):
        is_angle = np.abs(rotvec_rad) <= MAX_ANGLE_RAD  # false for NaN
    quats = quaternion.from_rotvec(np.where(is_angle, rotvec_rad, 0.0))
    return np.where(np.asarray(is_angle.all(axis=1))[:, None], quats, np.nan)


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
    """Build a trajectory from the checked poses of a file, without the rows that give none.

    Args:
        rows: Where each pose came from.
        timestamp_s: Shape (n,), s; the row's index where there is no clock.
        target_from_source: Poses from `poses_of`, already in our conventions.
        options: Whether to be strict, and where notes go.
        names: Image names.
        is_timed: Whether the timestamps are seconds of a clock.
        target: Name of the target frame.
        source: Name of the source frame.

    Raises:
        FormatError: No row or too few give a pose, times run backwards for many rows or are no
            seconds, or `strict` and one row gives no pose; naming the line.
    """
    if not len(rows):
        raise FormatError(rows.path, "expected at least one pose, got none")
    kept = find_sound_rows(
        rows,
        timestamp_s,
        target_from_source.translation_m,
        options,
        names,
        is_timed=is_timed,
    )
    rows, timestamp_s = rows.at(kept), timestamp_s[kept]
    poses = target_from_source.at(kept)
    names = None if names is None else [names[i] for i in kept]
    is_late = np.abs(timestamp_s) > MAX_TIME_S
    if is_late.any():
        row = int(np.argmax(is_late))
        problem = f"expected a timestamp in seconds, got {timestamp_s[row]:.6g} s: another unit?"
        raise FormatError(rows.path, problem, rows.lines[row])
    return Trajectory.from_arrays(
        timestamp_s,
        poses.translation_m,
        poses.quat_xyzw,
        names,
        is_timed=is_timed,
        target=target,
        source=source,
    )


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
