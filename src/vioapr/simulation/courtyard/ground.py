"""The yard's ground: its picture, and its surface with the kerbs of the lawns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vioapr.simulation.courtyard import materials
from vioapr.simulation.courtyard.houses import LENGTH_M, WIDTH_M
from vioapr.simulation.courtyard.mesh import Parts, box, join, patch
from vioapr.simulation.courtyard.noise import Field, coordinates_m, fractal, mix, step

GROUND_LOW_M, GROUND_HIGH_M = (-24.0, -15.6), (18.6, 13.6)
"""Corners of the ground: it reaches into the arcade and the passage."""
LAWNS_M = (((-13.0, -5.5), (-6.2, 5.5)), ((6.2, -5.5), (13.0, 5.5)))
"""Lower and upper corners of the two lawns, which nobody walks on."""
SIZE_M = (GROUND_HIGH_M[0] - GROUND_LOW_M[0], GROUND_HIGH_M[1] - GROUND_LOW_M[1])
"""Of the ground along x and y."""


def paint(rng: np.random.Generator, px_per_m: float) -> Field:
    """Paint paving with a cobbled border, a round of gravel, lawns, manholes and stains.

    Returns:
        Shape (h, w, 3), 0 to 1.
    """
    shape = (round(SIZE_M[1] * px_per_m), round(SIZE_M[0] * px_per_m))
    x, y = coordinates_m(shape, px_per_m)
    x, y = x + GROUND_LOW_M[0], y + GROUND_LOW_M[1]
    edge = 0.05 * fractal(rng, shape, slope=1.0, coarsest_px=px_per_m)
    picture = materials.slabs(rng, shape, px_per_m)
    border = (np.abs(x) > LENGTH_M / 2 - 2.6) | (np.abs(y) > WIDTH_M / 2 - 2.2)
    side = round(4.4 * px_per_m)
    setts = materials.cobbles(rng, (side, side), px_per_m)
    repeats = (shape[0] // len(setts) + 1, shape[1] // len(setts) + 1, 1)
    setts = np.tile(setts, repeats)[: shape[0], : shape[1]]
    setts *= (1 + 0.13 * np.clip(fractal(rng, shape, slope=1.6), -2, 2))[..., None]
    picture = mix(picture, setts, border.astype(np.float32))
    gravel = step(np.hypot(x, y) + edge, 5.32, 5.28)
    picture = mix(picture, materials.gravel(rng, shape, px_per_m), gravel)
    lawn = materials.grass(rng, shape, px_per_m)
    for low, high in LAWNS_M:
        inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
        picture = mix(picture, lawn, inside.astype(np.float32))
    return use(rng, picture, x, y, px_per_m)


def use(rng: np.random.Generator, picture: Field, x: Field, y: Field, px_per_m: float) -> Field:
    """Add what use has left: manholes, a gutter, patches of asphalt, wet and oily stains.

    Args:
        rng: Source of randomness.
        picture: Of the ground, (h, w, 3).
        x: World coordinates of its columns, (1, w).
        y: And of its rows, (h, 1).
        px_per_m: Its density.
    """
    shape = picture.shape[:2]
    gutter = np.abs(np.abs(y) - 10.75) < 0.14
    picture = mix(picture, picture * 0.66, np.broadcast_to(gutter, shape).astype(np.float32))
    for spot in ((-15.2, -2.0), (3.5, 9.3), (-4.0, -9.2), (15.6, 3.0), (9.5, -9.9)):
        rows, columns = _window(x, y, spot, (0.6, 0.6))
        picture[rows, columns] = manhole(
            picture[rows, columns], x[:, columns] - spot[0], y[rows] - spot[1]
        )
    for _ in range(7):
        centre, half = rng.uniform([-16, -11.5], [16, 11.5]), rng.uniform(0.4, 1.3, 2)
        on_lawn = any(low[0] - 1.4 < centre[0] < high[0] + 1.4 and abs(centre[1]) < 7
                      for low, high in LAWNS_M)  # fmt: skip
        if not on_lawn and np.hypot(*centre) > 7:
            rows, columns = _window(x, y, centre, half)
            grain = fractal(rng, picture[rows, columns].shape[:2], slope=0.3)
            asphalt = 0.2 + 0.025 * grain[..., None] + np.zeros(3, np.float32)
            picture[rows, columns] = mix(picture[rows, columns], asphalt, 0.92)
    stains = fractal(rng, shape, slope=1.3, finest_px=px_per_m / 12)
    return mix(picture, picture * 0.55, 0.75 * step(stains, 1.5, 2.1))


def _window(x: Field, y: Field, centre: ArrayLike, half: ArrayLike) -> tuple[slice, slice]:
    """Rows and columns of a rectangle of the ground."""
    (cx, cy), (dx, dy) = np.asarray(centre), np.asarray(half)
    columns = np.flatnonzero(np.abs(x[0] - cx) < dx)
    rows = np.flatnonzero(np.abs(y[:, 0] - cy) < dy)
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def manhole(picture: Field, x: Field, y: Field) -> Field:
    """A cast-iron cover at the middle of a piece of ground."""
    radius = np.hypot(x, y)
    pattern = 0.24 + 0.1 * (np.sin(x * 42) * np.sin(y * 42) > 0.2)
    iron = pattern[..., None] * np.ones(3, np.float32)
    picture = mix(picture, iron, step(radius, 0.37, 0.35))
    return mix(picture, (0.12, 0.11, 0.1), np.exp(-np.square((radius - 0.37) / 0.02)))


def build() -> Parts:
    """The ground, and kerbs around the lawns."""
    floor = patch((*GROUND_LOW_M, 0), (SIZE_M[0], 0, 0), (0, SIZE_M[1], 0), cell_m=1.0)
    kerbs = []
    for (x0, y0), (x1, y1) in LAWNS_M:
        kerbs += [
            box((x0 - 0.12, y0 - 0.12, 0), (x1 + 0.12, y0 + 0.04, 0.14)),
            box((x0 - 0.12, y1 - 0.04, 0), (x1 + 0.12, y1 + 0.12, 0.14)),
            box((x0 - 0.12, y0, 0), (x0 + 0.04, y1, 0.14)),
            box((x1 - 0.04, y0, 0), (x1 + 0.12, y1, 0.14)),
        ]
    return [("ground", floor), ("limestone", join(kerbs))]
