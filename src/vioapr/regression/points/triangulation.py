"""The map's points: key points of a view, where the pictures around it show them too.

Poses are known, so that no geometry has to be guessed: a match counts if it lies on the line that
the poses say, and a point is where the lines of sight meet, robustly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from vioapr.regression.points.keypoints import Keypoints

LEAST_COSINE = 0.82
"""Of descriptors that match; XFeat's own threshold."""

_KERNEL_PX = 1.5
_STEPS = 8
_LEAST_PARALLAX_DEG = 1.5
_LEAST_OTHERS = 2
"""Pictures besides the view that must agree on a point."""

_LINE_PX = 4.0
"""Distance of a match from its epipolar line, pixels."""


@dataclass(frozen=True)
class Picture:
    """A picture with a known pose.

    Attributes:
        keypoints: Of it.
        rotation: (3, 3), cam_from_world.
        centre_m: (3,), the camera's place in the world.
        camera: (4,), fx, fy, cx, cy in pixels of the network's image.
    """

    keypoints: Keypoints
    rotation: Tensor
    centre_m: Tensor
    camera: Tensor

    def rays(self) -> Tensor:
        """Unit directions of the key points in the world, (N, 3)."""
        plane = (self.keypoints.xy - self.camera[2:]) / self.camera[:2]
        ray = torch.cat([plane, torch.ones_like(plane[:, :1])], dim=-1)
        return functional.normalize(ray @ self.rotation, dim=-1)


class MapPoints(NamedTuple):
    """Points that key points of a view show.

    Attributes:
        world_m: (N, 3).
        others: (N,), pictures that agree besides the view; 0 where there is no point.
    """

    world_m: Tensor
    others: Tensor


def match_mutually(left: Keypoints, right: Keypoints) -> tuple[Tensor, Tensor]:
    """Match the key points of two pictures.

    Returns:
        Of each on the left, the row on the right; and whether both are each other's most similar.
    """
    similarity = left.descriptor @ right.descriptor.T
    best, row = similarity.max(dim=1)
    is_mutual = similarity.argmax(dim=0)[row] == torch.arange(len(row), device=row.device)
    return row, is_mutual & (best > LEAST_COSINE) & (left.score > 0) & (right.score[row] > 0)


def triangulate(view: Picture, others: list[Picture]) -> MapPoints:
    """Find where the key points of a view are, by pictures around it."""
    ray = view.rays()
    rays, centres, weights = [ray], [view.centre_m.expand_as(ray)], [torch.ones(len(ray))]
    focal_px = float(view.camera[:2].mean())
    for other in others:
        row, is_match = match_mutually(view.keypoints, other.keypoints)
        found = other.rays()[row]
        is_match &= _off_line_rad(view.centre_m, ray, other.centre_m, found) < _LINE_PX / focal_px
        rays.append(found)
        centres.append(other.centre_m.expand_as(found))
        weights.append(is_match.float())
    stacked = (torch.stack(part, dim=1).double() for part in (rays, centres, weights))
    return _meet(*stacked, kernel=_KERNEL_PX / focal_px)


def _off_line_rad(centre_m: Tensor, ray: Tensor, other_m: Tensor, found: Tensor) -> Tensor:
    """By which angle lines of sight miss the plane of both cameras and the other line, (N,)."""
    normal = torch.linalg.cross((other_m - centre_m).expand_as(ray), ray)
    normal = functional.normalize(normal, dim=-1)
    return torch.abs((normal * found).sum(dim=-1))


def _meet(rays: Tensor, centres: Tensor, weights: Tensor, kernel: float) -> MapPoints:
    """Where lines of sight meet, (N, K, 3), weighted (N, K); the first is the view's own."""
    unit = torch.eye(3, dtype=rays.dtype)
    across = unit - rays[..., :, None] * rays[..., None, :]
    weight, cosine_limit = weights, np.cos(np.deg2rad(_LEAST_PARALLAX_DEG))
    point = centres[:, 0]
    for step in range(_STEPS):
        information = (across * weight[..., None, None]).sum(dim=1) + 1e-9 * unit
        target = (across @ centres[..., None] * weight[..., None, None]).sum(dim=1)
        point = torch.linalg.solve(information, target)[..., 0]
        way = point[:, None] - centres
        length = way.norm(dim=-1) + 1e-9
        depth = (way * rays).sum(dim=-1)
        miss = torch.linalg.cross(way, rays).norm(dim=-1) / length
        size = kernel * max(1.0, 4.0 * (1 - step / (_STEPS - 2)))
        weight = weights / (1 + (miss / size) ** 2) ** 2 * (depth > 0)
        # What is far has more say in metres than in pixels.
        weight = weight / (length * length)
    is_inlier = (weights > 0) & (miss < 2 * kernel) & (depth > 0)
    sight = way / length[..., None]
    cosines = (sight[:, :1] * sight).sum(dim=-1).masked_fill(~is_inlier, 1.0)
    others = is_inlier[:, 1:].sum(dim=-1)
    is_point = is_inlier[:, 0] & (others >= _LEAST_OTHERS) & (cosines.amin(dim=-1) < cosine_limit)
    return MapPoints(point.float(), torch.where(is_point, others, 0))


def nearest_views(
    position_m: NDArray[np.float64],
    direction: NDArray[np.float64],
    rows: NDArray[np.int64],
    count: int,
    size_m: float,
) -> NDArray[np.int64]:
    """The pictures that see most like some views, but not from the same place.

    Args:
        position_m: Of all pictures, (n, 3).
        direction: Of their optical axes in the world, (n, 3).
        rows: Of the views, (m,).
        count: Wanted of each.
        size_m: Distance that counts as much as a radian.

    Returns:
        Rows, (m, count), the most alike first.
    """
    distance_m = np.linalg.norm(position_m[rows, None] - position_m, axis=-1)
    angle = np.arccos(np.clip(direction[rows] @ direction.T, -1, 1))
    cost = distance_m / size_m + angle
    cost[np.arange(len(rows)), rows] = np.inf
    return np.argsort(cost, axis=1, kind="stable")[:, :count]
