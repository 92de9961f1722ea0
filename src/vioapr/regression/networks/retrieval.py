"""A pose by retrieval: the most similar training images, and their poses interpolated.

Nothing is trained. Two maps of a network that knows ImageNet, pooled to a coarse grid, describe an
image; principal components make the description short. Sattler et al. (CVPR 2019) found that
this is a baseline which many trained regressors do not reach.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from vioapr.geometry.averaging import mean_quaternion
from vioapr.regression.networks.base import PoseNetwork, Raw
from vioapr.regression.networks.efficientnet_lite import EfficientNetLite0
from vioapr.regression.networks.rotation import ROTATION_CODES
from vioapr.schemas.regressor import RetrievalShape

CELLS = 3
"""Rows and columns of the grid that maps are pooled to."""

DESCRIBED = (EfficientNetLite0.FINE_CHANNELS + EfficientNetLite0.COARSE_CHANNELS) * CELLS**2
"""Numbers of a description before it is shortened."""

CUES = 4
"""Numbers from which an uncertainty is said: 1, and the logarithms of `Neighbourhood`."""

_SMALLEST = 0.01
"""Added to what a logarithm is taken of: similarities and spreads below say nothing more."""

_FAR = 1e3
"""Less similar than any view."""


class Neighbourhood(NamedTuple):
    """The most similar images of B images, and what they say together.

    Attributes:
        position: (B, 3), weighted mean, in the scene's unit.
        quat_xyzw: (B, 4), weighted mean, world_from_cam.
        dissimilarity: (B,), 1 less the cosine of the most similar.
        spread_position: (B,), weighted root mean square distance from the mean.
        spread_rad: (B,), the same of rotations.
    """

    position: Tensor
    quat_xyzw: Tensor
    dissimilarity: Tensor
    spread_position: Tensor
    spread_rad: Tensor

    def cues(self) -> Tensor:
        """Collect what uncertainties are said from, shape (B, CUES)."""
        found = torch.stack([self.dissimilarity, self.spread_position, self.spread_rad], dim=-1)
        return torch.cat([torch.ones_like(found[:, :1]), torch.log(found + _SMALLEST)], dim=-1)


class RetrievalNetwork(PoseNetwork):
    """An index of training images with their poses.

    Attributes:
        shape: Of the index.
    """

    mean: Tensor
    projection: Tensor
    descriptor: Tensor
    view_pose: Tensor
    sharpness: Tensor
    sigma_weight: Tensor

    def __init__(self, shape: RetrievalShape) -> None:
        """Make room for an index, to be filled by `fit_retrieval` or from a file."""
        super().__init__(ROTATION_CODES["quat"])
        self.shape = shape
        self.backbone = EfficientNetLite0(has_maps_alone=True)
        self.register_buffer("mean", torch.zeros(DESCRIBED))
        self.register_buffer("projection", torch.zeros(DESCRIBED, shape.components))
        # One column a view: a product of matrices gives all similarities.
        self.register_buffer("descriptor", torch.zeros(shape.components, shape.views))
        # x y z in the scene's unit, qx qy qz qw.
        self.register_buffer("view_pose", torch.zeros(shape.views, 7))
        self.register_buffer("sharpness", torch.ones(1))
        self.register_buffer("sigma_weight", torch.zeros(CUES, 2))

    def forward_raw(self, images: Tensor, scene: Tensor | None = None) -> Raw:
        """Images (B, 3, H, W); there is one scene."""
        return self.to_raw(self.find(self.shorten(self.describe(images))))

    def describe(self, images: Tensor) -> Tensor:
        """Describe images (B, 3, H, W) by (B, DESCRIBED) numbers."""
        maps = self.backbone.forward_maps(images)
        return torch.cat([pool_to_cells(one).flatten(1) for one in maps], dim=1)

    def shorten(self, described: Tensor) -> Tensor:
        """Turn descriptions (B, DESCRIBED) into unit vectors (B, components)."""
        return nn.functional.normalize((described - self.mean) @ self.projection, dim=-1)

    def find(self, descriptor: Tensor, is_hidden: Tensor | None = None) -> Neighbourhood:
        """Find the views that are most similar to images.

        Args:
            descriptor: Of the images, (B, components).
            is_hidden: (views,), those that are not to be found; None for none.
        """
        similarities = descriptor @ self.descriptor
        if is_hidden is not None:
            similarities = similarities - _FAR * is_hidden
        similarity, view = torch.topk(similarities, self.shape.neighbours, dim=-1)
        poses = torch.index_select(self.view_pose, 0, view.reshape(-1))
        return interpolate(similarity, poses.reshape(*view.shape, 7), self.sharpness)

    def to_raw(self, found: Neighbourhood) -> Raw:
        """Say a pose and its uncertainty."""
        return Raw(found.position, found.quat_xyzw, found.cues() @ self.sigma_weight)


def interpolate(similarity: Tensor, poses: Tensor, sharpness: Tensor) -> Neighbourhood:
    """Interpolate the poses of similar views.

    Args:
        similarity: (B, k), cosines, the largest first.
        poses: (B, k, 7), as `view_pose`.
        sharpness: (1,), how much more the more similar count.
    """
    weight = torch.softmax(similarity * sharpness, dim=-1)
    positions, quats = poses[..., :3], poses[..., 3:]
    position = (weight[..., None] * positions).sum(dim=1)
    quat_xyzw = mean_quaternion(quats, weight)
    offset = positions - position[:, None]
    # The square of half the angle's sine, of q and -q alike.
    sine = 1 - ((quats * quat_xyzw[:, None]).sum(dim=-1)) ** 2
    return Neighbourhood(
        position,
        quat_xyzw,
        torch.clamp(1 - similarity[:, 0], min=0.0),
        torch.sqrt((weight * (offset * offset).sum(dim=-1)).sum(dim=-1)),
        2 * torch.sqrt(torch.clamp((weight * sine).sum(dim=-1), min=0.0)),
    )


def pool_to_cells(features: Tensor) -> Tensor:
    """Average a map (B, C, H, W) over a grid of cells, (B, C, CELLS, CELLS).

    As adaptive pooling, whose operator not every runtime has, by two products of matrices.
    """
    rows, columns = (
        torch.tensor(_averages_of_cells(size), dtype=features.dtype, device=features.device)
        for size in features.shape[2:]
    )
    return rows @ (features @ columns.T)


def _averages_of_cells(size: int) -> list[list[float]]:
    """Weights of `size` pixels in every cell; neighbours may share a pixel."""
    weights = []
    for cell in range(CELLS):
        first, last = cell * size // CELLS, -(-(cell + 1) * size // CELLS)
        weights.append([1 / (last - first) if first <= k < last else 0.0 for k in range(size)])
    return weights
