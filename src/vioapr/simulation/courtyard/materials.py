"""Surfaces of walls, ground and furniture, painted from noise: sRGB pictures, 0 to 1, (h, w, 3).

Every painter takes the size of the picture in pixels and its density, so that bricks and
boards have their real size in metres whatever the resolution.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from vioapr.simulation.courtyard.noise import (
    Field,
    coordinates_m,
    cracks,
    fractal,
    mix,
    step,
)

Color = tuple[float, float, float]
Shape = tuple[int, int]


def brick(
    rng: np.random.Generator, shape: Shape, px_per_m: float, color: Color = (0.55, 0.29, 0.22)
) -> Field:
    """Running bond of 24 cm by 7.1 cm with lime mortar, some bricks burnt dark."""
    tone, joint = _courses(rng, shape, px_per_m, length_m=0.25, height_m=0.08, joint_m=0.011)
    hue = _courses(rng, shape, px_per_m, length_m=0.25, height_m=0.08, joint_m=0.011)[0]
    picture = np.asarray(color, dtype=np.float32) * (1 + 0.13 * tone)[..., None]
    picture = mix(picture, (0.24, 0.17, 0.17), 0.6 * step(tone, -1.2, -1.9))
    picture = mix(picture, (0.68, 0.47, 0.33), 0.32 * step(hue, 0.4, 1.8))
    picture *= (1 + 0.07 * fractal(rng, shape, slope=0.6))[..., None]
    mortar = 0.60 + 0.05 * fractal(rng, shape, slope=0.5)
    picture = mix(picture, mortar[..., None] * np.array([1.0, 0.95, 0.87]), 0.85 * joint)
    return _weathered(rng, picture, 0.09)


def ashlar(
    rng: np.random.Generator,
    shape: Shape,
    px_per_m: float,
    color: Color = (0.62, 0.57, 0.48),
    block_m: tuple[float, float] = (0.75, 0.38),
) -> Field:
    """Dressed blocks of sandstone with thin dark joints."""
    tone, joint = _courses(
        rng, shape, px_per_m, length_m=block_m[0], height_m=block_m[1], joint_m=0.014
    )
    grain = fractal(rng, shape, slope=0.5, coarsest_px=px_per_m / 2)
    bedding = fractal(rng, shape, slope=1.0, stretch=0.15)
    light = 1 + 0.07 * tone + 0.05 * grain + 0.05 * bedding
    picture = np.asarray(color, dtype=np.float32) * light[..., None]
    picture = mix(picture, (0.22, 0.2, 0.17), 0.6 * joint)
    return _weathered(rng, picture, 0.11)


def plaster(
    rng: np.random.Generator,
    shape: Shape,
    px_per_m: float,
    color: Color = (0.78, 0.63, 0.42),
    decay: float = 1.0,
) -> Field:
    """Old lime plaster: blotches, runs of rain, cracks, and holes that show the bricks.

    Args:
        rng: Source of randomness.
        shape: Rows and columns, px.
        px_per_m: Density.
        color: Of the paint.
        decay: 0 for new plaster, 1 for old.
    """
    grain = fractal(rng, shape, slope=0.4, coarsest_px=px_per_m / 3)
    blotches = fractal(rng, shape, slope=1.5)
    runs = fractal(rng, shape, slope=1.1, stretch=12, coarsest_px=px_per_m * 5)
    light = 1 + 0.022 * grain + decay * (0.045 * blotches - 0.05 * step(runs, 0.6, 2.2))
    picture = np.asarray(color, dtype=np.float32) * light[..., None]
    picture = mix(picture, (0.55, 0.52, 0.46), decay * 0.22 * step(runs, 0.9, 2.6))
    picture = mix(picture, (0.3, 0.27, 0.24), decay * 0.55 * cracks(rng, shape))
    hole = fractal(rng, shape, slope=1.7, finest_px=3)
    height = coordinates_m(shape, px_per_m)[1]
    # Damp rises from the ground, so most of the plaster falls there.
    hole = hole + 0.9 * np.exp(-height / 0.9) - 0.35
    rim = step(hole, 2.02, 2.10) - step(hole, 2.10, 2.16)
    tile = brick(rng, (min(shape[0], 400), min(shape[1], 400)), px_per_m)
    bricks = np.tile(tile, (-(-shape[0] // len(tile)), -(-shape[1] // tile.shape[1]), 1))
    picture = mix(picture, bricks[: shape[0], : shape[1]], decay * step(hole, 2.10, 2.14))
    return mix(picture, (0.87, 0.83, 0.75), decay * 0.5 * rim)


def boards(
    rng: np.random.Generator,
    shape: Shape,
    px_per_m: float,
    color: Color = (0.47, 0.36, 0.26),
    width_m: float = 0.14,
    fade: float = 0.5,
) -> Field:
    """Upright boards with grain, knots and dark gaps; `fade` is how grey sun has made them."""
    x, _ = coordinates_m(shape, px_per_m)
    number = np.floor(x / width_m).astype(int)
    tone = rng.standard_normal(number.max() + 1).astype(np.float32)[number]
    across = x / width_m - number
    gap = step(np.abs(across - 0.5), 0.5 - 0.7 / (width_m * px_per_m), 0.5)
    grain = fractal(rng, shape, slope=0.6, stretch=30)
    patches = fractal(rng, shape, slope=1.4, stretch=2.5)
    light = 1 + 0.12 * tone + 0.13 * grain + 0.07 * patches
    picture = np.asarray(color, dtype=np.float32) * light[..., None]
    grey = np.full(3, np.mean(color) * 1.15, dtype=np.float32) * light[..., None]
    picture = mix(picture, grey, np.clip(fade + 0.25 * patches, 0, 1))
    knots = fractal(rng, shape, slope=0.4, coarsest_px=px_per_m / 3, finest_px=px_per_m / 20)
    picture = mix(picture, (0.2, 0.14, 0.1), 0.6 * step(knots, 2.6, 3.2))
    return mix(picture, (0.07, 0.06, 0.05), 0.85 * np.broadcast_to(gap, shape))


def slabs(
    rng: np.random.Generator, shape: Shape, px_per_m: float, color: Color = (0.54, 0.52, 0.49)
) -> Field:
    """Worn granite paving in running bond, 60 cm by 40 cm, with sand and moss in the joints."""
    tone, joint = _courses(rng, shape, px_per_m, length_m=0.6, height_m=0.4, joint_m=0.016)
    warm = _courses(rng, shape, px_per_m, length_m=0.6, height_m=0.4, joint_m=0.016)[0]
    speckle = fractal(rng, shape, slope=0.2)
    worn = fractal(rng, shape, slope=1.5)
    light = 1 + 0.08 * tone + 0.06 * speckle + 0.05 * worn
    picture = np.asarray(color, dtype=np.float32) * light[..., None]
    picture *= 1 + 0.035 * warm[..., None] * np.array([1.0, 0.1, -0.9], dtype=np.float32)
    moss = step(fractal(rng, shape, slope=1.5), 0.2, 1.4)
    dirt = mix(np.full((*shape, 3), [0.26, 0.24, 0.21], dtype=np.float32), (0.2, 0.27, 0.1), moss)
    picture = mix(picture, dirt, 0.8 * joint)
    # Chewing gum, drops of oil and what else falls on a pavement.
    spots = fractal(rng, shape, slope=0.3, coarsest_px=px_per_m / 4, finest_px=px_per_m / 18)
    picture = mix(picture, (0.2, 0.19, 0.18), 0.5 * step(spots, 2.9, 3.4))
    return _weathered(rng, picture, 0.10)


def cobbles(rng: np.random.Generator, shape: Shape, px_per_m: float) -> Field:
    """Rounded setts of about 11 cm; periodic, so that a small picture can be repeated."""
    size = np.array([shape[1], shape[0]]) / px_per_m
    counts = np.maximum(np.round(size / 0.11).astype(int), 1)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in counts)), axis=-1).reshape(-1, 2)
    jitter = rng.uniform(-0.22, 0.22, size=grid.shape) + 0.5 * (grid[:, 1:] % 2) * [1, 0]
    centres = (grid + 0.5 + jitter) / counts * size
    x, y = coordinates_m(shape, px_per_m)
    points = np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2)
    found = KDTree(centres % size, boxsize=size).query(points, k=2)
    near, stone = (np.asarray(part) for part in found)
    edge = (near[:, 1] - near[:, 0]).reshape(shape).astype(np.float32)
    tone = rng.standard_normal(len(centres)).astype(np.float32)[stone[:, 0]].reshape(shape)
    grain = fractal(rng, shape, slope=0.4)
    light = (0.62 + 0.45 * step(edge, 0.0, 0.05)) * (1 + 0.13 * tone + 0.07 * grain)
    picture = np.array([0.47, 0.45, 0.43], dtype=np.float32) * light[..., None]
    return mix(picture, (0.2, 0.18, 0.14), 0.9 * step(edge, 0.018, 0.004))


def gravel(rng: np.random.Generator, shape: Shape, px_per_m: float) -> Field:
    """Trodden fine gravel."""
    fine = fractal(rng, shape, slope=0.2)
    coarse = fractal(rng, shape, slope=1.3)
    light = 1 + 0.13 * fine + 0.07 * coarse
    picture = np.array([0.66, 0.58, 0.46], dtype=np.float32) * light[..., None]
    stones = fractal(rng, shape, slope=0.1, coarsest_px=px_per_m / 5)
    return mix(picture, (0.36, 0.33, 0.3), 0.6 * step(stones, 1.7, 2.4))


def grass(rng: np.random.Generator, shape: Shape, px_per_m: float) -> Field:
    """A lawn with dry patches, clover, daisies and fallen leaves."""
    blades = fractal(rng, shape, slope=0.25, stretch=2.2)
    tufts = fractal(rng, shape, slope=0.9, coarsest_px=px_per_m)
    patches = fractal(rng, shape, slope=1.5)
    light = 1 + 0.22 * blades + 0.12 * tufts
    picture = np.array([0.29, 0.34, 0.17], dtype=np.float32) * light[..., None]
    picture = mix(picture, np.array([0.5, 0.45, 0.24]) * light[..., None],
                  0.75 * step(patches, 0.5, 1.9))  # fmt: skip
    picture = mix(picture, np.array([0.2, 0.29, 0.15]) * light[..., None],
                  0.7 * step(patches, -0.7, -1.8))  # fmt: skip
    picture = mix(picture, np.array([0.33, 0.26, 0.18]) * light[..., None],
                  0.9 * step(patches + 0.3 * tufts, 2.1, 2.5))  # fmt: skip
    leaves = fractal(rng, shape, slope=0.2, coarsest_px=px_per_m / 6, finest_px=4)
    picture = mix(picture, (0.52, 0.34, 0.14), step(leaves, 3.1, 3.3))
    return mix(picture, (0.9, 0.88, 0.8), 0.9 * step(-leaves, 3.3, 3.5))


def roof_tiles(
    rng: np.random.Generator, shape: Shape, px_per_m: float, color: Color = (0.5, 0.25, 0.18)
) -> Field:
    """Plain clay tiles in rows of 17 cm, mossy here and there."""
    x, y = coordinates_m(shape, px_per_m)
    tone, joint = _courses(rng, shape, px_per_m, length_m=0.2, height_m=0.17, joint_m=0.014)
    down = 1 - (y / 0.17) % 1.0
    light = (0.8 + 0.3 * down) * (1 + 0.14 * tone + 0.05 * fractal(rng, shape, slope=0.5))
    picture = np.asarray(color, dtype=np.float32) * light[..., None]
    picture = mix(picture, (0.1, 0.07, 0.06), 0.7 * joint + 0 * x)
    moss = fractal(rng, shape, slope=1.3)
    return mix(picture, (0.28, 0.29, 0.15), 0.6 * step(moss, 1.1, 2.2))


def bark(rng: np.random.Generator, shape: Shape) -> Field:
    """Furrowed bark with lichen."""
    furrows = fractal(rng, shape, slope=0.9, stretch=5, coarsest_px=shape[1] / 4)
    light = 0.8 + 0.3 * np.clip(furrows, -1.6, 1.6)
    picture = np.array([0.3, 0.25, 0.2], dtype=np.float32) * light[..., None]
    lichen = fractal(rng, shape, slope=1.2)
    return mix(picture, (0.47, 0.5, 0.36), 0.55 * step(lichen, 0.9, 2.0))


def stone(rng: np.random.Generator, shape: Shape, color: Color = (0.63, 0.6, 0.54)) -> Field:
    """Cut limestone with black crusts and lichen."""
    grain, clouds = fractal(rng, shape, slope=0.4), fractal(rng, shape, slope=1.4)
    light = 1 + 0.06 * grain + 0.08 * clouds
    picture = np.asarray(color, dtype=np.float32) * light[..., None]
    picture = mix(picture, (0.2, 0.2, 0.19), 0.6 * step(clouds, 0.9, 2.3))
    lichen = fractal(rng, shape, slope=0.9, coarsest_px=shape[1] / 4)
    return mix(picture, (0.68, 0.62, 0.3), 0.5 * step(lichen, 1.9, 2.5))


def painted(rng: np.random.Generator, shape: Shape, color: Color = (0.8, 0.8, 0.8)) -> Field:
    """Painted metal or wood: scratches, chips and rust; mostly tinted where it is used."""
    grain, clouds = fractal(rng, shape, slope=0.4), fractal(rng, shape, slope=1.5)
    picture = np.asarray(color, dtype=np.float32) * (1 + 0.03 * grain + 0.06 * clouds)[..., None]
    picture = mix(picture, (0.25, 0.2, 0.17), 0.6 * cracks(rng, shape, 0.03))
    return mix(picture, (0.38, 0.22, 0.13), 0.8 * step(clouds + 0.4 * grain, 2.2, 2.6))


def cloth(rng: np.random.Generator, shape: Shape) -> Field:
    """Folded fabric, tinted where it is used."""
    folds = fractal(rng, shape, slope=1.2, stretch=3)
    weave = fractal(rng, shape, slope=0.1)
    return (
        np.full((*shape, 3), 0.85, dtype=np.float32) * (1 + 0.11 * folds + 0.04 * weave)[..., None]
    )


def _courses(
    rng: np.random.Generator,
    shape: Shape,
    px_per_m: float,
    *,
    length_m: float,
    height_m: float,
    joint_m: float,
) -> tuple[Field, Field]:
    """Blocks in running bond: each block's random tone, and how much a pixel is joint."""
    x, y = coordinates_m(shape, px_per_m)
    row = np.floor(y / height_m).astype(int)
    along = x / length_m + 0.5 * (row % 2) + 0.07 * np.sin(row * 12.9)
    column = np.floor(along).astype(int)
    tones = rng.standard_normal((row.max() + 1, column.max() + 1)).astype(np.float32)
    from_edge_m = np.minimum(
        height_m * (0.5 - np.abs(y / height_m - row - 0.5)),
        length_m * (0.5 - np.abs(along - column - 0.5)),
    )
    soft = 0.5 / px_per_m
    return tones[row, column], step(from_edge_m, joint_m / 2 + soft, joint_m / 2 - soft)


def _weathered(rng: np.random.Generator, picture: Field, amount: float) -> Field:
    """Large clouds of soot and bleaching: what makes one stretch of a wall unlike the next."""
    clouds = fractal(rng, picture.shape[:2], slope=1.6)
    return picture * (1 + amount * np.clip(clouds, -2.5, 2.0))[..., None]
