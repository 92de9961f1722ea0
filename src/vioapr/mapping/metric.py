"""From the world of structure from motion to a metric, z-up one, by what VIO says of it.

Every tracking world has a scale and a gravity of its own, both slightly wrong, and drifts and
jumps. So no global fit of positions is made: scale comes from distances between frames that are
seconds apart, gravity from the up directions of all frames, both by medians.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MappingError
from vioapr.geometry import quaternion
from vioapr.geometry.averaging import geometric_median
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import Sim3
from vioapr.geometry.vectors import angle_between_deg, path_length_m

SPAN_S = 15.0
"""Frames further apart in time do not say much about scale: VIO turns meanwhile."""

MIN_SHARE_OF_EXTENT = 0.25
"""Distances shorter than this part of the longest are mostly noise."""

MIN_IMAGES = 5
"""A tracking world with fewer images says nothing about scale."""

OUTLIER_RATIO = 0.03
"""Tracking worlds whose scale is off by less are never left out."""


@dataclass(frozen=True)
class WorldScale:
    """What one tracking world says of scale.

    Attributes:
        world: Its number.
        metres_per_unit: VIO metres per unit of the model.
        sigma: Standard error of its logarithm, from how the distances scatter.
        length_m: Path length, its weight.
        is_used: Whether it took part in the mean.
    """

    world: int
    metres_per_unit: float
    sigma: float
    length_m: float
    is_used: bool = True


@dataclass(frozen=True)
class Gravity:
    """What VIO says of the direction up in the model.

    Attributes:
        up: Unit vector in the model's world, shape (3,).
        spread_deg: Median angle between it and the single images' up.
        p95_deg: 95th percentile of that angle.
        world_offset_deg: For every tracking world, the angle between its own mean and `up`.
    """

    up: NDArray[np.float64]
    spread_deg: float
    p95_deg: float
    world_offset_deg: dict[int, float]


def estimate_scales(
    model_from_cam: Rigid3,
    vio_from_cam: Rigid3,
    tracking_world: NDArray[np.integer],
    timestamp_s: NDArray[np.float64],
) -> list[WorldScale]:
    """Estimate the scale by every tracking world; outliers are marked.

    Args:
        model_from_cam: Poses of the registered images that have trusted VIO poses, shape (n,).
        vio_from_cam: Theirs by VIO, shape (n,).
        tracking_world: Shape (n,).
        timestamp_s: Shape (n,).
    """
    scales = []
    for world in np.unique(tracking_world):
        rows = np.flatnonzero(tracking_world == world)
        model, vio_m = model_from_cam.translation_m[rows], vio_from_cam.translation_m[rows]
        scale = estimate_scale(int(world), model, vio_m, timestamp_s[rows])
        if scale is not None:
            scales.append(scale)
    if len(scales) < 3:
        return scales
    logs = np.log([scale.metres_per_unit for scale in scales])
    off = np.abs(logs - np.median(logs))
    limit = max(OUTLIER_RATIO, 3 * 1.4826 * float(np.median(off)))
    return [replace(s, is_used=bool(o <= limit)) for s, o in zip(scales, off, strict=True)]


def estimate_scale(
    world: int,
    model: NDArray[np.float64],
    vio_m: NDArray[np.float64],
    timestamp_s: NDArray[np.float64],
) -> WorldScale | None:
    """Estimate the scale by one tracking world.

    Args:
        world: Its number.
        model: Positions in the model's units, shape (n, 3), in order of time.
        vio_m: The same by VIO, shape (n, 3).
        timestamp_s: Shape (n,).

    Returns:
        The median ratio of distances; None if there are too few long ones.
    """
    if len(vio_m) < MIN_IMAGES:
        return None
    first, second = np.triu_indices(len(vio_m), 1)
    is_near = timestamp_s[second] - timestamp_s[first] <= SPAN_S
    first, second = first[is_near], second[is_near]
    in_model = np.linalg.norm(model[first] - model[second], axis=1)
    in_vio_m = np.linalg.norm(vio_m[first] - vio_m[second], axis=1)
    if not len(in_model):
        return None
    # The threshold is on the model's distances: on VIO's, their noise would select itself.
    is_long = in_model >= MIN_SHARE_OF_EXTENT * in_model.max()
    is_long &= (in_model > 0) & (in_vio_m > 0)
    if is_long.sum() < MIN_IMAGES:
        return None
    logs = np.log(in_vio_m[is_long] / in_model[is_long])
    middle = float(np.median(logs))
    scatter = 1.4826 * float(np.median(np.abs(logs - middle)))
    # Pairs of the same images are not independent: images are counted.
    sigma = float(scatter / np.sqrt(len(vio_m)))
    return WorldScale(world, float(np.exp(middle)), sigma, path_length_m(vio_m))


def mean_scale(scales: list[WorldScale]) -> float:
    """Metres per unit of the model: the mean over tracking worlds, weighted by path length.

    Raises:
        MappingError: No tracking world says anything.
    """
    used = [scale for scale in scales if scale.is_used]
    if not used:
        raise MappingError(
            "the map's scale is not known: no training recording has VIO poses with tracking "
            "normal at 5 or more registered images that moved"
        )
    logs = np.log([scale.metres_per_unit for scale in used])
    weights = np.array([scale.length_m for scale in used])
    return float(np.exp(np.average(logs, weights=weights)))


def estimate_gravity(
    model_from_cam: Rigid3, vio_from_cam: Rigid3, tracking_world: NDArray[np.integer]
) -> Gravity:
    """The robust mean of VIO's up (its y axis) over all images, in the model's world."""
    y_up = np.array([0.0, 1.0, 0.0])
    up_in_cam = quaternion.rotate(quaternion.inverse(vio_from_cam.quat_xyzw), y_up)
    ups = quaternion.rotate(model_from_cam.quat_xyzw, up_in_cam)
    up = _mean_direction(ups)
    angles = angle_between_deg(ups, up)
    offsets = {
        int(world): float(angle_between_deg(_mean_direction(ups[tracking_world == world]), up))
        for world in np.unique(tracking_world)
    }
    spread, p95 = np.percentile(angles, [50, 95])
    return Gravity(up, float(spread), float(p95), offsets)


def _mean_direction(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    median = geometric_median(directions, np.ones(len(directions)))
    return median / np.linalg.norm(median)


def align_with_world(
    model_from_cam: Rigid3,
    vio_from_cam: Rigid3,
    metres_per_unit: float,
    up: NDArray[np.float64],
) -> Sim3:
    """world_from_model: metric, z up, with origin and heading of one tracking world.

    Args:
        model_from_cam: Images of that tracking world, shape (n,).
        vio_from_cam: Their VIO poses, shape (n,).
        metres_per_unit: The scale.
        up: Up in the model's world.
    """
    # The shortest rotation that takes up to z; from straight down, a half turn about x.
    w = 1.0 + float(up[2])
    z = np.array([0.0, 0.0, 1.0])
    level = np.array([1.0, 0.0, 0.0, 0.0])
    if w >= 1e-9:
        level = quaternion.normalize(np.append(np.cross(up, z), w))
    turned = quaternion.multiply(level, model_from_cam.quat_xyzw)
    z_up_vio = z_up_from_y_up(vio_from_cam)
    difference = quaternion.multiply(z_up_vio.quat_xyzw, quaternion.inverse(turned))
    # Of the rotation between the two worlds, both z up, the part about z.
    headings = 2 * np.arctan2(difference[:, 2], difference[:, 3])
    # The geometric median on the circle: jumps of the tracker and bad images have no say.
    circle = np.column_stack([np.cos(headings), np.sin(headings), np.zeros(len(headings))])
    x, y, _ = geometric_median(circle, np.ones(len(circle)))
    half = np.arctan2(y, x) / 2
    rotation = quaternion.multiply(np.array([0.0, 0.0, np.sin(half), np.cos(half)]), level)
    moved = metres_per_unit * quaternion.rotate(rotation, model_from_cam.translation_m)
    offsets = z_up_vio.translation_m - moved
    offset = geometric_median(offsets, np.ones(len(offsets)))
    return Sim3(np.asarray(metres_per_unit), Rigid3(offset, rotation))
