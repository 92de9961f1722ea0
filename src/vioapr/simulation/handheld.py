"""How a person holds a phone: smooth random motion, and upright cameras that look somewhere.

The world is z up. A heading is counterclockwise from the world's x axis, seen from above.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter1d

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

LEVEL_XYZW = np.array([-0.5, 0.5, -0.5, 0.5])
"""world_from_cam of a level camera that looks along the world's x axis."""


def smooth_noise(
    rng: np.random.Generator, timestamp_s: NDArray[np.float64], width_s: float
) -> NDArray[np.float64]:
    """Noise of mean 0 and standard deviation about 1 that changes over some seconds.

    Args:
        rng: Source of randomness.
        timestamp_s: At least two, evenly spaced, shape (n,).
        width_s: Standard deviation of the Gaussian that white noise is filtered with.

    Returns:
        Shape (n,).
    """
    interval = timestamp_s[1] - timestamp_s[0]
    width = max(width_s / interval, 0.5)
    padding = int(4 * width) + 1
    white = rng.standard_normal(len(timestamp_s) + 2 * padding)
    smooth = gaussian_filter1d(white, width)[padding:-padding]
    return smooth * np.sqrt(2 * width * np.sqrt(np.pi))


def looking(
    heading_rad: NDArray[np.float64], *tilts_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The orientations, world_from_cam, of cameras that look along headings.

    Args:
        heading_rad: Shape (n,).
        tilts_rad: Rotation vectors, shape (n, 3), in axes that turn with the heading: x where
            the level camera looks, y to its left, z up. So roll is about x, and pitch about y
            is downwards. The camera is tilted by the last one first.

    Returns:
        Quaternions xyzw, shape (n, 4).
    """
    quat = LEVEL_XYZW
    for tilt_rad in reversed(tilts_rad):
        quat = quaternion.multiply(quaternion.from_rotvec(tilt_rad), quat)
    turn = quaternion.from_rotvec(np.multiply.outer(heading_rad, [0.0, 0.0, 1.0]))
    return quaternion.multiply(turn, quat)


def look_at(position_m: ArrayLike, target_m: ArrayLike) -> Rigid3:
    """world_from_cam of a camera at a point, its x axis level, that looks at another point.

    Args:
        position_m: The camera's, shape (..., 3).
        target_m: What it looks at, shape (..., 3): neither above nor below the camera.
    """
    position = np.asarray(position_m, dtype=np.float64)
    forward = np.asarray(target_m, dtype=np.float64) - position
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    matrix = np.stack([right, np.cross(forward, right), forward], axis=-1)
    return Rigid3(position, quaternion.from_matrix(matrix))
