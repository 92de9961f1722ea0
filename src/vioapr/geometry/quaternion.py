"""Rotations as unit quaternions: Hamilton, order x, y, z, w, on the last axis.

A rotation `target_from_source` turns a vector's source coordinates into target coordinates,
and rotations compose like their names: `multiply(a_from_b, b_from_c)` is `a_from_c`.
All functions are batched over leading axes and run on any ArrayT API backend. Few large
operations are preferred to many small ones: each of them becomes a node of the graph that
phones run.
"""

from __future__ import annotations

import numpy as np

from vioapr.geometry.arrays import ArrayT, FloatArray, constant, namespace, norm


def _product_table() -> FloatArray:
    """The (16, 4) table that turns the outer product p q into the Hamilton product pq."""
    table = np.zeros((4, 4, 4))
    for axis in range(3):
        following, last = (axis + 1) % 3, (axis + 2) % 3
        table[following, last, axis] = 1.0  # ij = k
        table[last, following, axis] = -1.0  # ji = -k
        table[axis, 3, axis] = table[3, axis, axis] = 1.0
        table[axis, axis, 3] = -1.0
    table[3, 3, 3] = 1.0
    return table.reshape(16, 4)


def _matrix_table() -> FloatArray:
    """The (16, 9) table that turns the outer product q q into the rotation matrix of q."""
    table = np.zeros((4, 4, 3, 3))
    for i in range(3):
        table[3, 3, i, i] += 1.0
        for j in range(3):
            table[j, j, i, i] -= 1.0
            table[i, j, i, j] += 2.0
        following, last = (i + 1) % 3, (i + 2) % 3
        table[3, i, last, following] += 2.0  # 2 w [v]x
        table[3, i, following, last] -= 2.0
    return table.reshape(16, 9)


_PRODUCT_TABLE = _product_table()
_MATRIX_TABLE = _matrix_table()


def _outer(left: ArrayT, right: ArrayT) -> ArrayT:
    """All products of components, shapes (..., 4) to (..., 16)."""
    products = left[..., :, None] * right[..., None, :]
    return namespace(products).reshape(products, (*products.shape[:-2], 16))


def normalize(quat_xyzw: ArrayT) -> ArrayT:
    """The unit quaternion of the same direction, shape (..., 4)."""
    return quat_xyzw / norm(quat_xyzw)[..., None]


def canonical(quat_xyzw: ArrayT) -> ArrayT:
    """The one of the two quaternions of a rotation that has w >= 0, shape (..., 4)."""
    xp = namespace(quat_xyzw)
    return xp.where(quat_xyzw[..., 3:4] < 0, -quat_xyzw, quat_xyzw)


def multiply(left_xyzw: ArrayT, right_xyzw: ArrayT) -> ArrayT:
    """The Hamilton product: a_from_b times b_from_c is a_from_c, shapes (..., 4)."""
    return _outer(left_xyzw, right_xyzw) @ constant(_PRODUCT_TABLE, left_xyzw)


def inverse(quat_xyzw: ArrayT) -> ArrayT:
    """The inverse rotation of a unit quaternion (its conjugate), shape (..., 4)."""
    return quat_xyzw * constant(np.array([-1.0, -1.0, -1.0, 1.0]), quat_xyzw)


def to_matrix(quat_xyzw: ArrayT) -> ArrayT:
    """The rotation matrix of a unit quaternion, shapes (..., 4) to (..., 3, 3)."""
    flat = _outer(quat_xyzw, quat_xyzw) @ constant(_MATRIX_TABLE, quat_xyzw)
    return namespace(flat).reshape(flat, (*flat.shape[:-1], 3, 3))


def from_matrix(matrix: ArrayT) -> ArrayT:
    """The unit quaternion (w >= 0) of a rotation matrix, shapes (..., 3, 3) to (..., 4).

    q is the dominant eigenvector of a symmetric 4x4 matrix that is linear in the rotation
    matrix (Bar-Itzhack 2000). For an exact rotation that 4x4 matrix is q q^T, so its longest
    row is q up to length and sign: no branches, and stable at half turns.
    """
    xp = namespace(matrix)
    row = [[matrix[..., i, j] for j in range(3)] for i in range(3)]
    one = xp.ones_like(row[0][0])
    x, y, z = row[2][1] - row[1][2], row[0][2] - row[2][0], row[1][0] - row[0][1]
    xy, xz, yz = row[0][1] + row[1][0], row[0][2] + row[2][0], row[1][2] + row[2][1]
    a, b, c = row[0][0], row[1][1], row[2][2]
    entries = [
        *(one + a - b - c, xy, xz, x),
        *(xy, one - a + b - c, yz, y),
        *(xz, yz, one - a - b + c, z),
        *(x, y, z, one + a + b + c),
    ]
    four_q_qt = xp.reshape(xp.stack(entries, axis=-1), (*one.shape, 4, 4))
    return canonical(normalize(longest_row(four_q_qt)))


def longest_row(symmetric: ArrayT) -> ArrayT:
    """The row with the largest diagonal entry, shapes (..., 4, 4) to (..., 4).

    Of a multiple of q q^T, that row is the multiple of q that is best conditioned.
    """
    xp = namespace(symmetric)
    # Unequal factors break ties: two rows of opposite sign must not be summed.
    diagonal = xp.sum(symmetric * constant(np.diag([1.0, 0.999, 0.998, 0.997]), symmetric), axis=-1)
    is_longest = diagonal >= xp.max(diagonal, axis=-1, keepdims=True)
    return xp.sum(symmetric * xp.astype(is_longest, symmetric.dtype)[..., None], axis=-2)


def rotate(quat_xyzw: ArrayT, vectors: ArrayT) -> ArrayT:
    """Rotate vectors: a_from_b applied to coordinates in b, shapes (..., 4) and (..., 3)."""
    return (to_matrix(quat_xyzw) @ vectors[..., None])[..., 0]


def angle_rad(quat_xyzw: ArrayT) -> ArrayT:
    """The rotation's angle in radians, 0 to pi, shape (..., 4) to (...).

    By 2 atan2(|v|, |w|), which keeps its precision near 0 where the arccos of the paper's
    equations 4-6 loses half the digits.
    """
    xp = namespace(quat_xyzw)
    return 2 * xp.atan2(norm(quat_xyzw[..., :3]), xp.abs(quat_xyzw[..., 3]))


def angle_between_deg(left_xyzw: ArrayT, right_xyzw: ArrayT) -> ArrayT:
    """The angle of left^-1 right in degrees, 0 to 180 (paper equations 4-6, 16 and 18)."""
    return angle_rad(multiply(inverse(left_xyzw), right_xyzw)) * (180 / np.pi)


def from_rotvec(rotvec_rad: ArrayT) -> ArrayT:
    """The unit quaternion of a rotation vector (axis times angle), (..., 3) to (..., 4)."""
    xp = namespace(rotvec_rad)
    half = norm(rotvec_rad)[..., None] / 2
    # sin(h)/(2h): below 1e-4 rad the first two terms are exact in double precision.
    is_small = half < 1e-4
    safe_half = xp.where(is_small, xp.ones_like(half), half)
    factor = xp.where(is_small, 0.5 - half * half / 12, xp.sin(safe_half) / (2 * safe_half))
    return xp.concat([rotvec_rad * factor, xp.cos(half)], axis=-1)


def to_rotvec(quat_xyzw: ArrayT) -> ArrayT:
    """The rotation vector (axis times angle, 0 to pi rad), shapes (..., 4) to (..., 3)."""
    xp = namespace(quat_xyzw)
    positive = canonical(quat_xyzw)
    length = norm(positive[..., :3])[..., None]
    is_small = length < 1e-8
    safe_length = xp.where(is_small, xp.ones_like(length), length)
    factor = 2 * xp.atan2(length, positive[..., 3:]) / safe_length
    return positive[..., :3] * xp.where(is_small, 2 * xp.ones_like(length), factor)


def slerp(start_xyzw: ArrayT, end_xyzw: ArrayT, fraction: ArrayT) -> ArrayT:
    """Interpolate along the shorter arc, shapes (..., 4), (..., 4) and (...)."""
    step = to_rotvec(multiply(inverse(start_xyzw), end_xyzw))
    return multiply(start_xyzw, from_rotvec(step * fraction[..., None]))
