"""From where, and in which directions, a place was recorded; and where views are missing.

A localizer that learns from pictures answers where it has seen the place from near and in the same
direction. So the ground that was walked on is divided into cells and directions into sectors, and
the training images of each are counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3

SECTORS = 8
"""Directions, the first about the world's x, counterclockwise."""
LEAST_VIEWS = 3
"""Images from near in a direction below which it has too few."""
WITHIN_DEG = 45.0
"""Images look the same way if their headings differ by at most this: phones see 60 to 70 deg."""

_STEEP = 0.9
"""Vertical part of a camera's direction above which it looks up or down, in no heading."""
_CELLS_ACROSS = 16
_SMALLEST_CELL_M, _LARGEST_CELL_M = 0.5, 4.0
_BLOCK = 3
"""Cells along a side of the areas that are named to people."""
_MOST_GAPS = 5


class Views(NamedTuple):
    """Where images were taken, and where they look, n of them.

    Attributes:
        position_m: From above, x and y of the world, shape (n, 2).
        heading_rad: Counterclockwise from x, shape (n,); NaN for those that look up or down.
    """

    position_m: FloatArray
    heading_rad: FloatArray

    @property
    def direction(self) -> FloatArray:
        """Unit vectors from above, shape (n, 2); NaN for those that look up or down."""
        columns = [np.cos(self.heading_rad), np.sin(self.heading_rad)]
        return np.stack(columns, axis=-1).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Counts of training images over c cells that somebody walked on.

    Attributes:
        cell_m: Side of a cell.
        cell: Numbers of each cell along x and y, shape (c, 2); cell (0, 0) begins at the origin.
        images: From within a cell's side of each cell's middle in each sector, shape (c, SECTORS).
        walks: How many recordings these are of, shape (c, SECTORS).
        asked: Images of other recordings that look from the cell in the sector, shape
            (c, SECTORS).
    """

    cell_m: float
    cell: NDArray[np.int64]
    images: NDArray[np.int64]
    walks: NDArray[np.int64]
    asked: NDArray[np.int64]

    @property
    def middle_m(self) -> FloatArray:
        """Of each cell, shape (c, 2)."""
        return _middles(self.cell, self.cell_m)

    @property
    def is_seen(self) -> NDArray[np.bool_]:
        """Whether a sector has enough images, shape (c, SECTORS)."""
        return self.images >= LEAST_VIEWS

    @property
    def all_round(self) -> float:
        """Share of the cells from which people looked in all directions but one, or in all."""
        return float((self.is_seen.sum(axis=1) >= SECTORS - 1).mean())

    @property
    def one_way(self) -> float:
        """Share of the cells without any two opposite directions: passed through one way only."""
        has_opposite = self.is_seen & np.roll(self.is_seen, SECTORS // 2, axis=1)
        return float((~has_opposite.any(axis=1)).mean())

    @property
    def one_walk(self) -> float:
        """Share of the directions with images that are of one recording alone."""
        seen = self.walks[self.is_seen]
        return float((seen == 1).mean()) if len(seen) else 1.0


class Gap(NamedTuple):
    """An area that lacks views.

    Attributes:
        position_m: Its middle from above, shape (2,).
        radius_m: About how far it reaches.
        sectors: Numbers of the directions in which few looked.
        asked: Images of other recordings that looked there in vain.
    """

    position_m: FloatArray
    radius_m: float
    sectors: tuple[int, ...]
    asked: int


def views_of(world_from_cam: Rigid3[FloatArray]) -> Views:
    """Look at cameras from above.

    Args:
        world_from_cam: Known poses in a world with z up, shape (n,).
    """
    forward = quaternion.rotate(world_from_cam.quat_xyzw, np.array([0.0, 0.0, 1.0]))
    heading_rad = np.arctan2(forward[:, 1], forward[:, 0])
    heading_rad[np.abs(forward[:, 2]) > _STEEP] = np.nan
    return Views(world_from_cam.translation_m[:, :2], heading_rad)


def measure_coverage(train: Sequence[Views], others: Sequence[Views] = ()) -> Coverage:
    """Count the images from each part of a place in each direction.

    Args:
        train: Of every training recording, at least one image in all.
        others: Of other recordings, which show where people walk and look too.
    """
    everywhere = np.concatenate([views.position_m for views in (*train, *others)])
    extent_m = float(np.ptp(everywhere, axis=0).max())
    cell_m = float(np.clip(extent_m / _CELLS_ACROSS, _SMALLEST_CELL_M, _LARGEST_CELL_M))
    cell = np.unique(np.floor(everywhere / cell_m).astype(np.int64), axis=0)
    counts = np.stack([_count_near(cell, cell_m, views) for views in train])
    asked = np.zeros((len(cell), SECTORS), dtype=np.int64)
    row_of = {tuple(key): row for row, key in enumerate(cell.tolist())}
    for views in others:
        known = np.isfinite(views.heading_rad)
        places = np.floor(views.position_m[known] / cell_m).astype(np.int64).tolist()
        for place, sector in zip(places, sector_of(views.heading_rad[known]), strict=True):
            asked[row_of[tuple(place)], sector] += 1
    return Coverage(cell_m, cell, counts.sum(axis=0), (counts > 0).sum(axis=0), asked)


def sector_of(heading_rad: FloatArray) -> NDArray[np.int64]:
    """The sectors that headings are in, shape (n,)."""
    return np.round(heading_rad / (2 * np.pi / SECTORS)).astype(np.int64) % SECTORS


def _count_near(cell: NDArray[np.int64], cell_m: float, views: Views) -> NDArray[np.int64]:
    """Images of one recording near each cell's middle in each sector, shape (c, SECTORS)."""
    angles = np.arange(SECTORS) * (2 * np.pi / SECTORS)
    toward = np.stack([np.cos(angles), np.sin(angles)])
    looks = (views.direction @ toward > np.cos(np.radians(WITHIN_DEG)) - 1e-9).astype(np.int64)
    middle_m = _middles(cell, cell_m)
    return np.stack([looks[is_near(views.position_m, one, cell_m)].sum(axis=0) for one in middle_m])


def is_near(position_m: FloatArray, point_m: FloatArray, within_m: float) -> NDArray[np.bool_]:
    """Which positions, shape (n, 2), are within a distance of a point."""
    return np.square(position_m - point_m).sum(axis=1) <= within_m**2


def _middles(cell: NDArray[np.int64], cell_m: float) -> FloatArray:
    return (cell.astype(np.float64) + 0.5) * cell_m


def find_gaps(coverage: Coverage) -> list[Gap]:
    """Find the areas that lack views most, the worst first.

    First those in which other recordings looked in vain, as others will; then those with the most
    cells and directions unseen. Areas that lack fewer than half of the directions are no gaps, nor
    is all of a place that is no larger than one area.
    """
    if (np.ptp(coverage.cell, axis=0) < _BLOCK).all():
        return []
    blocks: dict[tuple[int, int], list[int]] = {}
    for row, (x, y) in enumerate((coverage.cell // _BLOCK).tolist()):
        blocks.setdefault((x, y), []).append(row)
    ranked: list[tuple[int, int, Gap]] = []
    for rows in blocks.values():
        unseen = ~coverage.is_seen[rows]
        asked = int(coverage.asked[rows][unseen].sum())
        missing = unseen.mean(axis=0) > 0.5
        looked = (coverage.asked[rows] * unseen).sum(axis=0) > 0
        if not asked and missing.sum() < SECTORS / 2:
            continue
        middle_m = coverage.middle_m[rows]
        center_m = middle_m.mean(axis=0)
        reach_m = float(np.linalg.norm(middle_m - center_m, axis=1).max()) + coverage.cell_m / 2
        sectors = tuple(int(sector) for sector in np.flatnonzero(missing | looked))
        gap = Gap(center_m, reach_m, sectors, asked)
        ranked.append((asked, int(unseen.sum()), gap))
    ranked.sort(key=lambda one: one[:2], reverse=True)
    return [gap for _, _, gap in ranked[:_MOST_GAPS]]


def count_support(train: Sequence[Views], asked: Views, within_m: float) -> NDArray[np.int64]:
    """Count the training images from near that look the same way, for each of other images.

    Args:
        train: Of every training recording.
        asked: The other images, n of them.
        within_m: How far near is.

    Returns:
        Shape (n,).
    """
    position_m = np.concatenate([views.position_m for views in train])
    direction = np.concatenate([views.direction for views in train])
    least = np.cos(np.radians(WITHIN_DEG))
    counts = [
        int((direction[is_near(position_m, place_m, within_m)] @ toward > least).sum())
        for place_m, toward in zip(asked.position_m, asked.direction, strict=True)
    ]
    return np.array(counts, dtype=np.int64)
