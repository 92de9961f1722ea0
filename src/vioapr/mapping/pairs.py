"""Which images to match: neighbours in time or, by VIO, in space, and images that look alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.vectors import angle_between_deg, step_lengths_m
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.params import MappingParams

Pairs = NDArray[np.intp]
"""Rows of two images each, shape (m, 2), the smaller first."""

NEAR_M = 10.0
NEAR_DEG = 60.0
"""Cameras further apart, or looking more differently, hardly see the same things."""

DRIFT_M, DRIFT_SHARE = 15.0, 0.1
"""Images of one tracking world that look alike are compared only if VIO, drifting by this much
and this share of the way between them, allows that they see the same place."""


def first_pairs(
    images: MapImages, rows: NDArray[np.intp], likeness: NDArray[np.float32], params: MappingParams
) -> Pairs:
    """Pairs of training images that follow each other, or look alike.

    Args:
        images: All images.
        rows: Those of the training recordings.
        likeness: Between these, shape (len(rows), len(rows)).
        params: How many of each kind.

    Returns:
        Sorted, none twice.
    """
    sequential = sequential_pairs(images, rows, params.sequential)
    alike = loop_pairs(images, rows, likeness, params.loops, params.sequential)
    return unique_pairs(np.concatenate([sequential, alike]))


def near_pairs(
    images: MapImages,
    rows: NDArray[np.intp],
    world_from_cam: Rigid3,
    world: NDArray[np.intp],
    params: MappingParams,
) -> Pairs:
    """Pairs of training images that are near and look the same way.

    Args:
        images: All images.
        rows: Those of the training recordings.
        world_from_cam: Poses of all images, NaN where unknown.
        world: The world that each is in.
        params: How many for each image.

    Returns:
        Sorted, none twice.
    """
    is_known = world_from_cam.is_known
    chosen = [np.zeros((0, 2), dtype=np.intp)]
    for one in np.unique(world[rows]):
        members = rows[(world[rows] == one) & is_known[rows]]
        poses = world_from_cam.at(members)
        chosen.append(spatial_pairs(images, members, poses, params.spatial, params.sequential))
    return unique_pairs(np.concatenate(chosen))


def sequential_pairs(images: MapImages, rows: NDArray[np.intp], count: int) -> Pairs:
    """Every image with those that follow it in its recording."""
    pairs = [np.zeros((0, 2), dtype=np.intp)]
    for recording in np.unique(images.recording[rows]):
        members = rows[images.recording[rows] == recording]
        for step in range(1, min(count, len(members) - 1) + 1):
            pairs.append(np.column_stack([members[:-step], members[step:]]))
    return np.concatenate(pairs)


def spatial_pairs(
    images: MapImages, rows: NDArray[np.intp], world_from_cam: Rigid3, count: int, apart: int
) -> Pairs:
    """Every image with the nearest that look its way.

    Args:
        images: All images.
        rows: Those of one world.
        world_from_cam: Their poses.
        count: Largest number for each image.
        apart: Images that follow each other this closely are matched anyway.
    """
    positions = world_from_cam.translation_m
    views = viewing_directions(world_from_cam.quat_xyzw)
    pairs = [np.zeros((0, 2), dtype=np.intp)]
    for k, row in enumerate(rows) if count else ():
        cost = view_cost(positions, views, positions[k], views[k])
        is_same = images.recording[rows] == images.recording[row]
        cost[is_same & (np.abs(rows - row) <= apart)] = np.inf
        pairs.append(_with_best(rows, row, -cost, count))
    return np.concatenate(pairs)


def viewing_directions(quat_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Optical axes, unit vectors, shape (n, 3)."""
    return quaternion.rotate(quat_xyzw, np.array([0.0, 0.0, 1.0]))


def view_cost(
    positions: NDArray[np.float64],
    views: NDArray[np.float64],
    position: NDArray[np.float64],
    view: NDArray[np.float64],
) -> NDArray[np.float64]:
    """How differently cameras see from one of them, shape (n,); infinite beyond the limits."""
    distance_m = np.linalg.norm(positions - position, axis=1)
    angle_deg = angle_between_deg(views, view)
    cost = distance_m / NEAR_M + angle_deg / NEAR_DEG
    return np.where((distance_m <= NEAR_M) & (angle_deg <= NEAR_DEG), cost, np.inf)


def loop_pairs(
    images: MapImages, rows: NDArray[np.intp], likeness: NDArray[np.float32], count: int, apart: int
) -> Pairs:
    """Every image with those most like it: of other tracking worlds, and of other times.

    Of its own tracking world only half as many: there, VIO finds most.
    """
    worlds = images.tracking_world[rows]
    positions = images.vio_from_cam.translation_m[rows]
    # The way up to every image; steps without VIO pose count nothing.
    walked_m = np.concatenate([[0.0], np.cumsum(np.nan_to_num(step_lengths_m(positions)))])
    pairs = [np.zeros((0, 2), dtype=np.intp)]
    for k in range(len(rows)) if count else ():
        is_other = worlds != worlds[k]
        pairs.append(_with_best(rows, rows[k], np.where(is_other, likeness[k], -np.inf), count))
        is_later = ~is_other & (np.abs(np.arange(len(rows)) - k) > apart)
        apart_m = np.linalg.norm(positions - positions[k], axis=1)
        limit_m = DRIFT_M + DRIFT_SHARE * np.abs(walked_m - walked_m[k])
        is_later &= ~(apart_m > limit_m)  # without VIO pose: not known to be too far
        own = np.where(is_later, likeness[k], -np.inf)
        pairs.append(_with_best(rows, rows[k], own, -(-count // 2)))
    return np.concatenate(pairs)


def query_pairs(
    queries: NDArray[np.intp], among: NDArray[np.intp], score: NDArray[np.floating], count: int
) -> Pairs:
    """Every query with its best others, shape (m, 2), query first.

    Args:
        queries: Rows.
        among: Rows to choose from.
        score: Shape (len(queries), len(among)); minus infinity is never chosen.
        count: Number for each.
    """
    pairs = [np.zeros((0, 2), dtype=np.intp)]
    pairs += [_with_best(among, row, score[k], count) for k, row in enumerate(queries)]
    return np.concatenate(pairs)


def _with_best(
    rows: NDArray[np.intp], row: np.intp, score: NDArray[np.floating], count: int
) -> Pairs:
    best = np.argsort(-score, kind="stable")[:count]
    best = best[np.isfinite(score[best])]
    return np.column_stack([np.full(len(best), row), rows[best]])


def unique_pairs(pairs: Pairs) -> Pairs:
    """Each once, the smaller row first, in order."""
    return np.unique(np.sort(pairs, axis=1), axis=0)
