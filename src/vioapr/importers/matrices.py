"""Poses of 4x4 matrices as apps write them: broken ones cost themselves alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.formats import conventions
from vioapr.formats.matrix_order import are_transposed, explain_transposed, to_rows
from vioapr.formats.poses import MAX_DISTANCE_M
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

_ROUNDING = 0.02


class MatrixPoses(NamedTuple):
    """Poses of matrices.

    Attributes:
        world_from_cam: OpenCV axes, shape (n,), NaN where a matrix gives no pose.
        scale: Of each matrix, 1 mostly; shape (n,).
        problems: What is wrong with a matrix, by its row.
        is_transposed: Whether the matrices were written column by column, which is mended.
    """

    world_from_cam: Rigid3
    scale: NDArray[np.float64]
    problems: dict[int, str]
    is_transposed: bool = False


def poses_of_matrices(matrices: NDArray[np.float64]) -> MatrixPoses:
    """Find the poses of matrices, world_from_cam with OpenGL axes.

    A matrix may carry a scale, the same along all axes: it is taken off the rotation. If most
    are transposed, all are.

    Args:
        matrices: Shape (n, 4, 4); all NaN where nothing is known, which is no problem.
    """
    matrices, is_file_transposed = to_rows(matrices)
    is_transposed = are_transposed(matrices)
    rotations, positions = matrices[:, :3, :3], matrices[:, :3, 3]
    is_finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    is_near = np.asarray((np.abs(positions) <= MAX_DISTANCE_M).all(axis=1))
    # Bounded before it is multiplied, so that nothing overflows.
    is_sane = is_finite & is_near & (np.abs(rotations) < 1e6).all(axis=(1, 2))
    safe = np.where(is_sane.reshape(-1, 1, 1), rotations, np.eye(3))
    lengths = np.linalg.norm(safe, axis=1)
    scale: NDArray[np.float64] = lengths.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.asarray(safe / scale[:, None, None])
        products = np.swapaxes(unit, 1, 2) @ unit
    is_rotation = np.asarray(np.abs(products - np.eye(3)) <= _ROUNDING).all(axis=(1, 2))
    determinants = np.asarray(np.linalg.det(np.where(np.isfinite(unit), unit, 0.0)))
    is_mirror = is_rotation & (determinants < 0)
    problems: dict[int, str] = {}
    is_pose = is_sane & is_rotation & ~is_mirror & ~is_transposed
    for row in np.flatnonzero(~is_pose).tolist():
        if np.isnan(matrices[row]).all():
            continue
        if is_transposed[row]:
            problems[row] = explain_transposed(matrices[row])
        elif not is_finite[row]:
            problems[row] = "expected finite numbers in its matrix"
        elif not is_near[row]:
            farthest = np.abs(positions[row]).max()
            problems[row] = f"expected a position within {MAX_DISTANCE_M:.0e} m, got {farthest:.3g}"
        elif is_mirror[row]:
            problems[row] = "expected a rotation matrix, got a mirror image (determinant -1)"
        else:
            problems[row] = "expected a rotation matrix, got one not orthonormal"
    known = np.flatnonzero(is_pose)
    poses = Rigid3.unknown((len(matrices),))
    left, _, right = np.linalg.svd(unit[known])  # the nearest rotation is left @ right
    arcam = Rigid3(positions[known], quaternion.from_matrix(left @ right))
    cam = conventions.world_from_arcam(arcam)
    poses.translation_m[known], poses.quat_xyzw[known] = cam.translation_m, cam.quat_xyzw
    scale = np.where(is_sane & is_rotation, scale, 1.0)
    return MatrixPoses(poses, scale, problems, is_file_transposed)
