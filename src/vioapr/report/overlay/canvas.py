"""A canvas with a depth buffer: triangles in camera coordinates, seen by a pinhole camera.

Plain NumPy, as a report must not need a graphics card. Triangles are clipped at a plane before the
camera, and the nearest surface is seen at every pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR_M = 0.05
"""What is closer to the camera is cut away: at the camera's plane projections are infinite."""
_OVERSAMPLING = 2
"""Samples a pixel along each axis, so that edges are smooth."""


class Pinhole(NamedTuple):
    """A camera without distortion; see `scene.frames.Intrinsics`.

    Attributes:
        width: Pixels.
        height: Pixels.
        fx: Focal length along the width, pixels.
        fy: Along the height.
        cx: Principal point from the left edge, pixels.
        cy: From the top edge.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def resized(self, width: int) -> Pinhole:
        """The camera of the picture resized to another width, in pixels."""
        scale = width / self.width
        focal_and_center = (value * scale for value in (self.fx, self.fy, self.cx, self.cy))
        return Pinhole(width, max(round(self.height * scale), 1), *focal_and_center)

    def project(self, points_m: Array) -> Array:
        """Pixels of points in front of the camera, shapes (..., 3) to (..., 2)."""
        x, y, z = points_m[..., 0], points_m[..., 1], points_m[..., 2]
        return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], axis=-1)

    def sees(self, points_m: Array, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether points in camera coordinates are in the picture, shapes (..., 3) to (...).

        Args:
            points_m: In camera coordinates, m.
            margin: Share of the width and height at every edge that does not count.
        """
        in_front = points_m[..., 2] > NEAR_M
        with np.errstate(divide="ignore", invalid="ignore"):
            share = self.project(points_m) / (self.width, self.height)
        return in_front & ((share > margin) & (share < 1 - margin)).all(axis=-1)


class Layer(NamedTuple):
    """What was drawn, to be put over a picture.

    Attributes:
        rgb: Colours times `alpha`, shape (height, width, 3), 0 to 1.
        alpha: Opacity, shape (height, width), 0 to 1.
        covered: Share of each pixel that solid surfaces cover, shape (height, width).
    """

    rgb: Array
    alpha: Array
    covered: Array

    def over(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Put the layer over a picture of the same size."""
        mixed = self.rgb * 255 + picture * (1 - self.alpha[..., None])
        return np.clip(np.round(mixed), 0, 255).astype(np.uint8)


class Cover(NamedTuple):
    """The samples at which a triangle is seen.

    Attributes:
        window: Rows and columns of the canvas.
        is_seen: Whether a sample in it sees the triangle.
        depth_m: Of the triangle's plane at the samples.
        values: The corners' values, interpolated in space, with a last axis.
    """

    window: tuple[slice, slice]
    is_seen: NDArray[np.bool_]
    depth_m: Array
    values: Array


class Canvas:
    """Draws triangles; see the module."""

    def __init__(self, camera: Pinhole) -> None:
        """Begin with nothing, as the camera sees it."""
        width = camera.width * _OVERSAMPLING
        self._camera = camera.resized(width)._replace(height=camera.height * _OVERSAMPLING)
        shape = self._camera.height, self._camera.width
        self._rgb = np.zeros((*shape, 3))
        self._alpha = np.zeros(shape)
        self._depth_m = np.full(shape, np.inf)

    def draw(self, triangles_m: Array, colors: Array) -> None:
        """Draw solid triangles: the nearest at each pixel is seen, whatever the order.

        Args:
            triangles_m: Corners in camera coordinates, shape (n, 3, 3), m.
            colors: Of the corners, shape (n, 3, 3), RGB, 0 to 1.
        """
        for window, is_seen, depth_m, rgb in self._cover(triangles_m, colors):
            self._depth_m[window][is_seen] = depth_m[is_seen]
            self._rgb[window][is_seen] = rgb[is_seen]
            self._alpha[window][is_seen] = 1.0

    def shade(self, triangles_m: Array, alphas: Array) -> None:
        """Darken through triangles, e.g. by a shadow on the ground; after what is solid.

        Args:
            triangles_m: Corners in camera coordinates, shape (n, 3, 3), m; they must not overlap.
            alphas: How much of the light the corners take away, shape (n, 3), 0 to 1.
        """
        for window, is_seen, _, values in self._cover(triangles_m, alphas[..., None]):
            alpha = np.where(is_seen, values[..., 0], 0.0)
            self._rgb[window] *= 1 - alpha[..., None]
            self._alpha[window] = alpha + self._alpha[window] * (1 - alpha)

    def _cover(self, triangles_m: Array, values: Array) -> Iterator[Cover]:
        """Find the samples at which each triangle is the nearest surface so far, in order."""
        corners_m, values = clip_at_near(triangles_m, values)
        size = self._camera.width, self._camera.height
        xy = self._camera.project(corners_m)
        first = np.clip(np.floor(xy.min(axis=1)), 0, size).astype(int)
        last = np.clip(np.ceil(xy.max(axis=1)), 0, size).astype(int)
        (ax, ay), (bx, by), (cx, cy) = xy.transpose(1, 2, 0)
        areas = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        for k in np.flatnonzero((first < last).all(axis=1) & (areas != 0)):
            (u0, v0), (u1, v1) = first[k], last[k]
            u, v = np.arange(u0, u1) + 0.5 - ax[k], (np.arange(v0, v1) + 0.5)[:, None] - ay[k]
            weight_b = (u * (cy[k] - ay[k]) - v * (cx[k] - ax[k])) / areas[k]
            weight_c = (v * (bx[k] - ax[k]) - u * (by[k] - ay[k])) / areas[k]
            weights = np.stack([1 - weight_b - weight_c, weight_b, weight_c], axis=-1)
            # Of what is straight in space, values over the depth are straight in the picture.
            shares = weights / corners_m[k, :, 2]
            over_depth = shares.sum(axis=-1)
            window = slice(v0, v1), slice(u0, u1)
            with np.errstate(divide="ignore", invalid="ignore"):
                depth_m = 1 / over_depth
                is_seen = (weights >= 0).all(axis=-1) & (depth_m < self._depth_m[window])
                if is_seen.any():
                    interpolated = (shares * depth_m[..., None]) @ values[k]
                    yield Cover(window, is_seen, depth_m, interpolated)

    def finish(self) -> Layer:
        """Average the samples of each pixel."""
        return Layer(*map(_average, (self._rgb, self._alpha, np.isfinite(self._depth_m) * 1.0)))


def _average(samples: Array) -> Array:
    height, width = (size // _OVERSAMPLING for size in samples.shape[:2])
    shape = height, _OVERSAMPLING, width, _OVERSAMPLING, *samples.shape[2:]
    return samples.reshape(shape).mean(axis=(1, 3))


def clip_at_near(triangles_m: Array, values: Array) -> tuple[Array, Array]:
    """Cut away what of triangles is nearer than `NEAR_M`.

    Args:
        triangles_m: Corners in camera coordinates, shape (n, 3, 3).
        values: Of the corners, shape (n, 3, k); interpolated at new corners.

    Returns:
        Triangles and values of the same shapes, of another number.
    """
    is_inside = triangles_m[..., 2] >= NEAR_M
    counts = is_inside.sum(axis=1)
    kept = [triangles_m[counts == 3]], [values[counts == 3]]
    for row in np.flatnonzero((counts == 1) | (counts == 2)):
        corners = np.concatenate([triangles_m[row], values[row]], axis=1)
        polygon: list[Array] = []
        for k in range(3):
            here, after = corners[k], corners[(k + 1) % 3]
            if is_inside[row, k]:
                polygon.append(here)
            if is_inside[row, k] != is_inside[row, (k + 1) % 3]:
                polygon.append(here + (NEAR_M - here[2]) / (after[2] - here[2]) * (after - here))
        fan = np.array([[polygon[0], *polygon[k : k + 2]] for k in range(1, len(polygon) - 1)])
        kept[0].append(fan[..., :3])
        kept[1].append(fan[..., 3:])
    return np.concatenate(kept[0]), np.concatenate(kept[1])
