"""All tracking worlds in one, by the two-view geometries between them.

Each has gravity and metres, so what is not known of it are a heading and a position. A pair of
images gives the heading, and a piece of a line on which the position is: along the direction
between the cameras, of roughly known length. Where most pieces meet is the position. A single
pair may be wrong, and half of all may be, where facades repeat.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.two_view import PairGeometries, between_worlds_deg

MAX_DISTANCE_M = 30.0
"""Cameras further apart hardly have matches."""

DISTANCE_FACTOR = 3.0
"""The factor by which the distance between two cameras may differ from what their matches say."""

MAX_TILT_DEG = 5.0
"""VIO's gravity is exact to tenths of degrees, the rotation between two images to a few."""

JOIN_HEADING_DEG, JOIN_M, JOIN_SHARE = 10.0, 1.0, 0.1
"""A pair agrees with a placement of its tracking worlds to this; both have drifted."""

MIN_AGREEING_PAIRS = 3
"""A tracking world is placed only where this many pairs of images agree on the place."""

DRAWS = 1000


class Links(NamedTuple):
    """Pairs as pieces of lines in a world, or worlds, with y up.

    Attributes:
        start_m: The first camera, shape (m, 3).
        direction: To the second, unit vectors, shape (m, 3).
        least_m: The least distance to it, shape (m,).
        most_m: The most, shape (m,).
        end_m: The second camera by its own pose, shape (m, 3).
        heading_deg: What the second camera's world must be turned by, shape (m,).
        tilt_deg: What no such turn explains, shape (m,).
    """

    start_m: NDArray[np.float64]
    direction: NDArray[np.float64]
    least_m: NDArray[np.float64]
    most_m: NDArray[np.float64]
    end_m: NDArray[np.float64]
    heading_deg: NDArray[np.float64]
    tilt_deg: NDArray[np.float64]

    def at(self, index: Any) -> Links:
        """Some of them."""
        return Links(*(column[index] for column in self))

    def reversed(self) -> Links:
        """From the second cameras, whose worlds are not turned yet, to the first."""
        turn = about_up(self.heading_deg)
        back = -quaternion.rotate(quaternion.inverse(turn), self.direction)
        return Links(self.end_m, back, self.least_m, self.most_m, self.start_m,
                     -self.heading_deg, self.tilt_deg)  # fmt: skip


def about_up(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turns about y, quaternions xyzw, shape (..., 4)."""
    half = np.radians(degrees) / 2
    zero = np.zeros_like(half)
    return np.stack([zero, np.sin(half), zero, np.cos(half)], axis=-1)


def link(found: PairGeometries, distance_m: NDArray[np.float64], poses: Rigid3) -> Links:
    """Pairs as pieces of lines.

    Args:
        found: Pairs.
        distance_m: Roughly between their cameras, shape (m,), NaN where unknown.
        poses: Of all images, in a world, or worlds, with y up.
    """
    first, second = found.rows.T
    is_known = np.isfinite(distance_m)
    return Links(
        poses.translation_m[first],
        quaternion.rotate(poses.quat_xyzw[first], found.direction),
        np.where(is_known, distance_m / DISTANCE_FACTOR, 0.0),
        np.where(is_known, np.minimum(distance_m * DISTANCE_FACTOR, MAX_DISTANCE_M),
                 MAX_DISTANCE_M),
        poses.translation_m[second],
        *between_worlds_deg(found, poses),
    )  # fmt: skip


def miss_m(links: Links) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From the nearest point of each piece to the second camera.

    Returns:
        The vector, shape (..., m, 3), and that point's distance from the first camera.
    """
    way = links.end_m - links.start_m
    along = np.clip((way * links.direction).sum(axis=-1), links.least_m, links.most_m)
    return way - along[..., None] * links.direction, along


def join_worlds(
    images: MapImages, found: PairGeometries, distance_m: NDArray[np.float64], seed: int
) -> tuple[Rigid3, NDArray[np.intp]]:
    """VIO of all tracking worlds in as few worlds as possible.

    Args:
        images: The images.
        found: Pairs.
        distance_m: Roughly between their cameras, shape (m,), NaN where unknown.
        seed: Of the random draws.

    Returns:
        Poses of all images, y up, NaN where VIO has none; and for every image the number of
        the joined world that it is in: that of one of its tracking worlds.
    """
    rng = np.random.default_rng(seed)
    poses = Rigid3(*(column.copy() for column in images.vio_from_cam))
    joined = images.tracking_world.copy()
    is_usable = can_be_joined(images, found)
    open_worlds = set(np.unique(images.tracking_world[images.has_vio]).tolist())
    while open_worlds:
        # The largest that is left is the first of a new group.
        group = max(open_worlds, key=lambda world: int((images.tracking_world == world).sum()))
        open_worlds.discard(group)
        while True:
            links = link(found, distance_m, poses)
            best = max(
                (
                    place_world(links, joined[found.rows], is_usable, group, world, rng)
                    for world in sorted(open_worlds)
                ),
                key=lambda placement: placement.support,
                default=None,
            )
            if best is None or best.support < MIN_AGREEING_PAIRS:
                break
            members = images.tracking_world == best.world
            turned = about_up(np.array(best.heading_deg))
            poses.translation_m[members] = (
                quaternion.rotate(turned, poses.translation_m[members]) + best.offset_m
            )
            poses.quat_xyzw[members] = quaternion.multiply(turned, poses.quat_xyzw[members])
            joined[members] = group
            open_worlds.discard(best.world)
    return poses, joined


def can_be_joined(images: MapImages, found: PairGeometries) -> NDArray[np.bool_]:
    """Pairs of images that both know metres and up, shape (m,)."""
    is_good = images.is_level & images.is_metric
    first, second = found.rows.T
    return is_good[first] & is_good[second]


class Placement(NamedTuple):
    """Where a tracking world is in a joined world, both with y up.

    Attributes:
        world: The tracking world's number.
        support: Number of pairs that agree.
        heading_deg: What it is turned by about y.
        offset_m: Then moved by, shape (3,).
    """

    world: int
    support: int
    heading_deg: float
    offset_m: NDArray[np.float64]


def place_world(
    links: Links, worlds: NDArray[np.intp], is_usable: NDArray[np.bool_], group: int, world: int,
    rng: np.random.Generator,
) -> Placement:  # fmt: skip
    """Find where a tracking world is in a joined world, by the pairs between them (RANSAC).

    Args:
        links: All pairs.
        worlds: The joined worlds that their images are in, shape (m, 2).
        is_usable: Shape (m,).
        group: The joined world.
        world: The tracking world.
        rng: Of the draws.

    Returns:
        The placement, with support 0 if there is none.
    """
    is_good = is_usable & (links.tilt_deg <= MAX_TILT_DEG)
    forth = links.at(is_good & (worlds == (group, world)).all(axis=1))
    back = links.at(is_good & (worlds == (world, group)).all(axis=1)).reversed()
    both = Links(*map(np.concatenate, zip(forth, back, strict=True)))
    nothing = Placement(world, 0, 0.0, np.zeros(3))
    if len(both.start_m) < MIN_AGREEING_PAIRS:
        return nothing
    # Draws of two pairs: their mean heading, and where their lines are nearest to each other.
    one, other = rng.integers(0, len(both.start_m), (2, DRAWS))
    apart = _apart_deg(both.heading_deg[other], both.heading_deg[one])
    is_likely = (one != other) & (np.abs(apart) <= JOIN_HEADING_DEG)
    one, other, apart = one[is_likely], other[is_likely], apart[is_likely]
    if not len(one):
        return nothing
    heading_deg = both.heading_deg[one] + apart / 2
    turned_m = quaternion.rotate(about_up(heading_deg)[:, None], both.end_m)
    offsets_m = meeting_offsets_m(both, turned_m, one, other)
    is_near = _agrees(both, heading_deg, turned_m + offsets_m[:, None])
    best = int(np.argmax(is_near.sum(axis=1)))
    return refine_placement(both, Placement(world, 0, float(heading_deg[best]), offsets_m[best]))


def _apart_deg(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    return (left - right + 180) % 360 - 180


def _agrees(
    links: Links, heading_deg: NDArray[np.float64], end_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which pairs agree with each placement, shape (placements, m)."""
    off_m, along_m = miss_m(links._replace(end_m=end_m))
    is_near = np.linalg.norm(off_m, axis=-1) <= JOIN_M + JOIN_SHARE * along_m
    apart = _apart_deg(links.heading_deg, np.asarray(heading_deg)[..., None])
    return is_near & (np.abs(apart) <= JOIN_HEADING_DEG)


def meeting_offsets_m(
    links: Links, turned_m: NDArray[np.float64], one: NDArray[np.intp], other: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Find the offsets at which two pairs' pieces of lines are nearest to each other.

    Args:
        links: The pairs, m of them.
        turned_m: Their second cameras, turned as each draw says, shape (d, m, 3).
        one: The first pair of each draw, shape (d,).
        other: The second, shape (d,).

    Returns:
        Shape (d, 3).
    """
    draw = np.arange(len(one))
    start = [links.start_m[rows] - turned_m[draw, rows] for rows in (one, other)]
    way = [links.direction[rows] for rows in (one, other)]
    limits = [(links.least_m[rows], links.most_m[rows]) for rows in (one, other)]
    cosine = (way[0] * way[1]).sum(axis=1)
    gap = start[1] - start[0]
    denominator = np.maximum(1 - cosine**2, 1e-6)
    first = ((gap * way[0]).sum(axis=1) - cosine * (gap * way[1]).sum(axis=1)) / denominator
    first = np.clip(first, *limits[0])
    second = ((first[:, None] * way[0] - gap) * way[1]).sum(axis=1)
    second = np.clip(second, *limits[1])
    return (start[0] + first[:, None] * way[0] + start[1] + second[:, None] * way[1]) / 2


def refine_placement(links: Links, placement: Placement) -> Placement:
    """Move a placement to the median of the pairs that agree with it, until these stay."""
    for _ in range(5):
        turned_m = quaternion.rotate(about_up(np.array(placement.heading_deg)), links.end_m)
        placed_m = turned_m + placement.offset_m
        is_near = _agrees(links, np.array(placement.heading_deg), placed_m)
        if not is_near.any():
            break
        off_m, _ = miss_m(links._replace(end_m=placed_m))
        apart = _apart_deg(links.heading_deg, np.array(placement.heading_deg))
        turn_deg = float(np.median(apart[is_near]))
        middle = placed_m[is_near].mean(axis=0)
        spun = quaternion.rotate(about_up(np.array(turn_deg)), placement.offset_m - middle)
        placement = placement._replace(
            support=int(is_near.sum()),
            heading_deg=placement.heading_deg + turn_deg,
            offset_m=middle + spun - np.median(off_m[is_near], axis=0),
        )
    return placement
