"""Facades: a wall with openings, its picture and what hangs on it.

A facade stands in coordinates of its own: x from its left edge to its right, seen from the
yard, y into the building, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vioapr.simulation.courtyard import openings as painting
from vioapr.simulation.courtyard.mesh import Mesh, box, join, patch
from vioapr.simulation.courtyard.noise import Field, coordinates_m, fractal, mix, step
from vioapr.simulation.courtyard.openings import Opening

_LENT_M = 0.6
"""Width of plain wall beside every opening, with which its reveals are covered."""


@dataclass(frozen=True, eq=False)
class Facade:
    """A wall.

    Attributes:
        picture: Of the wall with its openings, (h, w, 3), 0 to 1, px_per_m pixels a metre.
        mesh: The wall, its reveals and panes, with the picture as its material.
        openings: Its holes.
    """

    picture: Field
    mesh: Mesh
    openings: tuple[Opening, ...]


def build(
    rng: np.random.Generator, wall: Field, openings: list[Opening], px_per_m: float
) -> Facade:
    """Cut openings into a wall.

    Args:
        rng: Source of randomness.
        wall: Its picture without openings, which is painted over.
        openings: That do not overlap.
        px_per_m: Density of the picture.
    """
    stain(rng, wall, openings, px_per_m)
    for opening in openings:
        painting.paint(rng, wall, opening, px_per_m)
    size = (wall.shape[1] / px_per_m, wall.shape[0] / px_per_m)
    parts = [wall_mesh(size, openings), *(opening_mesh(rng, opening) for opening in openings)]
    return Facade(wall, join(parts), tuple(openings))


def row(
    first_m: float,
    spacing_m: float,
    count: int,
    bottom_m: float,
    like: Opening,
    without: tuple[int, ...] = (),
) -> list[Opening]:
    """Equal openings side by side, the first one's middle at `first_m`; some may be left out."""
    return [
        replace(like, left_m=first_m + spacing_m * i - like.width_m / 2, bottom_m=bottom_m)
        for i in range(count)
        if i not in without
    ]


def sills(openings: tuple[Opening, ...]) -> Mesh:
    """A stone sill under every window, in the facade's coordinates."""
    return join(
        [
            box(
                (o.left_m - 0.08, -0.12, o.bottom_m - 0.1),
                (o.left_m + o.width_m + 0.08, 0.0, o.bottom_m),
                faces="sewtb",
            )
            for o in openings
            if o.kind in ("window", "shop")
        ]
    )


def lintels(openings: tuple[Opening, ...], height_m: float = 0.24) -> Mesh:
    """A flat stone over every window and door."""
    return join(
        [
            box(
                (o.left_m - 0.1, -0.04, o.bottom_m + o.height_m),
                (o.left_m + o.width_m + 0.1, 0.0, o.bottom_m + o.height_m + height_m),
                faces="sewtb",
            )
            for o in openings
            if not o.arched
        ]
    )


def shutters(openings: tuple[Opening, ...], keep: list[bool]) -> Mesh:
    """Pairs of louvred shutters, opened flat against the wall."""
    parts = []
    for opening, is_kept in zip(openings, keep, strict=True):
        width, low = opening.width_m / 2, opening.bottom_m
        for left in (opening.left_m - width - 0.03, opening.left_m + opening.width_m + 0.03):
            if is_kept:
                parts.append(
                    box(
                        (left, -0.06, low),
                        (left + width, 0.0, low + opening.height_m),
                        faces="sewtb",
                    )
                )
    return join(parts)


def stain(rng: np.random.Generator, wall: Field, openings: list[Opening], px_per_m: float) -> None:
    """Paint splashes along the ground, soot under the eaves and runs under the sills, in place.

    Args:
        rng: Source of randomness.
        wall: Its picture, (h, w, 3).
        openings: Rain runs from the sills of windows.
        px_per_m: Density of the picture.
    """
    shape = wall.shape[:2]
    x, y = coordinates_m(shape, px_per_m)
    noise = fractal(rng, shape, slope=1.2)
    runs = fractal(rng, shape, slope=0.8, stretch=14, coarsest_px=px_per_m)
    splashes = step(y + 0.22 * noise, 0.75, 0.0)
    soot = step(y + 0.3 * noise, y.max() - 1.1, y.max())
    dark = 0.42 * splashes + 0.3 * soot
    for o in openings:
        if o.kind == "window":
            below = Opening(o.left_m - 0.3, o.bottom_m - 1.5, o.width_m + 0.6, 1.5)
            rows, columns = below.rows_and_columns(shape[0], px_per_m)
            # Most of the rain runs from a sill's ends, less and less downwards.
            along, down = x[:, columns] - o.left_m, (o.bottom_m - y[rows]) / 1.5
            ends = np.exp(-np.square(along / 0.1)) + np.exp(-np.square((along - o.width_m) / 0.1))
            middle = 0.35 * ((along > 0) & (along < o.width_m))
            run = np.clip(1 - down, 0, 1) * (ends + middle)
            wet = np.clip(0.5 + 0.6 * runs[rows, columns], 0, 1.5)
            dark[rows, columns] += rng.uniform(0.1, 0.5) * run * wet
    wall[:] = mix(wall, wall * np.array([0.42, 0.4, 0.37]), np.clip(dark, 0, 0.85))


def wall_mesh(size_m: tuple[float, float], openings: list[Opening]) -> Mesh:
    """The wall around its openings, cut at all their edges so that no vertex lies on an edge."""
    xs, zs = {0.0, size_m[0]}, {0.0, size_m[1]}
    for o in openings:
        xs |= {o.left_m, o.left_m + o.width_m}
        zs |= {o.bottom_m, o.bottom_m + o.height_m}
    cells = []
    for x0, x1 in pairwise(sorted({round(x, 4) for x in xs})):
        for z0, z1 in pairwise(sorted({round(z, 4) for z in zs})):
            x, z = (x0 + x1) / 2, (z0 + z1) / 2
            if not any(
                o.left_m < x < o.left_m + o.width_m and o.bottom_m < z < o.bottom_m + o.height_m
                for o in openings
            ):
                cells.append(
                    patch((x0, 0, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), uv_m=(x0, z0), cell_m=2.5)
                )
    return join(cells)


def opening_mesh(rng: np.random.Generator, o: Opening) -> Mesh:
    """The pane and the reveals of an opening and, if its head is round, the wall above the arch."""
    x0, x1, z0, z1 = o.left_m, o.left_m + o.width_m, o.bottom_m, o.bottom_m + o.height_m
    deep, lent, is_glass = o.depth_m, min(o.depth_m, _LENT_M), o.kind in ("window", "shop")
    glow = float(rng.uniform(0.5, 1.2)) if is_glass and rng.random() < 0.35 else 0.0
    pane = patch(
        (x0, deep, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), uv_m=(x0, z0),
        glow=max(glow, 0.7 * (o.kind == "shop")), gloss=0.85 * is_glass,
    )  # fmt: skip
    parts = [
        pane,
        _lent(patch((x0, 0, z0), (0, deep, 0), (0, 0, z1 - z0), uv_m=(0, z0)), 0, x0 - lent, x0),
        _lent(
            patch((x1, deep, z0), (0, -deep, 0), (0, 0, z1 - z0), uv_m=(0, z0)), 0, x1, x1 + lent
        ),
    ]
    if z0 > 0.05:
        sill = patch((x0, 0, z0), (x1 - x0, 0, 0), (0, deep, 0), uv_m=(x0, 0))
        parts.append(_lent(sill, 1, z0 - lent, z0))
    if o.arched:
        parts += arch_meshes(o)
    else:
        head = patch((x0, deep, z1), (x1 - x0, 0, 0), (0, -deep, 0), uv_m=(x0, 0))
        parts.append(_lent(head, 1, z1, z1 + lent))
    return join(parts)


def _lent(mesh: Mesh, axis: int, start_m: float, end_m: float) -> Mesh:
    """A mesh that takes its picture from a strip of the wall, stretched along one axis."""
    uv = mesh.uv_m.copy()
    low, high = uv[:, axis].min(), uv[:, axis].max()
    uv[:, axis] = start_m + (end_m - start_m) * (uv[:, axis] - low) / (high - low)
    return replace(mesh, uv_m=uv)


def arch_meshes(o: Opening, pieces: int = 12) -> list[Mesh]:
    """The wall above a round head, and its soffit, in pieces of the half circle."""
    radius, top = o.width_m / 2, o.bottom_m + o.height_m
    angle = np.linspace(np.pi, 0, pieces + 1)
    x = o.left_m + radius * (1 + np.cos(angle))
    z = top - radius + radius * np.sin(angle)
    parts = []
    for i in range(pieces):
        width = x[i + 1] - x[i]
        corners = [(x[i], 0, z[i]), (x[i + 1], 0, z[i + 1]), (x[i + 1], 0, top), (x[i], 0, top)]
        # The picture has the opening's pane here: the wall above it lends its texture.
        uv = [(c[0], top + _LENT_M * (1 - (top - c[2]) / radius)) for c in corners]
        parts.append(Mesh.build(corners, (0, -1, 0), uv, [[0, 1, 2], [0, 2, 3]]))
        rise = (width, 0, z[i + 1] - z[i])
        soffit = patch((x[i], o.depth_m, z[i]), rise, (0, -o.depth_m, 0), uv_m=(x[i], 0))
        parts.append(_lent(soffit, 1, top, top + _LENT_M))
    return parts
