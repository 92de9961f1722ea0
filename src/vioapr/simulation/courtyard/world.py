"""The courtyard: all its surfaces and where they stand.

World coordinates: metres, z up, the origin on the ground in the middle, x along the long
side. The seed decides textures, plants and clutter; the layout is always the same.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.simulation.courtyard import furniture, houses, materials, plants, posters
from vioapr.simulation.courtyard.furniture import place
from vioapr.simulation.courtyard.mesh import Mesh, box, join, patch
from vioapr.simulation.courtyard.noise import (
    Field,
    coordinates_m,
    fractal,
    mix,
    step,
    to_pixels,
)
from vioapr.simulation.courtyard.plants import Parts

GROUND_LOW_M, GROUND_HIGH_M = (-24.0, -15.6), (18.6, 13.6)
"""Corners of the ground: it reaches into the arcade and the passage."""
LAWNS_M = (((-13.0, -5.5), (-6.2, 5.5)), ((6.2, -5.5), (13.0, 5.5)))
"""Lower and upper corners of the two lawns, which nobody walks on."""
LAMP_PLACES_M = ((-14.5, 7.5), (0.0, 8.2), (14.5, 7.5), (-14.5, -7.5), (0.0, -8.2), (14.5, -7.5))


@dataclass(frozen=True)
class Material:
    """A picture that covers surfaces.

    Attributes:
        pixels: Shape (h, w, 3), or (h, w, 4) where alpha cuts shapes out.
        size_m: Width and height that it covers; it repeats beyond.
    """

    pixels: NDArray[np.uint8]
    size_m: tuple[float, float]

    @property
    def is_cutout(self) -> bool:
        """Whether parts of it are transparent."""
        return self.pixels.shape[2] == 4


@dataclass(frozen=True)
class World:
    """A place.

    Attributes:
        materials: By name.
        meshes: By the name of their material.
        lamps_m: Lights that are lit at dusk, (n, 3).
    """

    materials: dict[str, Material]
    meshes: dict[str, Mesh]
    lamps_m: NDArray[np.float64]


def build(seed: int = 0, px_per_m: float = 64.0) -> World:
    """Paint and furnish the courtyard.

    Args:
        seed: The same seed gives the same place.
        px_per_m: Density of the walls' pictures.
    """
    rng = np.random.default_rng([seed, 1])
    fronts = houses.build_all(rng, px_per_m)
    surfaces = _materials(rng)
    for side, house in fronts.items():
        size = tuple(n / px_per_m for n in house.picture.shape[1::-1])
        surfaces[side] = Material(to_pixels(house.picture), size)
    ground_px_per_m = 0.8 * px_per_m
    surfaces["ground"] = _ground_material(rng, ground_px_per_m)
    parts = [*_ground(), *houses.behind(rng), *_trees(rng), *_furniture(rng)]
    parts += [part for house in fronts.values() for part in house.parts]
    grouped: dict[str, list[Mesh]] = defaultdict(list)
    for material, mesh in parts:
        grouped[material].append(mesh)
    lamps = [(*spot, 3.3) for spot in LAMP_PLACES_M]
    return World(surfaces, {name: join(meshes) for name, meshes in grouped.items()},
                 np.array(lamps))  # fmt: skip


def _materials(rng: np.random.Generator) -> dict[str, Material]:
    """Pictures that repeat, and the signs."""
    small = (512, 512)
    stripes = np.zeros((256, 256, 3), dtype=np.float32)
    stripes[:] = np.where((np.arange(256) // 32 % 2)[None, :, None], [0.84, 0.81, 0.74],
                          [0.5, 0.13, 0.12])  # fmt: skip
    stripes *= 0.9 + 0.06 * fractal(rng, (256, 256))[..., None]
    painted = {
        "limestone": (materials.stone(rng, small), 2.5),
        "wood": (materials.boards(rng, small, 320.0, (0.5, 0.34, 0.2), fade=0.25), 1.6),
        "crate": (materials.boards(rng, (256, 256), 256.0, (0.62, 0.47, 0.3), 0.11, 0.1), 1.0),
        "painted": (materials.painted(rng, small), 2.0),
        "cloth": (materials.cloth(rng, (256, 256)), 1.5),
        "bark": (materials.bark(rng, small), 1.2),
        "roof": (materials.roof_tiles(rng, (768, 768), 64.0), 12.0),
        "ashlar": (materials.ashlar(rng, small, 42.6), 12.0),
        "stripes": (stripes, 1.6),
        "posters": (posters.poster_sheet(rng), 4.2),
        "water": (np.full((64, 64, 3), [0.1, 0.16, 0.15], np.float32)
                  * (1 + 0.15 * fractal(rng, (64, 64))[..., None]), 1.5),
    }  # fmt: skip
    surfaces = {
        name: Material(to_pixels(picture), (size, size))
        for name, (picture, size) in painted.items()
    }
    surfaces["leaves"] = Material(to_pixels(plants.leaf_picture(rng)), (1.0, 1.0))
    return surfaces | _signs()


def _signs() -> dict[str, Material]:
    specs = {
        "sign_cafe": ("CAFÉ  AM  BRUNNEN", (1344, 80), "#f3e3b0", "#3a1d17", 8.4, 0.5),
        "sign_books": ("BOOKS · MAPS · PRINTS", (1168, 80), "#efe9da", "#17324a", 8.0, 0.55),
        "sign_kiosk": ("FRUIT & FLOWERS", (512, 90), "#fdf7dd", "#2f5d34", 2.4, 0.42),
        "sign_van": ("Quick & Sons", (512, 205), "#b02a20", "#e8e6df", 2.0, 0.8),
        "sign_14": ("14", (128, 96), "#f4f4f4", "#1d3557", 0.4, 0.3),
        "sign_16": ("16", (128, 96), "#f4f4f4", "#1d3557", 0.4, 0.3),
    }
    return {
        name: Material(to_pixels(posters.sign(text, size, color, ground)), (width, height))
        for name, (text, size, color, ground, width, height) in specs.items()
    }


def _ground_material(rng: np.random.Generator, px_per_m: float) -> Material:
    """Paving with a cobbled border, a round of gravel, lawns, manholes and stains."""
    size = np.subtract(GROUND_HIGH_M, GROUND_LOW_M)
    shape = (round(size[1] * px_per_m), round(size[0] * px_per_m))
    x, y = coordinates_m(shape, px_per_m)
    x, y = x + GROUND_LOW_M[0], y + GROUND_LOW_M[1]
    edge = 0.05 * fractal(rng, shape, slope=1.0, coarsest_px=px_per_m)
    picture = materials.slabs(rng, shape, px_per_m)
    border = (np.abs(x) > houses.LENGTH_M / 2 - 2.6) | (np.abs(y) > houses.WIDTH_M / 2 - 2.2)
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
    picture = _used(rng, picture, x, y, px_per_m)
    pixels = to_pixels(picture)
    return Material(pixels, (float(size[0]), float(size[1])))


def _used(rng: np.random.Generator, picture: Field, x: Field, y: Field, px_per_m: float) -> Field:
    """Manholes, a gutter of granite, patches of asphalt, wet and oily stains."""
    shape = picture.shape[:2]
    gutter = np.abs(np.abs(y) - 10.75) < 0.14
    picture = mix(picture, picture * 0.66, np.broadcast_to(gutter, shape).astype(np.float32))
    for spot in ((-15.2, -2.0), (3.5, 9.3), (-4.0, -9.2), (15.6, 3.0), (9.5, -9.9)):
        rows, columns = _window(x, y, spot, (0.6, 0.6))
        picture[rows, columns] = _manhole(picture[rows, columns], x[:, columns] - spot[0],
                                          y[rows] - spot[1])  # fmt: skip
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


def _manhole(picture: Field, x: Field, y: Field) -> Field:
    """A cast-iron cover at the middle of a piece of ground."""
    radius = np.hypot(x, y)
    pattern = 0.24 + 0.1 * (np.sin(x * 42) * np.sin(y * 42) > 0.2)
    iron = pattern[..., None] * np.ones(3, np.float32)
    picture = mix(picture, iron, step(radius, 0.37, 0.35))
    return mix(picture, (0.12, 0.11, 0.1), np.exp(-np.square((radius - 0.37) / 0.02)))


def _ground() -> Parts:
    """The ground, and kerbs around the lawns."""
    size = np.subtract(GROUND_HIGH_M, GROUND_LOW_M)
    floor = patch((*GROUND_LOW_M, 0), (size[0], 0, 0), (0, size[1], 0), cell_m=1.0)
    kerbs = []
    for (x0, y0), (x1, y1) in LAWNS_M:
        kerbs += [
            box((x0 - 0.12, y0 - 0.12, 0), (x1 + 0.12, y0 + 0.04, 0.14)),
            box((x0 - 0.12, y1 - 0.04, 0), (x1 + 0.12, y1 + 0.12, 0.14)),
            box((x0 - 0.12, y0, 0), (x0 + 0.04, y1, 0.14)),
            box((x1 - 0.04, y0, 0), (x1 + 0.12, y1, 0.14)),
        ]
    return [("ground", floor), ("limestone", join(kerbs))]


def _trees(rng: np.random.Generator) -> Parts:
    """Six trees, shrubs on the lawns, a hedge, poplars behind the roofs."""
    parts: Parts = []
    green, red, lime = (0.85, 1.0, 0.75), (1.45, 0.62, 0.55), (1.15, 1.2, 0.6)
    trees = (
        *((-11.6, 3.6, 8.5, 3.1, green), (-7.6, -3.6, 6.0, 2.1, lime), (11.3, 3.2, 7.2, 2.5, red)),
        *(
            (8.0, -4.0, 7.6, 2.7, green),
            (-16.3, 10.4, 5.4, 1.7, lime),
            (15.6, -10.6, 5.6, 1.9, green),
        ),
    )
    for x, y, height, spread, tint in trees:
        parts += plants.tree(rng, (x, y), height, spread, tint, leaves=round(32 * height))
    bushes = (
        *((-12.2, -4.4, 0.7), (-11.0, -4.8, 0.5), (-7.0, 4.6, 0.8), (12.2, -4.6, 0.6)),
        *((7.1, 4.7, 0.55), (8.3, 4.5, 0.7), (12.4, 0.4, 0.5)),
    )
    for x, y, radius in bushes:
        parts += plants.shrub(rng, (x, y), radius)
    parts += plants.hedge(rng, (-12.6, -0.8), (-12.6, 2.0))
    parts += plants.hedge(rng, (12.6, -3.6), (12.6, -1.0))
    for x, y in ((-29, 8), (-30.5, 12.5), (-27.5, 15.5), (6, 27), (-3, 29), (38, -6), (36, -12)):
        parts += plants.tree(rng, (x, y), rng.uniform(15, 19), 3.4, (0.6, 0.75, 0.6), leaves=70)
    return parts


def _furniture(rng: np.random.Generator) -> Parts:
    """Everything else; equal benches and lamps stand in places that look alike."""
    parts: Parts = furniture.fountain()
    for x, y in LAMP_PLACES_M:
        parts += place(furniture.lamp(), x, y)
    for x, y, yaw in ((-9.6, 6.6, 0), (9.6, 6.6, 0), (-9.6, -6.6, 180), (9.6, -6.6, 180),
                      (0.0, 6.6, 0), (0.0, -6.6, 180)):  # fmt: skip
        parts += place(furniture.bench(), x, y, yaw)
    for x, y in ((-11.2, 6.7), (11.2, 6.7), (-11.2, -6.7), (11.2, -6.7)):
        parts += place(furniture.litter_bin(), x, y)
    parts += place(furniture.advertising_column(), -15.0, -9.6, 40)
    parts += place(furniture.notice_board(), 4.6, 11.9)
    parts += place(furniture.kiosk(), -3.6, 11.2, 4)
    parts += place(furniture.van((0.93, 0.92, 0.88)), -15.9, 5.6, 84)
    for x, y, shade in ((15.3, 9.6, (0.9, 0.85, 0.7)), (15.0, 6.2, None),
                        (15.4, 3.6, (0.75, 0.2, 0.16)), (15.2, 0.6, (0.9, 0.85, 0.7))):  # fmt: skip
        parts += place(furniture.table_set(rng, shade), x, y, rng.uniform(0, 360))
    for x, color in ((8.9, (0.7, 0.15, 0.12)), (9.6, (0.15, 0.3, 0.55)), (10.4, (0.2, 0.2, 0.2))):
        parts += place(furniture.bicycle(color), x, 11.9, rng.uniform(75, 105))
    parts += place(furniture.bicycle((0.2, 0.45, 0.3)), -17.3, -3.2, 96)
    parts += place(furniture.crates(rng), -6.6, 11.6, 8)
    parts += place(furniture.crates(rng, 5), 16.6, -6.6, -75)
    parts += place(furniture.woodpile(rng), 12.6, -12.55, 180)
    parts += _pots(rng)
    return parts


def _pots(rng: np.random.Generator) -> Parts:
    """Pots of flowers at the doors and along the arcade, no two alike."""
    parts: Parts = []
    by_doors = ((-11.9, 12.2), (-9.1, 12.2), (9.1, 12.2), (11.9, 12.2), (17.3, 2.2), (17.3, -2.8))
    by_arches = ((-16.0, -12.3), (-8.0, -12.3), (0.0, -12.3), (8.0, -12.3))
    for x, y in (*by_doors, *by_arches, (2.9, 3.0)):
        radius, height = rng.uniform(0.22, 0.36), rng.uniform(0.35, 0.6)
        parts.append(("painted", plants.pot((x, y), radius, height)))
        bed = plants.flowers(rng, (x - 0.3, y - 0.3, height), (x + 0.3, y + 0.3, height + 0.35), 16)
        parts.append(("leaves", bed))
    return parts
