"""Two walks round a court, seen by two trackers, and what pairs of their images say: no pictures.

Every camera stands on a circle and looks outwards at a wall. A pair of images gives what
matched points give: relative rotation, direction of the way, and parallax.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.handheld import looking
from vioapr.simulation.trackers import dead_reckon

COUNT = 40
"""Images of each walk, one a second: rows 0 to 39 are the first walk's, 40 to 79 the second's."""
WALL_M = 8.0
"""From a camera to the wall that it looks at."""
HEADINGS_DEG = (15.0, -80.0)
"""Of the two trackers' worlds."""


class CourtWalks(NamedTuple):
    """The images of both walks, `2 * COUNT` of them.

    Attributes:
        timestamp_s: On the clock of its walk, shape (n,).
        walk: 0 or 1, shape (n,).
        world_from_cam: The true poses, shape (n,); z-up world.
        vio_from_cam: Shape (n,); y up, each walk in a tracking world of its own.
    """

    timestamp_s: NDArray[np.float64]
    walk: NDArray[np.intp]
    world_from_cam: Rigid3
    vio_from_cam: Rigid3


class TwoViews(NamedTuple):
    """What matches say of m pairs of images.

    Attributes:
        rows: The images, shape (m, 2).
        second_from_first: Rotations, quaternions xyzw, shape (m, 4).
        direction: From the first camera to the second, unit vectors in the axes of the first,
            shape (m, 3).
        turn_deg: Angle between the rays to a common point on the wall, shape (m,).
    """

    rows: NDArray[np.intp]
    second_from_first: NDArray[np.float64]
    direction: NDArray[np.float64]
    turn_deg: NDArray[np.float64]


def walk_court(rng: np.random.Generator, drift_deg: float = 3.0, jump_m: float = 0.0) -> CourtWalks:
    """Walk once round on circles of 6 m and of 7 m.

    Args:
        rng: Source of randomness.
        drift_deg: How much the second tracker's heading has turned away by its last image.
        jump_m: How far the second tracker jumps, half way round.
    """
    timestamp_s = np.tile(np.arange(COUNT, dtype=np.float64), 2)
    walk = np.repeat([0, 1], COUNT)
    heading = np.deg2rad(90 + 360 / COUNT * timestamp_s)
    pitch = np.deg2rad(rng.uniform(-10, 10, 2 * COUNT))
    height = 1.5 + 0.05 * rng.standard_normal(2 * COUNT)
    radius = np.array([6.0, 7.0])[walk]
    position = np.stack([radius * np.cos(heading), radius * np.sin(heading), height], axis=-1)
    zero = np.zeros_like(pitch)
    truth = Rigid3(position, looking(heading, np.stack([zero, pitch, zero], axis=-1)))
    first, second = truth.at(walk == 0), truth.at(walk == 1)
    jump = np.zeros((COUNT, 3))
    jump[COUNT // 2, 0] = jump_m
    own = [np.full(COUNT, degrees) for degrees in HEADINGS_DEG]
    drifting = np.deg2rad(own[1] + np.linspace(0, drift_deg, COUNT))
    vio = dead_reckon(first, np.deg2rad(own[0])), dead_reckon(second, drifting, 1.0, jump)
    return CourtWalks(
        timestamp_s, walk, truth, Rigid3(*(np.concatenate(part) for part in zip(*vio, strict=True)))
    )


def see_pairs(
    world_from_cam: Rigid3,
    rows: ArrayLike,
    noise_deg: float = 0.5,
    rng: np.random.Generator | None = None,
) -> TwoViews:
    """The two-view geometries of images that were taken at these poses.

    Args:
        world_from_cam: Poses of all images, in any world.
        rows: Pairs of images, shape (m, 2).
        noise_deg: Of rotations and directions, standard deviation per axis.
        rng: Source of that noise; None for one that always starts alike.
    """
    pairs = np.asarray(rows, dtype=np.intp).reshape(-1, 2)
    noise = rng or np.random.default_rng(1)

    def shake() -> NDArray[np.float64]:
        rotvec = np.deg2rad(noise_deg) * noise.standard_normal((len(pairs), 3))
        return quaternion.from_rotvec(rotvec)

    way = rigid.between(world_from_cam.at(pairs[:, 0]), world_from_cam.at(pairs[:, 1]))
    length_m = np.linalg.norm(way.translation_m, axis=1)
    direction = way.translation_m / np.maximum(length_m, 1e-9)[:, None]
    return TwoViews(
        pairs,
        quaternion.multiply(quaternion.inverse(way.quat_xyzw), shake()),
        quaternion.rotate(shake(), direction),
        np.degrees(2 * np.arctan(length_m / WALL_M / 2)),
    )


def sequential_rows(steps: int = 2) -> list[tuple[int, int]]:
    """Pairs of neighbours within both walks, up to `steps` images apart."""
    return [
        (row, row + step)
        for start in (0, COUNT)
        for step in range(1, steps + 1)
        for row in range(start, start + COUNT - step)
    ]


def crossing_rows(every: int = 2, shift: int = 1) -> list[tuple[int, int]]:
    """Pairs of images of the two walks that see the same wall."""
    return [(row, COUNT + (row + shift) % COUNT) for row in range(0, COUNT, every)]


def moved_along(world_from_cam: Rigid3, rows: ArrayLike, offset_m: float) -> Rigid3:
    """Poses of which some are shifted along the wall that they look at, to their right."""
    position, rows = world_from_cam.translation_m.copy(), np.asarray(rows)
    right = quaternion.rotate(world_from_cam.quat_xyzw[rows], np.array([1.0, 0.0, 0.0]))
    position[rows] += offset_m * right
    return world_from_cam._replace(translation_m=position)
