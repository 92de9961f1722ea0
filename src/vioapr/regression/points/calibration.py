"""When a pose by points may be believed, and how exact it is: measured on images left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.regression.augmentation import middle_crop
from vioapr.regression.cache import read_images
from vioapr.regression.points.network import PointsNetwork

LEAST_INLIERS = 35
"""Key points that must agree, at least: pictures of other places reach less
(docs/results/regressors.md)."""

_WRONG_M, _WRONG_DEG = 0.5, 5.0
"""Error of a pose that is not of this place."""

_MOST_WRONG = 0.01
_QUANTILES = {0.5: 1.538, 0.9: 2.500}
"""Of the length of three normal numbers of deviation 1: tails are to be covered, too."""

_MOST_FACTOR = 20.0


class Query(NamedTuple):
    """An image that is asked for while some views are hidden.

    Attributes:
        path: Of the image.
        position_m: Shape (3,), the true one.
        quat_xyzw: Shape (4,), the true one.
        is_hidden: Shape (views,).
    """

    path: Path
    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    is_hidden: NDArray[np.bool_]


class PointsError(NamedTuple):
    """Errors on what was left out.

    Attributes:
        position_m: Median where it is sure; None if nowhere.
        orientation_deg: Median where it is sure.
        sure: Share of the images.
    """

    position_m: float | None
    orientation_deg: float | None
    sure: float


@torch.inference_mode()
def calibrate_points(
    network: PointsNetwork,
    queries: Sequence[Query],
    image_size: int,
    tick: Callable[[], object] = lambda: None,
) -> PointsError:
    """Choose how many key points must agree, and the factors of sigmas; in place."""
    gaps_m, gaps_rad, sigmas, inliers = [], [], [], []
    images = read_images([query.path for query in queries], image_size)
    for query, image in zip(queries, images, strict=True):
        seen = network.look(middle_crop(torch.from_numpy(np.stack([image])), image_size))
        found = network.find_pose(*seen, torch.from_numpy(query.is_hidden).float())
        rotation = found.poses.rotation[0]
        place = -(rotation.mT @ found.poses.translation_m[0]) + network.centre_m[0]
        gaps_m.append(np.linalg.norm(place.numpy() - query.position_m))
        quat = quaternion.from_matrix(rotation.mT.double().numpy())
        gaps_rad.append(np.deg2rad(quaternion.angle_between_deg(quat, query.quat_xyzw)))
        sigmas.append(network.sigmas(found).numpy())
        inliers.append(float(found.inliers))
        tick()
    errors = np.stack([gaps_m, gaps_rad], axis=-1)
    is_wrong = (errors[:, 0] > _WRONG_M) | (errors[:, 1] > np.deg2rad(_WRONG_DEG))
    least = fewest_inliers(np.array(inliers), is_wrong)
    is_sure = np.array(inliers) >= least
    network.least_inliers.fill_(least)
    if not is_sure.any():
        return PointsError(None, None, 0.0)
    ratios = errors[is_sure] / np.stack(sigmas)[is_sure]
    factors = [np.quantile(ratios, share, axis=0) / size for share, size in _QUANTILES.items()]
    factor = np.clip(np.max(factors, axis=0), 1 / _MOST_FACTOR, _MOST_FACTOR)
    network.sigma_factor.copy_(torch.from_numpy(factor))
    middle = np.median(errors[is_sure], axis=0)
    return PointsError(float(middle[0]), float(np.rad2deg(middle[1])), float(is_sure.mean()))


def fewest_inliers(inliers: NDArray[np.float64], is_wrong: NDArray[np.bool_]) -> float:
    """The least number, from `LEAST_INLIERS` up, from which at most one in a hundred is wrong."""
    limits = np.unique(np.concatenate([[LEAST_INLIERS], inliers[inliers >= LEAST_INLIERS]]))
    for limit in limits:
        chosen = is_wrong[inliers >= limit]
        if len(chosen) and chosen.mean() <= _MOST_WRONG:
            return float(limit)
    return float(max(LEAST_INLIERS, inliers.max() + 1))
