"""Pose graphs: poses that agree with many constraints as well as possible, by Gauss-Newton.

A kind of constraint is one function of the poses, which returns `Factors`: residuals and their
derivatives. Poses are moved by tangent vectors: `perturb` says how. The linear systems are solved
densely, batched and on any Array API backend (`solve_dense`), or sparsely in NumPy
(`solve_sparse`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.arrays import ArrayT, FloatArray, constant, namespace, norm
from vioapr.geometry.rigid import Rigid3, between

_CROSS_TABLE = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]],
    dtype=np.float64,
)
"""The (3, 9) table that turns a vector v into the matrix of v x."""


class Factors(NamedTuple, Generic[ArrayT]):
    """Constraints of one kind, k of them, linearized at some poses.

    Attributes:
        residual: By standard errors, shape (..., k, r).
        nodes: Numbers of the first pose of every constraint, shape (k,), and of the second and
            so on where it is on several.
        jacobians: For each of `nodes`, the derivatives by the pose's tangent vector, shape
            (..., k, r, d).
        weight: Of every constraint's square, shape (k,); None if all are 1.
    """

    residual: ArrayT
    nodes: tuple[NDArray[np.integer], ...]
    jacobians: tuple[ArrayT, ...]
    weight: NDArray[np.float64] | None = None


def gauss_newton(
    poses: Rigid3[ArrayT],
    linearize: Callable[[Rigid3[ArrayT]], Sequence[Factors[ArrayT]]],
    perturb: Callable[[Rigid3[ArrayT], ArrayT], Rigid3[ArrayT]],
    solve: Callable[[Sequence[Factors[ArrayT]], int], ArrayT],
    iterations: int,
) -> Rigid3[ArrayT]:
    """Minimize the weighted sum of squares of residuals, by a fixed number of iterations.

    Args:
        poses: Where to begin, shape (..., n).
        linearize: The constraints at given poses.
        perturb: Moves poses by tangent vectors, shape (..., n, d).
        solve: `solve_dense` or `solve_sparse`.
        iterations: Fixed, so that a batch needs no test of convergence.
    """
    for _ in range(iterations):
        poses = perturb(poses, solve(linearize(poses), poses.batch_shape[-1]))
    return poses


def solve_dense(factors: Sequence[Factors[ArrayT]], count: int) -> ArrayT:
    """Solve for tangent vectors by normal equations; weights are not supported.

    Args:
        factors: Enough to determine all poses; batched alike.
        count: Number of poses, n.

    Returns:
        Shape (..., n, d).
    """
    residual, jacobian = to_dense(factors, count)
    xp = namespace(residual)
    transposed = xp.matrix_transpose(jacobian)
    update = -xp.linalg.solve(transposed @ jacobian, transposed @ residual[..., None])
    size = factors[0].jacobians[0].shape[-1]
    return xp.reshape(update, (*update.shape[:-2], count, size))


def to_dense(factors: Sequence[Factors[ArrayT]], count: int) -> tuple[ArrayT, ArrayT]:
    """Stack all residuals, shape (..., m), and all derivatives, shape (..., m, n d)."""
    residuals: list[ArrayT] = []
    rows: list[ArrayT] = []
    for each in factors:
        xp = namespace(each.residual)
        *batch, constraints, size = each.residual.shape
        residuals.append(xp.reshape(each.residual, (*batch, constraints * size)))
        placed = [
            # Block k goes to its pose's columns; all others are 0.
            blocks[..., None, :] * constant(np.eye(count)[node][:, None, :, None], blocks)
            for node, blocks in zip(each.nodes, each.jacobians, strict=True)
        ]
        total = placed[0]
        for part in placed[1:]:
            total = total + part
        shape = (*total.shape[:-4], constraints * size, count * total.shape[-1])
        rows.append(xp.reshape(total, shape))
    xp = namespace(residuals[0])
    return xp.concat(residuals, axis=-1), xp.concat(rows, axis=-2)


def solve_sparse(
    factors: Sequence[Factors[FloatArray]], count: int, damping: float = 1e-6
) -> FloatArray:
    """Solve for tangent vectors by sparse normal equations, in NumPy, without batch axes.

    Args:
        factors: The constraints.
        count: Number of poses, n.
        damping: Added to the diagonal, so that poses without constraints stay where they are.

    Returns:
        Shape (n, d).
    """
    # Here, as importing it takes longer than the dense users run; it has no types.
    sparse: Any = import_module("scipy.sparse")
    linalg: Any = import_module("scipy.sparse.linalg")

    size = factors[0].jacobians[0].shape[-1]
    total = sparse.diags_array(np.full(size * count, damping)).tocsr()
    right = np.zeros(size * count)
    for residual, nodes, jacobians, weight in factors:
        constraints, rows = residual.shape
        # One row a residual, one column a pose's degree of freedom.
        line: NDArray[np.intp] = np.arange(rows * constraints, dtype=np.intp).reshape(-1, rows, 1)
        values: list[FloatArray] = []
        lines: list[NDArray[np.intp]] = []
        columns: list[NDArray[np.intp]] = []
        for node, blocks in zip(nodes, jacobians, strict=True):
            degree: NDArray[np.intp] = np.arange(size, dtype=np.intp)
            column: NDArray[np.intp] = (size * node[:, None] + degree)[:, None, :]
            values.append(blocks.ravel())
            lines.append(np.broadcast_to(line, blocks.shape).ravel())
            columns.append(np.broadcast_to(column, blocks.shape).ravel())
        entries = np.concatenate(values), (np.concatenate(lines), np.concatenate(columns))
        jacobian = sparse.coo_array(entries, shape=(rows * constraints, size * count)).tocsr()
        weighted = jacobian.T
        if weight is not None:
            weighted = weighted @ sparse.diags_array(np.repeat(weight, rows))
        total = total + weighted @ jacobian
        right -= weighted @ residual.ravel()
    return np.asarray(linalg.spsolve(total.tocsc(), right)).reshape(count, size)


def perturb(world_from_cam: Rigid3[ArrayT], tangent: ArrayT) -> Rigid3[ArrayT]:
    """Move poses by tangent vectors: t + d in the world, R exp(w) in the camera.

    Args:
        world_from_cam: Shape (...).
        tangent: Shape (..., 6): translation d in m, then rotation vector w in rad.
    """
    turn = quaternion.from_rotvec(tangent[..., 3:])
    return Rigid3(
        world_from_cam.translation_m + tangent[..., :3],
        quaternion.normalize(quaternion.multiply(world_from_cam.quat_xyzw, turn)),
    )


def prior_residual(
    pose: Rigid3[ArrayT], prior: Rigid3[ArrayT], sigma_m: float, sigma_rad: float
) -> tuple[ArrayT, ArrayT]:
    """The residual of poses against priors, position and rotation, and its derivatives.

    Args:
        pose: Shape (...).
        prior: Shape (...).
        sigma_m: Standard deviation of the position per axis.
        sigma_rad: Of the orientation per axis.

    Returns:
        Shapes (..., 6) and, by `perturb`'s tangent vectors, (..., 6, 6).
    """
    turn = turn_between(prior.quat_xyzw, pose.quat_xyzw)
    eye = constant(np.eye(3), turn) + 0 * turn[..., None]
    residual = namespace(turn).concat(
        [(pose.translation_m - prior.translation_m) / sigma_m, turn / sigma_rad], axis=-1
    )
    return residual, _stack_blocks(
        [[eye / sigma_m, 0 * eye], [0 * eye, log_jacobian(turn) / sigma_rad]]
    )


def motion_residual(
    first: Rigid3[ArrayT],
    second: Rigid3[ArrayT],
    first_from_second: Rigid3[ArrayT],
    sigma_m: float,
    sigma_rad: float,
) -> tuple[ArrayT, ArrayT, ArrayT]:
    """The residual of the motion between poses against a measured one, and its derivatives.

    Args:
        first: Shape (...).
        second: Shape (...).
        first_from_second: The measured motion, shape (...).
        sigma_m: Its standard deviation per axis.
        sigma_rad: Of its turn per axis.

    Returns:
        Shapes (..., 6) and, by the tangent vectors of the first and of the second pose,
        (..., 6, 6).
    """
    motion = between(first, second)
    turn = turn_between(first_from_second.quat_xyzw, motion.quat_xyzw)
    by_turn = log_jacobian(turn)
    xp = namespace(turn)
    first_from_world = xp.matrix_transpose(quaternion.to_matrix(first.quat_xyzw))
    second_from_first = xp.matrix_transpose(quaternion.to_matrix(motion.quat_xyzw))
    zero = 0 * by_turn
    offset = motion.translation_m - first_from_second.translation_m
    residual = xp.concat([offset / sigma_m, turn / sigma_rad], axis=-1)
    by_first = [
        [-first_from_world / sigma_m, cross_matrix(motion.translation_m) / sigma_m],
        [zero, -(by_turn @ second_from_first) / sigma_rad],
    ]
    by_second = [[first_from_world / sigma_m, zero], [zero, by_turn / sigma_rad]]
    return residual, _stack_blocks(by_first), _stack_blocks(by_second)


def turn_between(a_xyzw: ArrayT, b_xyzw: ArrayT) -> ArrayT:
    """The rotation vector of a^-1 b, shape (..., 3), rad."""
    return quaternion.to_rotvec(quaternion.multiply(quaternion.inverse(a_xyzw), b_xyzw))


def log_jacobian(rotvec_rad: ArrayT) -> ArrayT:
    """The derivative of log(exp(v) exp(w)) by w at w = 0, shapes (..., 3) to (..., 3, 3).

    The inverse of the right Jacobian of rotations: I + [v]/2 + c [v]^2, with
    c = (1 - h cot h) / (2 h)^2 and h = |v| / 2, which tends to 1/12.
    """
    xp = namespace(rotvec_rad)
    half = norm(rotvec_rad)[..., None, None] / 2
    is_small = half < 1e-3
    safe = xp.where(is_small, xp.ones_like(half), half)
    factor = xp.where(
        is_small,
        1 / 12 + half * half / 180,
        (1 - safe * xp.cos(safe) / xp.sin(safe)) / (4 * safe * safe),
    )
    cross = cross_matrix(rotvec_rad)
    return constant(np.eye(3), rotvec_rad) + cross / 2 + factor * (cross @ cross)


def cross_matrix(vectors: ArrayT) -> ArrayT:
    """The matrix [v] with [v] u = v x u, shapes (..., 3) to (..., 3, 3)."""
    flat = vectors @ constant(_CROSS_TABLE, vectors)
    return namespace(flat).reshape(flat, (*flat.shape[:-1], 3, 3))


def geman_mcclure(residual: FloatArray, limit: float) -> FloatArray:
    """The weights of constraints by their residuals' lengths, shapes (k, r) to (k,).

    Geman and McClure's: near 1 far below the limit, 1/4 at it, and falling with the fourth
    power of the length beyond it, so that wrong constraints have no say.
    """
    length = np.linalg.norm(residual, axis=-1)
    return 1 / (1 + (length / limit) ** 2) ** 2


def _stack_blocks(blocks: list[list[ArrayT]]) -> ArrayT:
    """Matrices (..., 6, 6) of blocks (..., 3, 3)."""
    xp = namespace(blocks[0][0])
    return xp.concat([xp.concat(row, axis=-1) for row in blocks], axis=-2)
