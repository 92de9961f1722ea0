"""Where plants and furniture stand in the yard, in world coordinates.

The places are always the same; the generator draws their shapes.
"""

from __future__ import annotations

import numpy as np

from vioapr.simulation.courtyard import furniture, plants
from vioapr.simulation.courtyard.furniture import place
from vioapr.simulation.courtyard.mesh import Parts

LAMP_PLACES_M = ((-14.5, 7.5), (0.0, 8.2), (14.5, 7.5), (-14.5, -7.5), (0.0, -8.2), (14.5, -7.5))
"""Of street lamps, x and y."""


def plant(rng: np.random.Generator) -> Parts:
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


def furnish(rng: np.random.Generator) -> Parts:
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
    parts += pots(rng)
    return parts


def pots(rng: np.random.Generator) -> Parts:
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
