"""The constant transform between two devices that are fixed to each other: hand-eye calibration.

A tracker may give the poses of its IMU's body, and a regressor those of a camera. Both see the
same motion, each in its own axes: A X = X B, where A is the motion of the body between two
moments, B that of the camera, and X the constant `body_from_cam` (Tsai and Lenz 1989). Rotation
is found first, from the axes of rotations and the directions of motion (Park and Martin 1994,
with outliers weighed down); then the lever arm, by least squares.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

FloatArray = NDArray[np.float64]

ARM_PRIOR_M = 0.1
"""Camera and IMU of one device are hardly further apart, per axis: standard deviation, m."""

_ITERATIONS = 12
_LARGEST_TURN_RAD = np.deg2rad(150)


class DirectionPairs(NamedTuple):
    """Vectors that a constant rotation is to map onto each other.

    Attributes:
        left: Shape (n, 3).
        right: Shape (n, 3), of about the same lengths.
    """

    left: FloatArray
    right: FloatArray


class FittedRotation(NamedTuple):
    """A constant rotation between two sets of vectors.

    Attributes:
        left_from_right_xyzw: Shape (4,).
        sigma_rad: Standard deviation about the axis that is known least, of independent pairs.
    """

    left_from_right_xyzw: FloatArray
    sigma_rad: float


class HandEye(NamedTuple):
    """The constant transform between a body and a camera that is fixed to it.

    Attributes:
        body_from_cam: Shape (); the lever arm is drawn to zero where motion does not tell.
        rotation_sigma_rad: Standard deviation about the axis that is known least.
        arm_sigma_m: Standard deviation of the lever arm per axis, shape (3,).
    """

    body_from_cam: Rigid3
    rotation_sigma_rad: float
    arm_sigma_m: FloatArray

    @property
    def knows_arm(self) -> bool:
        """Whether motion tells more of the lever arm, along some axis, than any device's size."""
        return bool(self.arm_sigma_m.min() < ARM_PRIOR_M / 2)


class LeverArm(NamedTuple):
    """Where the camera is in the body's frame.

    Attributes:
        position_m: Shape (3,); drawn to zero where the motion does not tell (`ARM_PRIOR_M`).
        sigma_m: Standard deviation per axis, shape (3,).
    """

    position_m: FloatArray
    sigma_m: FloatArray


def rotation_vectors(left_turns: FloatArray, right_turns: FloatArray) -> DirectionPairs:
    """Pair the rotation vectors of two sets of relative rotations.

    Turns near a half turn are left out, as their axis may point either way.

    Args:
        left_turns: Quaternions xyzw, shape (n, 4).
        right_turns: Shape (n, 4).
    """
    left, right = quaternion.to_rotvec(left_turns), quaternion.to_rotvec(right_turns)
    lengths = np.linalg.norm(left, axis=1), np.linalg.norm(right, axis=1)
    is_clear = np.maximum(*lengths) < _LARGEST_TURN_RAD
    return DirectionPairs(left[is_clear], right[is_clear])


def unit_directions(left_m: FloatArray, right_m: FloatArray) -> DirectionPairs:
    """Pair the directions of displacements; those of no length are left out."""
    lengths = np.linalg.norm(left_m, axis=1), np.linalg.norm(right_m, axis=1)
    moves = (np.minimum(*lengths) > 0) & np.isfinite(lengths[0]) & np.isfinite(lengths[1])
    return DirectionPairs(
        left_m[moves] / lengths[0][moves, None], right_m[moves] / lengths[1][moves, None]
    )


def fit_rotation(sets: tuple[DirectionPairs, ...], pairs_per_independent: float) -> FittedRotation:
    """Fit one rotation to several sets of vectors, each weighed by its own noise.

    Residuals are weighed by the Geman-McClure function of their median, again and again.

    Args:
        sets: Vectors of rotations, directions of motion, or both.
        pairs_per_independent: How many pairs hold the information of one, as they overlap.
    """
    quat = np.array([0.0, 0.0, 0.0, 1.0])
    weights = [np.ones(len(pairs.left)) for pairs in sets]
    for _ in range(_ITERATIONS):
        covariance = np.zeros((3, 3))
        for pairs, weight in zip(sets, weights, strict=True):
            covariance += (pairs.left * weight[:, None]).T @ pairs.right
        quat = quaternion.from_matrix(_nearest_rotation(covariance))
        weights = [_weigh(_residuals(pairs, quat)) for pairs in sets]
    information = np.zeros((3, 3))
    for pairs, weight in zip(sets, weights, strict=True):
        rotated = quaternion.rotate(quat, pairs.right)
        information += float((weight[:, None] * rotated**2).sum()) * np.eye(3)
        information -= np.einsum("n,ni,nj->ij", weight, rotated, rotated)
    least = float(np.linalg.eigvalsh(information)[0]) / pairs_per_independent
    return FittedRotation(quat, 1 / np.sqrt(least) if least > 0 else np.inf)


def _residuals(pairs: DirectionPairs, quat: FloatArray) -> FloatArray:
    return np.linalg.norm(pairs.left - quaternion.rotate(quat, pairs.right), axis=1)


def _weigh(residuals: FloatArray) -> FloatArray:
    """Inverse variances, of outliers nearly none."""
    if not len(residuals):
        return residuals
    # Of three normal components, the median length is 1.54 standard deviations.
    sigma = max(float(np.median(residuals)) / 1.54, 1e-4)
    return 1 / (sigma * (1 + (residuals / (3 * sigma)) ** 2)) ** 2


def _nearest_rotation(covariance: FloatArray) -> FloatArray:
    u, _, vt = np.linalg.svd(covariance)
    signs = np.array([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
    return (u * signs) @ vt


def fit_lever_arm(
    body_motion: Rigid3,
    cam_motion: Rigid3,
    body_from_cam_xyzw: FloatArray,
    pairs_per_independent: float,
) -> LeverArm:
    """Fit the camera's place in the body's frame to the motions of both.

    (R_body - I) t = R_x t_cam - t_body, in which only turns tell of t.

    Args:
        body_motion: body_i_from_body_j, shape (n,).
        cam_motion: cam_i_from_cam_j of the same moments, shape (n,).
        body_from_cam_xyzw: The rotation between them, shape (4,).
        pairs_per_independent: How many pairs hold the information of one, as they overlap.
    """
    turned = quaternion.to_matrix(body_motion.quat_xyzw) - np.eye(3)
    moved = quaternion.rotate(body_from_cam_xyzw, cam_motion.translation_m)
    wanted = moved - body_motion.translation_m
    arm: FloatArray = np.zeros(3)
    prior = information = np.eye(3) / ARM_PRIOR_M**2
    weight = _weigh(np.linalg.norm(wanted, axis=1))
    for _ in range(_ITERATIONS):
        scaled = weight / pairs_per_independent
        information = prior + np.einsum("n,nki,nkj->ij", scaled, turned, turned)
        arm = _solve(information, np.einsum("n,nki,nk->i", scaled, turned, wanted))
        weight = _weigh(np.linalg.norm(wanted - turned @ arm, axis=1))
    return LeverArm(arm, np.sqrt(np.diag(np.linalg.inv(information))))


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
