"""How exact a pose by points is: what its features say, and what the map adds.

Features are not exact: their errors, as their residuals show them, carry over to the pose by the
normal equations. What many features average out is then small, but points and the poses that they
come from are not exact either, and all features of an image share that. So a constant of the map
is added, found by localizing the map's own images, each without itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

CHI2_MEDIAN, CHI2_P95 = 2.366, 7.815
"""Of the squared length of a vector of three normal numbers: its median, and its 95 % quantile."""

ROBUST = 1.4826
"""Standard deviation over the median absolute value, of normal numbers."""


class PoseSigmas(NamedTuple):
    """Standard deviations an axis of one pose.

    Attributes:
        position_m: m.
        orientation_deg: Degrees.
    """

    position_m: float
    orientation_deg: float

    def and_of_map(self, other: PoseSigmas) -> PoseSigmas:
        """Of the sum of two independent errors."""
        return PoseSigmas(*(float(np.hypot(*both)) for both in zip(self, other, strict=True)))


def sigmas_of_pnp(
    world_from_cam: Rigid3,
    world_m: NDArray[np.float64],
    residual_px: NDArray[np.float64],
    focal_px: float,
) -> PoseSigmas:
    """Standard deviations of a pose by the residuals of its inliers.

    Args:
        world_from_cam: The pose.
        world_m: Points of the inliers, shape (n, 3).
        residual_px: Theirs, shape (n, 2).
        focal_px: Focal length; distortion does not matter here.
    """
    cam = world_from_cam.inverse().apply(world_m)
    x, y, z = cam.T
    zero, per_z = np.zeros_like(z), focal_px / z
    # Of pixels by the point in the camera's axes, (n, 2, 3).
    by_point = np.stack(
        [
            np.stack([per_z, zero, -per_z * x / z], axis=-1),
            np.stack([zero, per_z, -per_z * y / z], axis=-1),
        ],
        axis=1,
    )
    turned = np.stack(
        [
            np.stack([zero, -z, y], axis=-1),
            np.stack([z, zero, -x], axis=-1),
            np.stack([-y, x, zero], axis=-1),
        ],
        axis=1,
    )
    # Moving the camera moves points the other way; turning it by v turns them by -v.
    by_pose = np.concatenate([-by_point, by_point @ turned], axis=-1).reshape(-1, 6)
    sigma_px = ROBUST * float(np.median(np.abs(residual_px)))
    covariance = np.linalg.pinv(by_pose.T @ by_pose) * sigma_px**2
    variance = np.maximum(np.diag(covariance), 0.0)
    return PoseSigmas(
        float(np.sqrt(variance[:3].mean())),
        float(np.degrees(np.sqrt(variance[3:].mean()))),
    )


def sigma_of_map(error: NDArray[np.float64], sigma: NDArray[np.float64]) -> float:
    """Find what must be added to standard deviations for errors to be as they say.

    Both the typical error and the tail must be: the larger of what the median and the 95 %
    quantile ask for is taken.

    Args:
        error: Lengths of the errors' vectors, shape (n,).
        sigma: Stated standard deviations an axis, shape (n,).

    Returns:
        A standard deviation an axis, of an independent error; 0 where none is needed.
    """
    asked = [
        _added_variance(error, sigma, quantile, target)
        for quantile, target in ((0.5, CHI2_MEDIAN), (0.95, CHI2_P95))
    ]
    return float(np.sqrt(max(asked)))


def _added_variance(
    error: NDArray[np.float64], sigma: NDArray[np.float64], quantile: float, target: float
) -> float:
    """The variance that brings a quantile of the squared errors, by sigma, to the target."""

    def ratio(added: float) -> float:
        squared = error**2 / np.maximum(sigma**2 + added, 1e-30)
        return float(np.quantile(squared, quantile))

    low, high = 0.0, float(np.max(error**2)) / target
    if ratio(low) <= target:
        return 0.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if ratio(middle) > target else (low, middle)
    return high


def error_of(found: Rigid3, true: Rigid3) -> tuple[float, float]:
    """Distance, m, and angle, degrees, between two poses."""
    return (
        float(np.linalg.norm(found.translation_m - true.translation_m)),
        float(quaternion.angle_between_deg(found.quat_xyzw, true.quat_xyzw)),
    )
