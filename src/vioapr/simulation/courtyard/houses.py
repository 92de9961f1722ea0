"""The four houses around the yard, their roofs, and what rises behind them.

North and south are 36 m long, east and west 26 m. East and west share one rhythm of windows
and balconies, and the north house has two equal entrances: places that look alike.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from vioapr.simulation.courtyard import facades, materials, posters
from vioapr.simulation.courtyard.furniture import IRON, flipped
from vioapr.simulation.courtyard.mesh import Mesh, Parts, box, join, lathe, patch, rod
from vioapr.simulation.courtyard.noise import Field, coordinates_m, mix
from vioapr.simulation.courtyard.openings import Opening
from vioapr.simulation.courtyard.plants import climber

LENGTH_M, WIDTH_M = 36.0, 26.0
"""Of the yard along x and y, m; its middle is the world's origin."""


class House(NamedTuple):
    """A facade's picture and everything that stands on its line, in world coordinates."""

    picture: Field
    parts: Parts


class _Site(NamedTuple):
    """Where a facade's own coordinates lie in the world."""

    offset_m: tuple[float, float, float]
    yaw_deg: float


_SITES = {
    "north": _Site((-LENGTH_M / 2, WIDTH_M / 2, 0), 0.0),
    "east": _Site((LENGTH_M / 2, WIDTH_M / 2, 0), -90.0),
    "south": _Site((LENGTH_M / 2, -WIDTH_M / 2, 0), 180.0),
    "west": _Site((-LENGTH_M / 2, -WIDTH_M / 2, 0), 90.0),
}


def build_all(rng: np.random.Generator, px_per_m: float) -> dict[str, House]:
    """The four houses by the side on which they stand."""
    makers = {"north": north, "east": east, "south": south, "west": west}
    houses = {}
    for side, make in makers.items():
        house = make(rng, px_per_m)
        site = _SITES[side]
        houses[side] = house._replace(
            parts=[(material, mesh.moved(*site)) for material, mesh in house.parts]
        )
    return houses


def behind(rng: np.random.Generator) -> Parts:
    """The surroundings above the roofs: a church tower, a higher house, a chimney stack."""
    tower = box((25, 21, 0), (31, 27, 23), faces="sw", cell_m=4)
    clock = lathe([(1.5, 0), (0.0, 0.1)], sides=16, tint=(1.3, 1.25, 1.1))
    spire = lathe([(4.4, 23), (0.3, 33), (0.0, 33)], sides=4, smooth=False, centre_m=(28, 24, 0),
                  tint=(0.38, 0.62, 0.54))  # fmt: skip
    bells = [box((x, 20.9, 18), (x + 1.2, 21, 21), faces="s", tint=0.12) for x in (26.2, 28.6)]
    face = replace(
        clock,
        position_m=(clock.position_m[:, [0, 2, 1]] * [1, -1, 1] + [28, 20.95, 15.5]).astype("f4"),
        normal=np.broadcast_to(np.array([0, -1, 0], np.float32), clock.normal.shape),
    )
    block = box((-36, -24, 0), (-26, -8, 17), faces="en", cell_m=4, tint=(1.0, 0.96, 0.9))
    stack = lathe([(1.1, 0), (0.8, 24)], sides=10, centre_m=(-8, -30, 0))
    return [("ashlar", join([tower, *bells])), ("painted", join([spire, face])),
            ("roof", stack), ("ashlar", block)]  # fmt: skip


def _canvas(width_m: float, height_m: float, px_per_m: float) -> tuple[int, int]:
    return round(height_m * px_per_m), round(width_m * px_per_m)


def north(rng: np.random.Generator, px_per_m: float) -> House:
    """Red brick, twelve bays of sash windows on three floors, two equal entrances."""
    height = 11.0
    wall = materials.brick(rng, _canvas(LENGTH_M, height, px_per_m), px_per_m)
    sash = Opening(0, 0, 1.2, 1.75, panes=(2, 4))
    door = Opening(0, 0, 1.4, 2.9, "door", (0.13, 0.22, 0.17), depth_m=0.35)
    doors = (2, 9)
    openings = [
        *facades.row(1.5, 3.0, 12, 1.0, sash, without=doors),
        *facades.row(1.5, 3.0, 12, 4.5, replace(sash, height_m=1.95)),
        *facades.row(1.5, 3.0, 12, 8.0, replace(sash, height_m=1.6)),
        *facades.row(7.5, 21.0, 2, 0.0, door),
    ]
    _graffiti(rng, wall, px_per_m, count=3)
    facade = facades.build(rng, wall, openings, px_per_m)
    band = box((0, -0.08, 3.75), (LENGTH_M, 0, 3.98), faces="stb")
    steps = [box((x - 1.0, -0.5 - 0.3 * k, 0), (x + 1.0, 0, 0.17 * (2 - k)), faces="sewt")
             for x in (7.5, 28.5) for k in (0, 1)]  # fmt: skip
    hoods = [box((x - 1.0, -0.7, 3.15), (x + 1.0, 0, 3.3)) for x in (7.5, 28.5)]
    stone = join([facades.sills(facade.openings), facades.lintels(facade.openings), band, *steps,
                  *hoods])  # fmt: skip
    lamps = [box((x + 1.15, -0.25, 2.3), (x + 1.35, -0.02, 2.65), glow=4.0) for x in (7.5, 28.5)]
    ivy = climber(rng, 5.0, 8.0).moved((31.8, 0, 0))
    parts: Parts = [
        ("north", facade.mesh), ("limestone", stone), ("leaves", ivy),
        ("painted", join([*_pipes((0.15, 12.05, 24.05, 35.85), height), *lamps])),
        *_roof(LENGTH_M, height, rng, dormers=(6.0, 15.0, 24.0)),
        ("sign_14", patch((8.65, -0.03, 1.7), (0.4, 0, 0), (0, 0, 0.3))),
        ("sign_16", patch((29.65, -0.03, 1.7), (0.4, 0, 0), (0, 0, 0.3))),
    ]  # fmt: skip
    return House(facade.picture, parts)


def south(rng: np.random.Generator, px_per_m: float) -> House:
    """Ochre plaster over an arcade of nine bays, shutters above."""
    height = 10.5
    wall = materials.plaster(rng, _canvas(LENGTH_M, height, px_per_m), px_per_m)
    arch = Opening(0, 0, 2.6, 3.3, "arcade", depth_m=2.2, arched=True)
    casement = Opening(0, 0, 1.0, 1.7, color=(0.62, 0.56, 0.46), panes=(2, 3))
    upper = [
        *facades.row(1.5, 3.0, 12, 5.0, casement),
        *facades.row(1.5, 3.0, 12, 8.1, replace(casement, height_m=1.35, panes=(2, 2))),
    ]
    facade = facades.build(rng, wall, [*facades.row(2.0, 4.0, 9, 0.0, arch), *upper], px_per_m)
    keep = [bool(rng.random() < 0.8) for _ in upper]
    shutters = facades.shutters(tuple(upper), keep).tinted((0.24, 0.4, 0.34))
    capitals = [box((x - 0.75, -0.07, z), (x + 0.75, 0, z + 0.16), faces="sewtb")
                for x in np.arange(4.0, LENGTH_M - 1, 4.0) for z in (0.02, 1.85)]  # fmt: skip
    band = box((0, -0.1, 4.2), (LENGTH_M, 0, 4.4), faces="stb")
    lanterns = [box((x - 0.12, 0.9, 2.6), (x + 0.12, 1.15, 3.0), glow=5.0)
                for x in np.arange(2.0, LENGTH_M, 8.0)]  # fmt: skip
    parts: Parts = [
        ("south", facade.mesh),
        ("limestone", join([facades.sills(tuple(upper)), *capitals, band])),
        ("wood", shutters),
        ("painted", join([*_pipes((0.15, 18.0, 35.85), height), *lanterns])),
        *_roof(LENGTH_M, height, rng),
    ]
    return House(facade.picture, parts)


def _twin_upper(color: tuple[float, float, float]) -> list[Opening]:
    """Two floors of windows that the east and the west house have in common."""
    window = Opening(0, 0, 1.15, 1.6, color=color, panes=(2, 2))
    french = replace(window, height_m=2.15, panes=(2, 3))
    return [
        *facades.row(2.15, 3.1, 8, 4.5, french, without=(0, 3, 4, 7)),
        *facades.row(2.15, 3.1, 8, 4.9, replace(window, height_m=1.75), without=(1, 2, 5, 6)),
        *facades.row(2.15, 3.1, 8, 7.8, window),
    ]


def east(rng: np.random.Generator, px_per_m: float) -> House:
    """A café and a shop in sandstone, pale yellow plaster with balconies above."""
    height = 10.2
    shape = _canvas(WIDTH_M, height, px_per_m)
    _, y = coordinates_m(shape, px_per_m)
    wall = materials.plaster(rng, shape, px_per_m, (0.82, 0.77, 0.6), decay=0.8)
    base = materials.ashlar(rng, shape, px_per_m)
    wall = np.where((y < 3.75)[..., None], base, wall).astype(np.float32)
    shop = Opening(0, 0, 3.0, 2.3, "shop", (0.2, 0.16, 0.13), panes=(3, 1), depth_m=0.25)
    door = Opening(0, 0, 1.3, 2.8, "door", (0.33, 0.17, 0.12), depth_m=0.4)
    ground = [
        *facades.row(4.0, 5.0, 2, 0.55, shop), *facades.row(17.5, 5.0, 2, 0.55, shop),
        *facades.row(12.2, 0, 1, 0.0, door), *facades.row(14.6, 0, 1, 0.0, door),
    ]  # fmt: skip
    upper = _twin_upper((0.88, 0.87, 0.83))
    facade = facades.build(rng, wall, [*ground, *upper], px_per_m)
    awnings = [patch((x - 1.7, -1.3, 2.45), (3.4, 0, 0), (0, 1.3, 0.75)) for x in (4.0, 9.0)]
    parts: Parts = [
        ("east", facade.mesh), *_balconies(),
        ("limestone", join([facades.sills(facade.openings), _band(WIDTH_M, 3.75)])),
        ("stripes", join([*awnings, *map(flipped, awnings)])),
        ("sign_cafe", patch((2.3, -0.06, 3.2), (8.4, 0, 0), (0, 0, 0.5))),
        ("sign_books", patch((16.0, -0.06, 3.1), (8.0, 0, 0), (0, 0, 0.55))),
        ("painted", join(_pipes((0.2, 25.8), height))), *_roof(WIDTH_M, height, rng),
    ]  # fmt: skip
    return House(facade.picture, parts)


def west(rng: np.random.Generator, px_per_m: float) -> House:
    """A passage to the street, two garages and a mural; above, the east house's windows."""
    height = 10.2
    shape = _canvas(WIDTH_M, height, px_per_m)
    wall = materials.plaster(rng, shape, px_per_m, (0.72, 0.6, 0.54), decay=1.1)
    gate = Opening(11.2, 0, 3.6, 3.55, "gate", depth_m=5.5, arched=True)
    garage = Opening(0, 0, 2.7, 2.5, "door", (0.36, 0.4, 0.43), depth_m=0.2)
    colors, cover = posters.mural(rng, (round(7.0 * px_per_m), round(2.9 * px_per_m)))
    rows, left = slice(shape[0] - round(3.4 * px_per_m), None), round(1.0 * px_per_m)
    region = wall[rows, left:][: len(cover), : cover.shape[1]]
    region[:] = mix(region, colors, cover)
    _graffiti(rng, wall, px_per_m, count=5)
    ground = [gate, *facades.row(17.6, 4.4, 2, 0.0, garage)]
    facade = facades.build(rng, wall, [*ground, *_twin_upper((0.85, 0.86, 0.86))], px_per_m)
    keystones = box((12.6, -0.08, 3.4), (13.4, 0, 4.0), faces="sewtb")
    parts: Parts = [
        ("west", facade.mesh), *_balconies(),
        ("limestone", join([facades.sills(facade.openings), _band(WIDTH_M, 4.15), keystones])),
        ("posters", patch((9.0, -0.02, 0.9), (1.5, 0, 0), (0, 0, 1.7), uv_m=(2.4, 0.3))),
        ("painted", join(_pipes((0.2, 15.5, 25.8), height))), *_roof(WIDTH_M, height, rng),
    ]  # fmt: skip
    return House(facade.picture, parts)


def _band(width_m: float, z_m: float) -> Mesh:
    return box((0, -0.1, z_m), (width_m, 0, z_m + 0.2), faces="stb")


def _balconies() -> Parts:
    """Two balconies with iron railings, before the middle French windows of either half."""
    slabs, rails = [], []
    for middle in (2.15 + 1.5 * 3.1, 2.15 + 5.5 * 3.1):
        x0, x1 = middle - 2.5, middle + 2.5
        slabs.append(box((x0, -1.0, 4.3), (x1, 0, 4.48), faces="sewtb"))
        rails.append(box((x0, -1.0, 5.35), (x1, -0.95, 5.4)))
        bars = [(x, -0.98) for x in np.arange(x0 + 0.02, x1, 0.17)]
        bars += [(x, y) for x in (x0 + 0.03, x1 - 0.03) for y in np.arange(-0.9, 0, 0.2)]
        rails += [rod((x, y, 4.48), (x, y, 5.37), (0.012, 0.012), sides=3) for x, y in bars]
    return [("limestone", join(slabs)), ("painted", join(rails).tinted(IRON))]


def _pipes(places_m: tuple[float, ...], height_m: float) -> list[Mesh]:
    """Rain pipes from the gutter to the ground."""
    return [
        rod((x, -0.09, 0.0), (x, -0.09, height_m), (0.055, 0.055), tint=(0.4, 0.42, 0.4))
        for x in places_m
    ]


def _roof(
    width_m: float, height_m: float, rng: np.random.Generator, dormers: tuple[float, ...] = ()
) -> Parts:
    """A cornice, a gutter and a tiled slope with chimneys, in the facade's coordinates."""
    cornice = join([
        box((0, -0.14, height_m - 0.35), (width_m, 0, height_m - 0.12), faces="stb"),
        box((0, -0.3, height_m - 0.12), (width_m, 0, height_m + 0.05), faces="stb"),
    ])  # fmt: skip
    gutter = box((0, -0.5, height_m + 0.02), (width_m, -0.3, height_m + 0.16), faces="stb",
                 tint=(0.36, 0.4, 0.38))  # fmt: skip
    slope = patch((-5, -0.45, height_m + 0.1), (width_m + 10, 0, 0), (0, 6, 4.0), cell_m=3)
    chimneys = []
    for x in np.sort(rng.uniform(2, width_m - 2, max(2, round(width_m / 9)))):
        y = rng.uniform(1.5, 4.0)
        top = height_m + 0.66 * y + rng.uniform(1.3, 2.2)
        chimneys.append(box((x, y, height_m), (x + 0.9, y + 0.6, top), faces="sewnt"))
    return [("limestone", cornice), ("painted", gutter), ("roof", join([slope, *chimneys])),
            *(part for x in dormers for part in dormer(x, height_m))]  # fmt: skip


def dormer(x_m: float, height_m: float) -> Parts:
    """A window in the roof."""
    low, front = height_m + 0.7, 0.9
    walls = box((x_m - 0.8, front, low), (x_m + 0.8, 3.5, low + 1.5), faces="sew", tint=0.85)
    glass = patch((x_m - 0.5, front - 0.02, low + 0.3), (1.0, 0, 0), (0, 0, 1.05), gloss=0.8,
                  tint=(0.1, 0.11, 0.13))  # fmt: skip
    bars = [(x_m + d - 0.04, x_m + d + 0.04) for d in (-0.5, 0, 0.5)]
    frame = join([box((a, front - 0.06, low + 0.25), (b, front, low + 1.4)) for a, b in bars])
    cover = join([
        patch((x_m - 1.0, front - 0.2, low + 1.35), (1.0, 0, 0.6), (0, 3.5, 0)),
        patch((x_m, front - 0.2, low + 1.95), (1.0, 0, -0.6), (0, 3.5, 0)),
    ])  # fmt: skip
    gable = Mesh.build(
        [(x_m - 0.8, front, low + 1.5), (x_m + 0.8, front, low + 1.5), (x_m, front, low + 1.9)],
        (0, -1, 0), [(0, 0), (1.6, 0), (0.8, 0.4)], [[0, 1, 2]], tint=0.85,
    )  # fmt: skip
    return [("limestone", join([walls, gable])), ("painted", join([glass, frame])), ("roof", cover)]


def _graffiti(rng: np.random.Generator, wall: Field, px_per_m: float, count: int) -> None:
    """Sprayed scrawls at a hand's height, in place."""
    for _ in range(count):
        size = (round(rng.uniform(0.9, 2.2) * px_per_m), round(rng.uniform(0.5, 1.0) * px_per_m))
        cover = posters.tag(rng, size)
        left = int(rng.integers(0, wall.shape[1] - size[0]))
        top = len(wall) - round(rng.uniform(0.7, 1.6) * px_per_m) - size[1] // 2
        region = wall[top : top + size[1], left : left + size[0]]
        region[:] = mix(region, rng.uniform(0, 0.8, 3), cover[: len(region)])
