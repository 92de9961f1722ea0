"""Trees, shrubs, hedges and climbers: trunks, and cards that show clusters of leaves."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from vioapr.simulation.courtyard.mesh import Mesh, Parts, cards, lathe, rod


def leaf_picture(rng: np.random.Generator, size_px: int = 256, leaves: int = 75) -> NDArray:
    """A cluster of leaves with gaps between them, RGBA, (h, w, 4), 0 to 1."""
    image = Image.new("RGBA", (size_px, size_px), (60, 80, 35, 0))
    for depth in np.sort(rng.uniform(0.45, 1.0, leaves)):
        length = int(size_px * rng.uniform(0.12, 0.2))
        leaf = Image.new("RGBA", (length, length), (0, 0, 0, 0))
        draw = ImageDraw.Draw(leaf)
        color = np.array([rng.uniform(82, 118), rng.uniform(100, 128), rng.uniform(45, 68)]) * depth
        draw.ellipse((0, length * 0.27, length - 1, length * 0.73),
                     fill=(*(int(c) for c in color), 255))  # fmt: skip
        draw.line((0, length / 2, length, length / 2), fill=(*(int(c * 0.7) for c in color), 255))
        leaf = leaf.rotate(rng.uniform(0, 360), expand=True)
        radius = size_px * 0.40 * np.sqrt(rng.uniform())
        angle = rng.uniform(0, 2 * np.pi)
        centre = size_px / 2 + radius * np.array([np.cos(angle), np.sin(angle)])
        corner = (centre - np.array(leaf.size) / 2).astype(int)
        image.alpha_composite(leaf, (max(corner[0], 0), max(corner[1], 0)))
    return np.asarray(image, dtype=np.float32) / 255


def tree(
    rng: np.random.Generator,
    place_m: ArrayLike,
    height_m: float = 8.0,
    spread_m: float = 2.6,
    tint: ArrayLike = (1.0, 1.0, 1.0),
    leaves: int = 260,
) -> Parts:
    """A trunk that forks, and a crown of several lobes."""
    x, y = np.asarray(place_m, dtype=float)
    fork = np.array([x + rng.normal(0, 0.15), y + rng.normal(0, 0.15), 0.42 * height_m])
    girth = 0.028 * height_m
    parts: Parts = [("bark", rod((x, y, -0.05), (x, y, 0.5), (1.5 * girth, girth), sides=9))]
    parts.append(("bark", rod((x, y, 0.5), fork, (girth, 0.75 * girth), sides=9)))
    lobes = []
    for angle in np.linspace(0, 2 * np.pi, 6)[:-1] + rng.uniform(0, 6):
        reach = spread_m * rng.uniform(0.35, 0.7)
        top = height_m * rng.uniform(0.6, 0.82)
        end = np.array([x + reach * np.cos(angle), y + reach * np.sin(angle), top])
        parts.append(("bark", rod(fork, end, (0.5 * girth, 0.12 * girth), sides=5)))
        lobes.append(end)
    lobes.append(np.array([x, y, 0.85 * height_m]))
    crown = _foliage(rng, np.array(lobes), 0.55 * spread_m, leaves, 1.4, tint)
    return [*parts, ("leaves", crown)]


def shrub(
    rng: np.random.Generator,
    place_m: ArrayLike,
    radius_m: float = 0.7,
    tint: ArrayLike = (0.9, 1.0, 0.8),
    leaves: int = 34,
) -> Parts:
    """A round bush."""
    x, y = np.asarray(place_m, dtype=float)
    centre = np.array([[x, y, 0.75 * radius_m]])
    return [("leaves", _foliage(rng, centre, radius_m, leaves, 0.8 * radius_m + 0.25, tint))]


def hedge(
    rng: np.random.Generator, start_m: ArrayLike, end_m: ArrayLike, height_m: float = 0.9
) -> Parts:
    """A clipped row of bushes."""
    start, end = np.asarray(start_m, float), np.asarray(end_m, float)
    count = int(11 * np.linalg.norm(end - start))
    along = start + rng.uniform(0, 1, (count, 1)) * (end - start)
    side = rng.normal(0, 0.18, (count, 2))
    centres = np.column_stack([along + side, rng.uniform(0.15, height_m, count)])
    normals = np.column_stack([2.5 * side + rng.normal(0, 0.15, (count, 2)),
                               0.4 + centres[:, 2] / height_m])  # fmt: skip
    return [("leaves", _cards(rng, centres, normals, np.full(count, 0.6), (0.75, 0.9, 0.7)))]


def climber(rng: np.random.Generator, width_m: float, height_m: float, leaves: int = 160) -> Mesh:
    """Ivy on a wall, in the facade's coordinates: dense below, thinning out upwards."""
    height = height_m * rng.beta(1.0, 1.5, leaves)
    reach = width_m / 2 * (1.05 - 0.6 * height / height_m)
    centres = np.column_stack([
        reach * rng.uniform(-1, 1, leaves) + 0.4 * np.sin(2 * height),
        rng.uniform(-0.22, -0.06, leaves), height,
    ])  # fmt: skip
    normals = np.array([0, -1, 0.25]) + rng.normal(0, 0.3, (leaves, 3))
    return _cards(rng, centres, normals, rng.uniform(0.6, 1.1, leaves), (0.55, 0.75, 0.5))


def flowers(rng: np.random.Generator, low_m: ArrayLike, high_m: ArrayLike, count: int = 30) -> Mesh:
    """A bed of flowers in a box, a colour each."""
    low, high = np.asarray(low_m, float), np.asarray(high_m, float)
    centres = low + rng.uniform(0, 1, (count, 3)) * (high - low)
    palette = np.array([[1.9, 0.5, 0.5], [1.9, 1.5, 0.4], [1.7, 1.5, 2.6], [1.0, 1.1, 0.8]])
    normals = np.array([0, 0, 1.0]) + rng.normal(0, 0.6, (count, 3))
    return _cards(rng, centres, normals, rng.uniform(0.22, 0.42, count),
                  palette[rng.integers(0, 4, count)])  # fmt: skip


def _foliage(
    rng: np.random.Generator,
    lobes: NDArray,
    radius_m: float,
    count: int,
    card_m: float,
    tint: ArrayLike,
) -> Mesh:
    """Cards around the centres of lobes, darker inside."""
    out = rng.standard_normal((count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    depth = rng.uniform(0.25, 1.0, count) ** 0.5
    centres = lobes[rng.integers(0, len(lobes), count)] + radius_m * depth[:, None] * out
    normals = centres - lobes.mean(axis=0) - [0, 0, 0.3 * radius_m]
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) + rng.normal(
        0, 0.35, (count, 3)
    )
    shade = (0.45 + 0.6 * depth)[:, None] * np.asarray(tint)
    return _cards(rng, centres, normals, card_m * rng.uniform(0.75, 1.2, count), shade)


def _cards(
    rng: np.random.Generator, centres: NDArray, normals: NDArray, sizes: NDArray, tint: ArrayLike
) -> Mesh:
    count = len(centres)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    tints = np.broadcast_to(np.asarray(tint), (count, 3)) * rng.uniform(0.75, 1.2, (count, 1))
    tints = tints * (1 + rng.normal(0, 0.07, (count, 3)))
    return cards(centres, unit, sizes, rng.uniform(0, 2 * np.pi, count), tints, picture_m=1.0)


def pot(place_m: ArrayLike, radius_m: float = 0.3, height_m: float = 0.5) -> Mesh:
    """A terracotta pot."""
    x, y = np.asarray(place_m, dtype=float)
    profile = [(0.7 * radius_m, 0.0), (radius_m, height_m), (1.1 * radius_m, height_m),
               (1.1 * radius_m, height_m + 0.06), (0.9 * radius_m, height_m + 0.06),
               (0.8 * radius_m, height_m - 0.05), (0.0, height_m - 0.05)]  # fmt: skip
    return lathe(profile, centre_m=(x, y, 0), tint=(0.85, 0.5, 0.36))
