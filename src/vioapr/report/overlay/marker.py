"""The marker that stands for content: a pin whose tip is at its place, an arrow that is its front.

In the frame of an anchor (z up, x the front) and of height 1; an anchor gives place and size.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry.rigid import Rigid3
from vioapr.report.overlay.canvas import Array, Canvas
from vioapr.schemas.anchors import Anchor

_SIDES = 22
_HEAD_RADIUS, _BALL_RADIUS = 0.27, 0.115
_RING = 0.30, 0.36
"""Inner and outer radius of the ring on the ground."""
_ARROW_TIP, _ARROW_HALF_WIDTH = 0.56, 0.13
_SHADOW_RADIUS, _SHADOW_ALPHA = 0.30, 0.55
_LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
"""Where light comes from, in the world: content is lit alike in all pictures."""
_AMBIENT = 0.55
"""Brightness of what faces away from the light."""
_WHITE = np.array([1.0, 1.0, 1.0])


class Mesh(NamedTuple):
    """Triangles of one colour.

    Attributes:
        corners_m: Shape (n, 3, 3).
        normals: Of the corners, unit, shape (n, 3, 3).
        is_white: Whether it is white instead of the marker's colour.
        is_closed: Whether it has no back sides to be seen.
    """

    corners_m: Array
    normals: Array
    is_white: bool
    is_closed: bool


def draw_marker(
    canvas: Canvas, cam_from_world: Rigid3[Array], anchor: Anchor, color: Array
) -> None:
    """Draw the solid parts of an anchor's marker.

    Args:
        canvas: To draw on.
        cam_from_world: Of the camera.
        anchor: The content.
        color: RGB, 0 to 1.
    """
    world_from_anchor, camera_m = pose_of(anchor), cam_from_world.inverse().translation_m
    for mesh in _meshes():
        turned = Rigid3(np.zeros(3), world_from_anchor.quat_xyzw).apply(mesh.normals)
        light = _AMBIENT + (1 - _AMBIENT) * (turned @ _LIGHT + 1) / 2
        colors = light[..., None] * (_WHITE if mesh.is_white else color)
        corners_m = world_from_anchor.apply(mesh.corners_m * anchor.size_m)
        if mesh.is_closed:
            rays = corners_m - camera_m
            is_front = ((rays * turned).sum(axis=-1) < 0).any(axis=1)
            corners_m, colors = corners_m[is_front], colors[is_front]
        canvas.draw(cam_from_world.apply(corners_m), colors)


def draw_shadow(canvas: Canvas, cam_from_world: Rigid3[Array], anchor: Anchor) -> None:
    """Darken the ground below an anchor's marker, which shows that it stands there."""
    angles = np.linspace(0, 2 * np.pi, _SIDES + 1)
    edge_m = _SHADOW_RADIUS * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    fan_m = np.stack([np.zeros_like(edge_m[1:]), edge_m[:-1], edge_m[1:]], axis=1)
    alphas = np.tile([_SHADOW_ALPHA, 0.0, 0.0], (_SIDES, 1))
    world_m = pose_of(anchor).apply(fan_m * anchor.size_m)
    canvas.shade(cam_from_world.apply(world_m), alphas)


def pose_of(anchor: Anchor) -> Rigid3[Array]:
    """world_from_anchor."""
    quat_xyzw = np.array(anchor.quat_xyzw)
    return Rigid3(np.array(anchor.position_m), quat_xyzw / np.linalg.norm(quat_xyzw))


@cache
def _meshes() -> tuple[Mesh, ...]:
    flat = _ring(), _arrow()
    ground = np.concatenate(flat)
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), ground.shape)
    radii, heights = _pin_outline()
    pin = _turned(radii, heights, white=False)
    polar = np.linspace(-np.pi / 2, np.pi / 2, 7)
    # A white ball at the front of the head, half sunk into it: an eye.
    center = np.array([_HEAD_RADIUS * 0.86, 0.0, 1 - _HEAD_RADIUS])
    ball = _turned(_BALL_RADIUS * np.cos(polar), _BALL_RADIUS * np.sin(polar), white=True)
    eye = ball._replace(corners_m=ball.corners_m + center)
    return pin, eye, Mesh(ground, up, False, False)


def _pin_outline() -> tuple[Array, Array]:
    """Radii and heights of a map pin: a cone from the tip that touches a ball."""
    center = 1 - _HEAD_RADIUS
    tangent = np.arcsin(_HEAD_RADIUS / center)  # half the cone's angle at the tip
    polar = np.linspace(-tangent, np.pi / 2, 10)
    radii = np.concatenate([[0.0], _HEAD_RADIUS * np.cos(polar)])
    return radii, np.concatenate([[0.0], center + _HEAD_RADIUS * np.sin(polar)])


def _turned(radii: Array, heights: Array, *, white: bool) -> Mesh:
    """Turn an outline about the z axis, with smooth normals around and along it."""
    angles = np.linspace(0, 2 * np.pi, _SIDES + 1)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points = np.concatenate(
        [
            radii[:, None, None] * around,
            np.broadcast_to(heights[:, None, None], (len(radii), _SIDES + 1, 1)),
        ],
        axis=-1,
    )
    slopes = np.gradient(np.stack([radii, heights], axis=-1), axis=0)
    slopes /= np.linalg.norm(slopes, axis=1, keepdims=True)
    outward = slopes[:, 1, None, None] * around
    upward = np.broadcast_to(-slopes[:, 0, None, None], (*outward.shape[:2], 1))
    normals = np.concatenate([outward, upward], axis=-1)
    return Mesh(_triangles(points), _triangles(normals), white, True)


def _triangles(grid: Array) -> NDArray[np.float64]:
    """Two triangles for every cell of a grid of points, shape (rows, columns, 3)."""
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    both = np.stack([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)])
    return both.reshape(-1, 3, 3)


def _ring() -> Array:
    angles = np.linspace(0, 2 * np.pi, _SIDES + 1)
    circle = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    return _triangles(np.stack([radius * circle for radius in _RING]))


def _arrow() -> Array:
    x, y = _RING[1] - 0.02, _ARROW_HALF_WIDTH
    return np.array([[[x, -y, 0.0], [_ARROW_TIP, 0.0, 0.0], [x, y, 0.0]]])
