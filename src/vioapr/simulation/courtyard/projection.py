"""Matrices between the world, the camera and what OpenGL draws.

OpenGL's first row is drawn as the picture's first: clip coordinates have y downwards, as the
camera has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.scene.frames import Intrinsics

NEAR_M, FAR_M = 0.08, 150.0
SHADOW_RADIUS_M = 27.0


def matrix_bytes(matrix: NDArray) -> bytes:
    """A matrix as OpenGL takes it: single precision, column by column."""
    return np.ascontiguousarray(matrix.T, dtype=np.float32).tobytes()


def _pinhole(camera: Intrinsics) -> list[float]:
    """Focal lengths and principal point, px."""
    return [float(np.asarray(value)) for value in camera[2:]]


def clip_from_cam(camera: Intrinsics, size_px: tuple[int, int]) -> NDArray[np.float64]:
    """The projection of a pinhole camera, 4x4."""
    width, height = size_px
    fx, fy, cx, cy = _pinhole(camera)
    depth = FAR_M - NEAR_M
    return np.array(
        [
            [2 * fx / width, 0, 2 * cx / width - 1, 0],
            [0, 2 * fy / height, 2 * cy / height - 1, 0],
            [0, 0, (FAR_M + NEAR_M) / depth, -2 * FAR_M * NEAR_M / depth],
            [0, 0, 1, 0],
        ]
    )


def ray_from_image(camera: Intrinsics, size_px: tuple[int, int]) -> NDArray[np.float64]:
    """From (u, v, 1), 0 to 1 over the picture, to a ray in cam, 3x3."""
    width, height = size_px
    fx, fy, cx, cy = _pinhole(camera)
    return np.array(
        [
            [width / fx, 0, -cx / fx],
            [0, height / fy, -cy / fy],
            [0, 0, 1],
        ]
    )


def sun_clip_from_world(
    direction: NDArray[np.float64], radius_m: float = SHADOW_RADIUS_M
) -> NDArray[np.float64]:
    """A parallel projection along the light's rays, of all within a radius of the origin, 4x4."""
    forward = -direction / np.linalg.norm(direction)
    helper = np.array([1.0, 0, 0]) if abs(forward[2]) > 0.9 else np.array([0, 0, 1.0])
    right = np.cross(forward, helper)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(right, forward), forward]) / radius_m
    return matrix
