"""Where the map and VIO disagree: wrongly placed images, or jumps of the tracker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry.relative import relative_gap
from vioapr.geometry.rigid import Rigid3

MAX_STEP_S = 5.0
"""Images further apart in time are not compared."""

BREAK_M, BREAK_SHARE, BREAK_DEG = 0.3, 0.2, 5.0
"""Two motions differ if their lengths do by more than this and this share, or their angles do."""

MAX_MISPLACED_SHARE = 0.2
"""Of a tracking world; if more of its images are misplaced, none of them is trusted."""


def find_breaks(
    world_from_cam: Rigid3,
    vio_from_cam: Rigid3,
    tracking_world: NDArray[np.integer],
    timestamp_s: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Between which images the map moves otherwise than VIO.

    Args:
        world_from_cam: In the map, in order of time, shape (n,).
        vio_from_cam: By VIO, shape (n,), NaN where there is none.
        tracking_world: Shape (n,).
        timestamp_s: Shape (n,).

    Returns:
        Shape (n - 1,): whether the motion from image k to k + 1 differs.
    """
    rows = slice(None, -1), slice(1, None)
    motions = [poses.at(part) for poses in (world_from_cam, vio_from_cam) for part in rows]
    with np.errstate(invalid="ignore"):
        gap = relative_gap(*motions)
        length_m = np.linalg.norm(motions[3].translation_m - motions[2].translation_m, axis=-1)
        differs = gap.distance_m > BREAK_M + BREAK_SHARE * length_m
        differs |= gap.angle_deg > BREAK_DEG
    is_comparable = tracking_world[1:] == tracking_world[:-1]
    is_comparable &= np.diff(timestamp_s) <= MAX_STEP_S
    return differs & is_comparable


def find_misplaced(breaks: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Which images agree with neither neighbour, by their number in order of time.

    A lone image between two breaks is placed wrongly. A single break may as well be a jump of
    the tracker, so images beside one are not suspected.
    """
    return np.flatnonzero(breaks[:-1] & breaks[1:]) + 1


def with_bad_worlds(
    is_misplaced: NDArray[np.bool_], tracking_world: NDArray[np.integer]
) -> NDArray[np.bool_]:
    """All images of tracking worlds of which many are misplaced, and the misplaced ones.

    Where a part of a walk is folded onto a place that looks alike, single images of it may agree
    with VIO by chance.
    """
    result = is_misplaced.copy()
    for world in np.unique(tracking_world):
        members = tracking_world == world
        if is_misplaced[members].mean() > MAX_MISPLACED_SHARE:
            result |= members
    return result
