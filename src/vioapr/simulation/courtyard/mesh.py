"""Triangle meshes with what the shaders need at every vertex, and the shapes to build them of.

World coordinates: metres, z up. Texture coordinates are metres too, from a surface's lower
left corner: a material says how many metres its picture covers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.geometry.vectors import distance_along_m

Floats = NDArray[np.float32]

ATTRIBUTES = (
    ("position_m", 3),
    ("normal", 3),
    ("uv_m", 2),
    ("tint", 3),
    ("sky", 1),
    ("lamp", 1),
    ("glow", 1),
    ("gloss", 1),
)
"""Of a vertex, with their numbers of components."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one material.

    Attributes:
        position_m: Shape (n, 3), world.
        normal: Unit, outwards, (n, 3).
        uv_m: Texture coordinates, (n, 2).
        tint: Factor of the texture's colour, (n, 3).
        sky: Share of the sky's light that arrives, (n, 1); 1 until it is baked.
        lamp: Light of the street lamps that arrives, (n, 1); 0 until it is baked.
        glow: Light that the surface gives off itself at dusk, (n, 1).
        gloss: How much it mirrors the sky, (n, 1).
        triangles: Rows of the above, counterclockwise seen from outside, (m, 3).
    """

    position_m: Floats
    normal: Floats
    uv_m: Floats
    tint: Floats
    sky: Floats
    lamp: Floats
    glow: Floats
    gloss: Floats
    triangles: NDArray[np.int32]

    @staticmethod
    def build(
        position_m: ArrayLike,
        normal: ArrayLike,
        uv_m: ArrayLike,
        triangles: ArrayLike,
        *,
        tint: ArrayLike = (1.0, 1.0, 1.0),
        glow: float = 0.0,
        gloss: float = 0.0,
    ) -> Mesh:
        """From arrays; what is the same for all vertices may be given once."""
        position = np.asarray(position_m, dtype=np.float32)
        column = np.ones((len(position), 1), dtype=np.float32)
        return Mesh(
            position,
            np.broadcast_to(np.asarray(normal, np.float32), position.shape),
            np.asarray(uv_m, dtype=np.float32),
            np.broadcast_to(np.asarray(tint, np.float32), position.shape),
            column,
            0 * column,
            glow * column,
            gloss * column,
            np.asarray(triangles, dtype=np.int32),
        )

    def __len__(self) -> int:
        return len(self.position_m)

    def vertex_array(self) -> Floats:
        """All attributes side by side in the order of `ATTRIBUTES`, (n, 15)."""
        parts = [getattr(self, name) for name, _ in ATTRIBUTES]
        return np.ascontiguousarray(np.concatenate(parts, axis=1), dtype=np.float32)

    def moved(self, offset_m: ArrayLike = (0, 0, 0), yaw_deg: float = 0.0) -> Mesh:
        """Turned about the vertical axis through the origin, then shifted."""
        cos, sin = np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], dtype=np.float32)
        offset = np.asarray(offset_m, dtype=np.float32)
        return replace(
            self, position_m=self.position_m @ turn.T + offset, normal=self.normal @ turn.T
        )

    def tinted(self, tint: ArrayLike) -> Mesh:
        """With every colour multiplied."""
        return replace(self, tint=(self.tint * np.asarray(tint, np.float32)).astype(np.float32))


Parts = list[tuple[str, Mesh]]
"""Meshes, each with the name of its material."""


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of several."""
    starts = np.cumsum([0, *(len(mesh) for mesh in meshes)])
    columns = {
        name: np.concatenate([getattr(mesh, name) for mesh in meshes]) for name, _ in ATTRIBUTES
    }
    triangles = [m.triangles + start for m, start in zip(meshes, starts, strict=False)]
    return Mesh(**columns, triangles=np.concatenate(triangles).astype(np.int32))


def patch(
    corner_m: ArrayLike,
    along_m: ArrayLike,
    up_m: ArrayLike,
    *,
    uv_m: tuple[float, float] = (0.0, 0.0),
    cell_m: float = 1.5,
    **look: Any,
) -> Mesh:
    """A parallelogram, cut into cells so that light can differ along it.

    Args:
        corner_m: Its lower left corner, seen from outside.
        along_m: From there to the lower right corner.
        up_m: From there to the upper left corner.
        uv_m: Texture coordinates of the corner.
        cell_m: Largest side of a cell.
        look: tint, glow, gloss, as for `Mesh.build`.
    """
    corner, along, up = (np.asarray(v, dtype=np.float64) for v in (corner_m, along_m, up_m))
    width, height = np.linalg.norm(along), np.linalg.norm(up)
    columns, rows = (max(1, int(np.ceil(length / cell_m))) for length in (width, height))
    s, t = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    s, t = s.reshape(-1, 1), t.reshape(-1, 1)
    normal = np.cross(along, up)
    return Mesh.build(
        corner + s * along + t * up,
        normal / np.linalg.norm(normal),
        np.concatenate([uv_m[0] + s * width, uv_m[1] + t * height], axis=1),
        _grid_triangles(rows, columns),
        **look,
    )


def box(
    low_m: ArrayLike,
    high_m: ArrayLike,
    *,
    faces: str = "nsewt",
    cell_m: float = 1.5,
    **look: Any,
) -> Mesh:
    """An upright box, its faces chosen by letter: +y, -y, +x, -x (n s e w), top, bottom (t b)."""
    (x0, y0, z0), (x1, y1, z1) = (np.asarray(v, dtype=float) for v in (low_m, high_m))
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    sides = {
        "s": ((x0, y0, z0), (dx, 0, 0), (0, 0, dz), (x0, z0)),
        "n": ((x1, y1, z0), (-dx, 0, 0), (0, 0, dz), (-x1, z0)),
        "e": ((x1, y0, z0), (0, dy, 0), (0, 0, dz), (y0, z0)),
        "w": ((x0, y1, z0), (0, -dy, 0), (0, 0, dz), (-y1, z0)),
        "t": ((x0, y0, z1), (dx, 0, 0), (0, dy, 0), (x0, y0)),
        "b": ((x0, y1, z0), (dx, 0, 0), (0, -dy, 0), (x0, -y1)),
    }
    return join([patch(*sides[f][:3], uv_m=sides[f][3], cell_m=cell_m, **look) for f in faces])


def lathe(
    profile_m: Sequence[tuple[float, float]],
    *,
    sides: int = 12,
    centre_m: ArrayLike = (0, 0, 0),
    flatten: float = 1.0,
    smooth: bool = True,
    **look: Any,
) -> Mesh:
    """A surface turned about a vertical axis.

    Args:
        profile_m: Radius and height from the bottom to the top, m.
        sides: Of the polygon that stands for a circle.
        centre_m: Of its base.
        flatten: Factor of its depth along y.
        smooth: Round, or with edges between the sides, as a hexagonal pillar has them.
        look: As for `Mesh.build`.
    """
    profile = np.asarray(profile_m, dtype=np.float64)
    edges = np.arange(sides + 1) if smooth else np.repeat(np.arange(sides + 1), 2)[1:-1]
    angle = 2 * np.pi * edges / sides
    slope = np.gradient(profile, axis=0)
    out = np.stack([slope[:, 1], -slope[:, 0]], axis=-1)
    out /= np.linalg.norm(out, axis=1, keepdims=True) + 1e-12
    facing = angle if smooth else 2 * np.pi * (np.arange(len(edges)) // 2 + 0.5) / sides
    ring = np.stack([np.cos(angle), flatten * np.sin(angle)], axis=-1)
    face = np.stack([np.cos(facing), np.sin(facing) / flatten], axis=-1)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    position = np.concatenate(
        [profile[:, None, :1] * ring, np.tile(profile[:, None, 1:], (1, len(ring), 1))], axis=-1
    )
    normal = np.concatenate(
        [out[:, None, :1] * face, np.tile(out[:, None, 1:], (1, len(ring), 1))], axis=-1
    )
    u, v = np.meshgrid(angle * profile[:, 0].max(), distance_along_m(profile))
    return Mesh.build(
        position.reshape(-1, 3) + np.asarray(centre_m),
        normal.reshape(-1, 3),
        np.stack([u.ravel(), v.ravel()], axis=-1),
        _grid_triangles(len(profile) - 1, len(ring) - 1),
        **look,
    )


def rod(
    start_m: ArrayLike,
    end_m: ArrayLike,
    radii_m: tuple[float, float],
    *,
    sides: int = 6,
    **look: Any,
) -> Mesh:
    """A round bar or branch from one point to another, radii at its start and end."""
    start, end = np.asarray(start_m, float), np.asarray(end_m, float)
    axis = end - start
    length = float(np.linalg.norm(axis))
    upright = lathe([(radii_m[0], 0), (radii_m[1], length)], sides=sides, **look)
    helper = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.8 * length else np.array([0, 1.0, 0])
    x = np.cross(helper, axis / length)
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(axis / length, x), axis / length], axis=-1).astype(np.float32)
    return replace(
        upright,
        position_m=(upright.position_m @ turn.T + start).astype(np.float32),
        normal=upright.normal @ turn.T,
    )


def cards(
    centres_m: NDArray,
    normals: NDArray,
    sizes_m: NDArray,
    spins_rad: NDArray,
    tints: NDArray,
    picture_m: float,
) -> Mesh:
    """Square cards that each show a whole picture: clusters of leaves.

    Args:
        centres_m: Shape (n, 3).
        normals: Unit, how they face, (n, 3).
        sizes_m: Side, (n,).
        spins_rad: Turn within their plane, (n,).
        tints: (n, 3).
        picture_m: Metres that the material's picture covers.
    """
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, [0.0, 0, 1], [1.0, 0, 0])
    x = np.cross(helper, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(normals, x)
    cos, sin = np.cos(spins_rad)[:, None], np.sin(spins_rad)[:, None]
    x, y = cos * x + sin * y, cos * y - sin * x
    unit = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    corners = unit[None, :, :1] * x[:, None] + unit[None, :, 1:] * y[:, None]
    position = centres_m[:, None] + sizes_m[:, None, None] * corners
    count = len(centres_m)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(count)[:, None, None]
    return Mesh.build(
        position.reshape(-1, 3),
        np.repeat(normals, 4, axis=0),
        np.tile((unit + 0.5) * picture_m, (count, 1)),
        triangles.reshape(-1, 3),
        tint=np.repeat(tints, 4, axis=0),
    )


def _grid_triangles(rows: int, columns: int) -> NDArray[np.int32]:
    """Two triangles a cell of a grid of (rows + 1) x (columns + 1) vertices, row by row."""
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    right, above = first + 1, first + columns + 1
    lower = np.concatenate([first, right, above + 1], axis=1)
    upper = np.concatenate([first, above + 1, above], axis=1)
    return np.concatenate([lower, upper], axis=1).reshape(-1, 3).astype(np.int32)
