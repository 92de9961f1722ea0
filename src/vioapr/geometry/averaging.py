"""Averages of positions and rotations (paper, Period Alignment)."""

from __future__ import annotations

from vioapr.geometry.arrays import ArrayT, constant, namespace
from vioapr.geometry.quaternion import longest_row, normalize

WEISZFELD_ITERATIONS = 40
"""Iterations after which the median is found to about 1e-6 m on runs of a walk."""

_SQUARINGS = 8
"""The power iteration's exponent is 2 to this: an eigenvalue ratio of 0.9 leaves 2e-12."""


def geometric_median(
    points_m: ArrayT, weights: ArrayT, iterations: int = WEISZFELD_ITERATIONS
) -> ArrayT:
    """The point with the least weighted sum of distances, by Weiszfeld's algorithm.

    A fixed number of iterations from the weighted mean, so that it has no branches and can
    be unrolled. Coordinates should be small (relative to one of the points) where single
    precision must do.

    Args:
        points_m: Shape (..., n, 3).
        weights: Shape (..., n), not negative, not all zero; zero leaves a point out.
        iterations: Number of iterations.

    Returns:
        Shape (..., 3).
    """
    xp = namespace(points_m)
    tiny = constant(xp.finfo(points_m.dtype).smallest_normal ** 0.25, points_m)
    # With a 1 appended to the points, one product gives the weighted sum and the weights' sum.
    ones = xp.ones_like(points_m[..., :1])
    homogeneous = xp.concat([points_m, ones], axis=-1)
    total = weights[..., None, :] @ homogeneous
    for _ in range(iterations):
        offsets = points_m - total[..., :3] / total[..., 3:]
        distances = xp.sqrt(xp.vecdot(offsets, offsets))
        # A point that coincides with the estimate gets a huge weight instead of infinity.
        total = (weights / xp.maximum(distances, tiny))[..., None, :] @ homogeneous
    return (total[..., :3] / total[..., 3:])[..., 0, :]


def mean_quaternion(quat_xyzw: ArrayT, weights: ArrayT) -> ArrayT:
    """The rotation with the least weighted sum of squared chordal distances.

    The largest eigenvector of the weighted sum of q q^T (Markley 2007), which does not care
    about the quaternions' signs; found by squaring that matrix, which needs no
    eigen-decomposition and so runs everywhere.

    Args:
        quat_xyzw: Unit quaternions, shape (..., n, 4).
        weights: Shape (..., n), not negative, not all zero.

    Returns:
        Unit quaternion, shape (..., 4).
    """
    xp = namespace(quat_xyzw)
    weighted = quat_xyzw * weights[..., None]
    power = xp.matrix_transpose(weighted) @ quat_xyzw
    for squaring in range(_SQUARINGS):
        # Between two scalings entries grow to 4^7 at most: far from overflow.
        if squaring % 3 == 0:
            power = power / xp.max(xp.abs(power), axis=(-2, -1), keepdims=True)
        power = power @ power
    return normalize(longest_row(power))
