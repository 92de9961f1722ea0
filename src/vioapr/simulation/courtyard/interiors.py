"""Rooms behind windows, as painted on the panes: dim, curtained, or shelves full of goods.

Pictures have shape (h, w, 3), 0 to 1.
"""

from __future__ import annotations

import numpy as np

from vioapr.simulation.courtyard.noise import Field, coordinates_m, fractal, mix, step


def room(rng: np.random.Generator, shape: tuple[int, int], px_per_m: float) -> Field:
    """A dim room, of which no two are alike."""
    x, y = coordinates_m(shape, px_per_m)
    wall = rng.uniform(0.05, 0.22) * np.array([1.0, rng.uniform(0.8, 1.0), rng.uniform(0.6, 1.0)])
    light = 0.55 + 0.5 * y / y.max() + 0.12 * fractal(rng, shape, slope=1.5)
    picture = (wall * light[..., None]).astype(np.float32)
    for _ in range(rng.integers(1, 4)):  # furniture and pictures on the wall
        left, low = rng.uniform(0, x.max()), rng.uniform(-0.2, 0.6 * y.max())
        inside = (np.abs(x - left) < rng.uniform(0.1, 0.4)) & (
            np.abs(y - low) < rng.uniform(0.1, 0.5)
        )
        picture[inside] = rng.uniform(0.03, 0.4) + rng.uniform(-0.06, 0.06, 3)
    kind = rng.random()
    if kind < 0.55:
        picture = curtains(rng, picture, px_per_m)
    elif kind < 0.8:
        picture = blind(rng, picture, px_per_m)
    if rng.random() < 0.35:
        picture = pot_plant(rng, picture, px_per_m)
    return picture


def curtains(rng: np.random.Generator, picture: Field, px_per_m: float) -> Field:
    """A room's picture with curtains drawn from both sides."""
    shape = picture.shape[:2]
    x, y = coordinates_m(shape, px_per_m)
    width = x.max()
    opened = rng.uniform(0.12, 0.5, 2) * width
    swing = 0.08 * np.sin(y * rng.uniform(1, 3) + rng.uniform(0, 6))
    is_cloth = (x < opened[0] + swing) | (x > width - opened[1] - swing)
    folds = np.sin(x * rng.uniform(45, 75) + 2 * swing * 20 + fractal(rng, shape, slope=1.8))
    base = rng.choice([[0.8, 0.78, 0.72], [0.7, 0.62, 0.5], [0.62, 0.3, 0.26], [0.4, 0.5, 0.6]])
    cloth = np.asarray(base)[None, None] * (0.62 + 0.16 * folds)[..., None]
    return mix(picture, cloth, 0.9 * is_cloth)


def blind(rng: np.random.Generator, picture: Field, px_per_m: float) -> Field:
    """A room's picture with a slatted blind, let down part of the way."""
    _, y = coordinates_m(picture.shape[:2], px_per_m)
    low = rng.uniform(0.1, 0.9) * y.max()
    slats = 0.55 + 0.15 * np.sin(y * 2 * np.pi / 0.05)
    down = slats[..., None] * np.array([0.95, 0.92, 0.85]) + 0 * picture
    return mix(picture, down, np.broadcast_to(y > low, picture.shape[:2]) * 0.95)


def pot_plant(rng: np.random.Generator, picture: Field, px_per_m: float) -> Field:
    """A room's picture with a plant on the window sill."""
    shape = picture.shape[:2]
    x, y = coordinates_m(shape, px_per_m)
    centre, height = rng.uniform(0.2, 0.8) * x.max(), rng.uniform(0.2, 0.55)
    leaf = np.hypot((x - centre) / 0.55, y - height) / height + 0.3 * fractal(rng, shape, slope=0.9)
    tone = 1 + 0.3 * fractal(rng, shape, slope=0.6)
    picture = mix(picture, np.array([0.14, 0.3, 0.1]) * tone[..., None], step(leaf, 0.75, 0.6))
    pot = (np.abs(x - centre) < 0.09) & (y < 0.2)
    return mix(picture, (0.6, 0.32, 0.2), pot.astype(np.float32))


def shop(rng: np.random.Generator, shape: tuple[int, int], px_per_m: float) -> Field:
    """Shelves full of goods behind a large pane."""
    x, y = coordinates_m(shape, px_per_m)
    picture = np.full((*shape, 3), 0.12, dtype=np.float32)
    cell = (np.floor(x / 0.17).astype(int), np.floor(y / 0.42).astype(int))
    counts = (cell[1].max() + 1, cell[0].max() + 1)
    grey = rng.uniform(0.1, 0.6, size=(*counts, 1))
    colors = 0.55 * grey + 0.45 * rng.uniform(0.1, 0.65, size=(*counts, 3))
    heights = rng.uniform(0.12, 0.36, size=colors.shape[:2])
    inside = (y % 0.42) < heights[cell[1], cell[0]]
    picture = mix(picture, colors[cell[1], cell[0]], 0.85 * inside)
    picture = mix(picture, (0.45, 0.34, 0.22), 1.0 * np.broadcast_to(y % 0.42 < 0.04, shape))
    return picture * (0.55 + 0.5 * y / y.max() + 0.1 * fractal(rng, shape, slope=1.6))[..., None]
