"""Windows, doors and shop fronts: painted into a facade's picture where its wall is open.

Every painter takes the size of its picture in pixels, the opening and the density, and returns
a picture of shape (h, w, 3), 0 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vioapr.simulation.courtyard import interiors, materials
from vioapr.simulation.courtyard.materials import Color
from vioapr.simulation.courtyard.noise import Field, coordinates_m, fractal, mix, step

Kind = Literal["window", "shop", "door", "arcade", "gate"]


@dataclass(frozen=True)
class Opening:
    """A hole in a wall and what is in it.

    Attributes:
        left_m: From the facade's left edge, m.
        bottom_m: Above the ground, m.
        width_m: Of the hole.
        height_m: Of the hole.
        kind: Of the opening, by which it is painted.
        color: Of its frame or leaf.
        depth_m: How far its pane lies behind the wall.
        panes: Columns and rows of glass.
        arched: Whether its head is round.
    """

    left_m: float
    bottom_m: float
    width_m: float
    height_m: float
    kind: Kind = "window"
    color: Color = (0.85, 0.84, 0.8)
    depth_m: float = 0.16
    panes: tuple[int, int] = (2, 3)
    arched: bool = False

    def rows_and_columns(self, height_px: int, px_per_m: float) -> tuple[slice, slice]:
        """Where it lies in the facade's picture."""
        top = height_px - round((self.bottom_m + self.height_m) * px_per_m)
        bottom = height_px - round(self.bottom_m * px_per_m)
        left, right = (round(x * px_per_m) for x in (self.left_m, self.left_m + self.width_m))
        return slice(max(top, 0), bottom), slice(left, right)


def paint(rng: np.random.Generator, picture: Field, opening: Opening, px_per_m: float) -> None:
    """Paint an opening into the picture of its facade, in place."""
    rows, columns = opening.rows_and_columns(len(picture), px_per_m)
    shape = picture[rows, columns].shape[:2]
    painters = {"window": window, "shop": window, "door": door, "arcade": arcade, "gate": gate}
    picture[rows, columns] = painters[opening.kind](rng, shape, opening, px_per_m)


def window(
    rng: np.random.Generator, shape: tuple[int, int], opening: Opening, px_per_m: float
) -> Field:
    """Glass with a room behind it, curtains or blinds, and a frame."""
    room = interiors.shop if opening.kind == "shop" else interiors.room
    picture = room(rng, shape, px_per_m)
    haze = fractal(rng, shape, slope=1.6)
    picture = mix(picture, (0.62, 0.68, 0.74), np.clip(0.12 + 0.08 * haze, 0, 1))
    # The frame and its bars are where this is 1, and the glass is where it is 0.
    x, y = coordinates_m(shape, px_per_m)
    width, height = shape[1] / px_per_m, shape[0] / px_per_m
    to_edge = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    frame = step(to_edge, 0.085, 0.065)
    columns, rows = opening.panes
    for lines, size, coordinate in ((columns, width, x), (rows, height, y)):
        for number in range(1, lines):
            bar = 0.035 if number * 2 == lines else 0.02
            distance = np.abs(coordinate - size * number / lines) + 0 * frame
            frame = np.maximum(frame, step(distance, bar + 0.01, bar - 0.01))
    wood = materials.painted(rng, shape, opening.color)
    shadow = np.roll(frame, (3, 2), axis=(0, 1))
    return mix(mix(picture, (0.03, 0.03, 0.03), 0.5 * shadow), wood, frame)


def door(
    rng: np.random.Generator, shape: tuple[int, int], opening: Opening, px_per_m: float
) -> Field:
    """A panelled double door under a fanlight."""
    x, y = coordinates_m(shape, px_per_m)
    width, height = shape[1] / px_per_m, shape[0] / px_per_m
    leaf_height = min(height, 2.25)
    light = 1 + 0.08 * fractal(rng, shape, slope=0.8, stretch=10)
    picture = np.asarray(opening.color, dtype=np.float32) * light[..., None]
    half = np.minimum(x % (width / 2), width / 2 - x % (width / 2))
    panel_height = leaf_height / 3
    across = np.minimum(y % panel_height, panel_height - y % panel_height)
    to_edge = np.minimum(half, across)
    picture *= (1 - 0.45 * np.exp(-np.square((to_edge - 0.1) / 0.018)))[..., None]
    picture *= (1 + 0.25 * np.exp(-np.square((to_edge - 0.135) / 0.015)))[..., None]
    picture = mix(picture, (0.05, 0.04, 0.04), 0.9 * (np.abs(x - width / 2) + 0 * y < 0.012))
    picture = mix(picture, (0.25, 0.23, 0.2), 0.5 * step(y + 0 * x, 0.3, 0.0))  # splashes of rain
    handle = np.hypot(x - width / 2 - 0.09, y - 1.05) < 0.045
    picture = mix(picture, (0.8, 0.66, 0.3), 0.95 * handle)
    above = y + 0 * x > leaf_height
    fan = 0.12 + 0.1 * fractal(rng, shape, slope=1.5)[..., None] + np.array([0.02, 0.05, 0.08])
    spokes = np.sin(9 * np.arctan2(y - leaf_height, x - width / 2)) > 0.88
    fan = mix(fan, opening.color, 1.0 * spokes)
    picture = mix(picture, fan, 1.0 * above)
    return mix(picture, opening.color, 1.0 * (np.abs(y + 0 * x - leaf_height) < 0.05))


def arcade(
    rng: np.random.Generator, shape: tuple[int, int], opening: Opening, px_per_m: float
) -> Field:
    """The back wall of an arcade: whitewashed, each bay with a door, a window or a notice."""
    picture = materials.plaster(rng, shape, px_per_m, (0.74, 0.7, 0.62), decay=0.9)
    _, y = coordinates_m(shape, px_per_m)
    picture = mix(picture, rng.choice([[0.45, 0.2, 0.17], [0.3, 0.36, 0.4], [0.42, 0.38, 0.3]]),
                  0.75 * np.broadcast_to(y < 1.05, shape))  # fmt: skip
    width = shape[1] / px_per_m
    if rng.random() < 0.55:
        color = rng.choice([[0.2, 0.3, 0.25], [0.38, 0.22, 0.14], [0.24, 0.28, 0.42]])
        inner = Opening(width / 2 - 0.6, 0.0, 1.2, 2.6, "door", tuple(color))
    else:
        inner = Opening(width / 2 - 0.8, 1.1, 1.6, 1.4, "window", (0.35, 0.25, 0.18), panes=(3, 2))
    paint(rng, picture, inner, px_per_m)
    return picture * 0.9


def gate(
    rng: np.random.Generator, shape: tuple[int, int], opening: Opening, px_per_m: float
) -> Field:
    """The far end of a passage: a street in the light, behind iron bars."""
    x, y = coordinates_m(shape, px_per_m)
    width = shape[1] / px_per_m
    haze = 0.78 + 0.05 * fractal(rng, shape, slope=1.4)
    picture = haze[..., None] * np.array([0.93, 0.96, 1.0], dtype=np.float32)
    house = materials.plaster(rng, shape, px_per_m, (0.6, 0.5, 0.4))
    picture = mix(picture, house, 1.0 * ((x < 0.55 * width) & (y < 3.4)))
    street = materials.cobbles(rng, shape, px_per_m)
    picture = mix(picture, street, 1.0 * np.broadcast_to(y < 0.9, shape))
    bars = (np.abs(x % 0.16 - 0.08) < 0.016) | (np.abs(y % 1.4 - 0.7) < 0.03)
    return mix(picture, (0.06, 0.07, 0.07), 1.0 * bars)
