"""Light that does not change with the sun: how much of the sky each vertex sees, and lamps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vioapr.simulation.courtyard.mesh import Mesh
from vioapr.simulation.courtyard.projection import sun_clip_from_world
from vioapr.simulation.courtyard.world import World

_DIRECTIONS = 56
_DEPTH_MAP_PX = 768
_RADIUS_M = 42.0
_OFFSET_M = 0.06

DepthMap = Callable[[NDArray, int], NDArray]


def bake_light(world: World, depth_map: DepthMap) -> dict[str, Mesh]:
    """The world's meshes with their light from the sky and from lamps.

    The sky is a number of directions, each of which looks at the world like a sun: a vertex
    sees it unless something is nearer.

    Args:
        world: Its meshes have no light yet.
        depth_map: Draws depths, 0 to 1, as seen along a parallel projection (4x4) in a square
            picture whose side has a number of pixels.
    """
    names = list(world.meshes)
    meshes = [world.meshes[name] for name in names]
    position = np.concatenate([mesh.position_m for mesh in meshes]).astype(np.float64)
    normal = np.concatenate([mesh.normal for mesh in meshes]).astype(np.float64)
    is_leaf = np.concatenate(
        [np.full(len(world.meshes[name]), world.materials[name].is_cutout) for name in names]
    )
    sky, directions = np.zeros(len(position)), sky_directions()
    start = position + _OFFSET_M * normal
    for direction in directions:
        matrix = sun_clip_from_world(direction, _RADIUS_M)
        depths = depth_map(matrix, _DEPTH_MAP_PX)
        clip = start @ matrix[:3, :3].T
        pixel = ((clip[:, :2] * 0.5 + 0.5) * _DEPTH_MAP_PX).astype(int)
        pixel = pixel.clip(0, _DEPTH_MAP_PX - 1)
        is_open = clip[:, 2] * 0.5 + 0.5 <= depths[pixel[:, 1], pixel[:, 0]] + 0.0012
        # Leaves scatter light from every side.
        sky += is_open * np.where(is_leaf, 0.45, np.maximum(normal @ direction, 0))
    sky /= directions[:, 2].sum()  # level ground in the open has 1
    lamp = lamp_light(position, normal, world.lamps_m)
    starts = np.cumsum([0, *(len(mesh) for mesh in meshes)])
    return {
        name: replace(
            mesh,
            sky=sky[a:b, None].astype(np.float32),
            lamp=lamp[a:b, None].astype(np.float32),
        )
        for name, mesh, a, b in zip(names, meshes, starts, starts[1:], strict=False)
    }


def sky_directions(count: int = _DIRECTIONS) -> NDArray[np.float64]:
    """Directions spread evenly over the upper half of the sphere, (count, 3)."""
    number = np.arange(count) + 0.5
    up = number / count
    angle = np.pi * (1 + 5**0.5) * number
    level = np.sqrt(1 - up**2)
    return np.stack([level * np.cos(angle), level * np.sin(angle), up], axis=-1)


def lamp_light(position_m: NDArray, normal: NDArray, lamps_m: NDArray) -> NDArray[np.float64]:
    """Light of all lamps by distance and slant; nothing throws a shadow.

    Args:
        position_m: Of points on surfaces, shape (n, 3).
        normal: Unit, shape (n, 3).
        lamps_m: Shape (k, 3).

    Returns:
        Shape (n,).
    """
    total = np.zeros(len(position_m))
    for lamp in lamps_m:
        to_lamp = lamp - position_m
        distance = np.linalg.norm(to_lamp, axis=1)
        slant = np.clip((normal * to_lamp).sum(axis=1) / distance, 0.05, 1)
        total += 4.5 * slant / (distance**2 + 1.0)
    return total
