"""The courtyard: all its surfaces and where they stand.

World coordinates: metres, z up, the origin on the ground in the middle, x along the long
side. The seed decides textures, plants and clutter; the layout is always the same.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.simulation.courtyard import ground, houses, layout, materials, plants, posters
from vioapr.simulation.courtyard.mesh import Mesh, join
from vioapr.simulation.courtyard.noise import fractal, to_pixels


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
    surfaces = {**repeating_materials(rng), **signs()}
    for side, house in fronts.items():
        size = tuple(n / px_per_m for n in house.picture.shape[1::-1])
        surfaces[side] = Material(to_pixels(house.picture), size)
    surfaces["ground"] = Material(to_pixels(ground.paint(rng, 0.8 * px_per_m)), ground.SIZE_M)
    parts = [*ground.build(), *houses.behind(rng), *layout.plant(rng), *layout.furnish(rng)]
    parts += [part for house in fronts.values() for part in house.parts]
    grouped: dict[str, list[Mesh]] = defaultdict(list)
    for material, mesh in parts:
        grouped[material].append(mesh)
    lamps_m = np.array([(*spot, 3.3) for spot in layout.LAMP_PLACES_M])
    return World(surfaces, {name: join(meshes) for name, meshes in grouped.items()}, lamps_m)


def repeating_materials(rng: np.random.Generator) -> dict[str, Material]:
    """Materials whose pictures repeat beyond their size, and leaves, by name."""
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
    return surfaces


def signs() -> dict[str, Material]:
    """The lettering on shops, a kiosk, a van and doors, by name."""
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
