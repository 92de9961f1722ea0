"""From an image to a pose of centimetres, or to retrieval's where the map's points are not seen.

Two passes: views that look alike give matches, and small subsets of these give hypotheses; then
the best one says where the map's points should be, and matches near there give the pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from vioapr.geometry import quaternion
from vioapr.regression.networks.base import PoseNetwork, Raw
from vioapr.regression.networks.retrieval import RetrievalNetwork
from vioapr.regression.networks.rotation import ROTATION_CODES
from vioapr.regression.networks.xfeat import DESCRIPTOR, XFeat
from vioapr.regression.points.keypoints import Keypoints, find_keypoints
from vioapr.regression.points.robust_pose import (
    Matches,
    Poses,
    information_of,
    inverse,
    project,
    refine,
    score,
)
from vioapr.regression.points.triangulation import LEAST_COSINE
from vioapr.schemas.regressor import PointsShape

_SUBSETS, _SUBSET_SIZE, _SUBSET_OF = 32, 4, 64
"""Hypotheses a view, matches that each rests on, and the best matches of a view they are of."""

_MATCHES, _COMPARED = 512, 256
"""Of all views together, that poses rest on, and by which hypotheses are compared."""

_KEPT = 4
"""Hypotheses that are refined."""

_START_STEPS, _GRADUATED_STEPS, _FINAL_STEPS = 6, 12, 10
"""Of hypotheses, of those that are kept, and of the pose by the second matches."""

_WIDE = 1e4
"""Pixels of a kernel that excludes nothing."""

_NEAR_PX, _NEAR_COSINE = 40.0, 0.75
"""Where a point is expected, and how alike it must be there."""

_INLIER_PX = 4.0
_LEAST_NOISE_PX = 0.3
_SMALLEST_SIGMA = 1e-4


class PointsNetwork(PoseNetwork):
    """A map of points, retrieval to start from, and a robust solver.

    Attributes:
        shape: Of the map.
        retrieval: Finds views, and answers where points do not.
    """

    camera: Tensor
    view_descriptor: Tensor
    view_rotation: Tensor
    view_translation_m: Tensor
    point_m: Tensor
    point_descriptor: Tensor
    descriptor_scale: Tensor
    least_inliers: Tensor
    sigma_factor: Tensor
    subset: Tensor

    def __init__(self, shape: PointsShape) -> None:
        """Make room for a map, to be filled by `fit_points` or from a file."""
        super().__init__(ROTATION_CODES["quat"])
        self.shape = shape
        self.retrieval = RetrievalNetwork(shape.retrieval)
        self.xfeat = XFeat()
        views, points = shape.views, shape.points
        rooms = {
            # fx, fy, cx, cy in pixels of the network's image.
            "camera": torch.ones(4),
            "view_descriptor": torch.zeros(shape.retrieval.components, views),
            "view_rotation": torch.eye(3).repeat(views, 1, 1),
            "view_translation_m": torch.zeros(views, 3),
            # From the middle of the cameras, as all of these metres.
            "point_m": torch.zeros(views, points * 3),
            # A descriptor of zeros, where there is no point, matches nothing.
            "point_descriptor": torch.zeros(views, points * DESCRIPTOR, dtype=torch.int8),
            "descriptor_scale": torch.ones(1),
            "least_inliers": torch.full((1,), torch.inf),
            "sigma_factor": torch.ones(2),
            "subset": torch.from_numpy(_draw_subsets()),
        }
        for name, room in rooms.items():
            self.register_buffer(name, room)

    def forward_raw(self, images: Tensor, scene: Tensor | None = None) -> Raw:
        """Images (B, 3, H, W), one after the other; there is one scene."""
        each = [self._locate(image) for image in images.split(1)]
        if len(each) == 1:
            return each[0]
        return Raw(*(torch.cat(parts) for parts in list(zip(*each, strict=True))[:3]))

    def _locate(self, image: Tensor) -> Raw:
        descriptor, keypoints = self.look(image)
        found = self.find_pose(descriptor, keypoints)
        return self.choose(self.retrieval.to_raw(self.retrieval.find(descriptor)), found)

    def look(self, image: Tensor) -> tuple[Tensor, Keypoints]:
        """What retrieval and points need of an image (1, 3, H, W)."""
        halved = functional.avg_pool2d(image, 2)
        descriptor = self.retrieval.shorten(self.retrieval.describe(halved))
        return descriptor, find_keypoints(self.xfeat(image), self.shape.keypoints)

    def find_pose(
        self, descriptor: Tensor, keypoints: Keypoints, is_hidden: Tensor | None = None
    ) -> Found:
        """Find the pose of an image by the map's points.

        Args:
            descriptor: (1, components), retrieval's.
            keypoints: Of the image.
            is_hidden: (views,), 1 for those that are not to be used; None for none.
        """
        hidden = torch.zeros(1) if is_hidden is None else is_hidden * _WIDE
        alike = (descriptor @ self.view_descriptor)[0] - hidden
        start = self._from_views(keypoints, torch.topk(alike, self.shape.neighbours).indices)
        views = torch.topk(-self._distance(start) - hidden, self.shape.neighbours).indices
        matches = self._near(keypoints, views, start)
        poses = refine(self.camera, start, matches, steps=_FINAL_STEPS, kernel_px=(8.0, 2.0))
        return Found(poses, matches, score(self.camera, poses, matches, _INLIER_PX)[1])

    def choose(self, raw: Raw, found: Found) -> Raw:
        """The pose of points where enough agree, else retrieval's."""
        rotation = found.poses.rotation[0]
        world_from_cam = rotation.mT
        position_m = -(world_from_cam @ found.poses.translation_m[0][:, None])[:, 0]
        sigma = self.sigmas(found) * self.sigma_factor
        unit = torch.cat([self.size_m[:1], torch.ones_like(self.size_m[:1])]) * self.sigma_scale
        is_sure = (found.inliers >= self.least_inliers) & (found.inliers > 0)
        exact = Raw(
            (position_m / self.size_m[0])[None],
            quaternion.from_matrix(world_from_cam)[None],
            torch.log(torch.clamp(sigma / unit, min=_SMALLEST_SIGMA))[None],
        )
        return Raw(
            *(
                torch.where(is_sure[:, None], ours, others)
                for ours, others in zip(exact[:3], raw[:3], strict=True)
            )
        )

    def sigmas(self, found: Found) -> Tensor:
        """Standard deviations of position and orientation, (2,), m and rad, by the residuals."""
        residuals = project(self.camera, found.poses, found.matches)
        weight = found.matches.weight * (residuals.squared < _INLIER_PX**2) * residuals.is_in_front
        squared = (weight * residuals.squared).sum() / (2 * weight.sum() + 1e-6)
        noise = torch.clamp(squared, min=_LEAST_NOISE_PX**2)
        information = information_of(self.camera, found.poses, found.matches, _INLIER_PX)
        variance = torch.diagonal(inverse(information)[0], dim1=-2, dim2=-1) * noise
        return torch.sqrt(torch.stack([variance[3:].mean(), variance[:3].mean()]))

    def _points(self, views: Tensor) -> tuple[Tensor, Tensor]:
        """Places (k, M, 3) and descriptors (k, M, 64) of the points of some views."""
        shape = (len(views), self.shape.points)
        point_m = torch.index_select(self.point_m, 0, views).reshape(*shape, 3)
        packed = torch.index_select(self.point_descriptor, 0, views)
        descriptor = packed.to(torch.float32) * self.descriptor_scale
        return point_m, descriptor.reshape(*shape, DESCRIPTOR)

    def _view_poses(self, views: Tensor) -> Poses:
        return Poses(self.view_rotation, self.view_translation_m).at(views)

    def _from_views(self, keypoints: Keypoints, views: Tensor) -> Poses:
        """The best pose of hypotheses that start at views, (1,)."""
        point_m, descriptor = self._points(views)
        count, points = len(views), self.shape.points
        similarity = descriptor.reshape(count * points, DESCRIPTOR) @ keypoints.descriptor.T
        similarity = similarity.reshape(count, points, -1)
        best, row = similarity.max(dim=2)
        # Each other's best: an argmax along the other axis would cost more than all the rest.
        most = similarity.amax(dim=1).reshape(-1)
        number = torch.arange(count)[:, None] * similarity.shape[2]
        is_mutual = best >= torch.index_select(most, 0, (row + number).reshape(-1)).reshape(
            count, points
        )
        is_match = is_mutual & (best > LEAST_COSINE)
        flat = row.reshape(-1)
        is_there = torch.index_select(keypoints.score, 0, flat).reshape(count, points) > 0
        pixel = torch.index_select(keypoints.xy, 0, flat).reshape(count, points, 2)
        matches = Matches(point_m, pixel, best * is_match * is_there)
        chosen = self._hypotheses(matches, self._view_poses(views))
        best_of_all = torch.topk(matches.weight.reshape(1, -1), _MATCHES).indices
        together = _best(matches, best_of_all)
        compared = Matches(*(part[:, :_COMPARED] for part in together))
        fit = score(self.camera, chosen, compared, 6.0)[0]
        chosen = chosen.at(torch.topk(fit, _KEPT).indices)
        chosen = refine(
            self.camera, chosen, together, steps=_GRADUATED_STEPS, kernel_px=(30.0, 2.0)
        )
        return chosen.at(score(self.camera, chosen, together, _INLIER_PX)[0].argmax()[None])

    def _hypotheses(self, matches: Matches, views: Poses) -> Poses:
        """Poses by small subsets of each view's matches, from the view's own pose."""
        count = len(matches.weight)
        best = torch.topk(matches.weight, _SUBSET_OF, dim=1).indices
        subset = torch.index_select(best, 1, self.subset.reshape(-1))
        drawn = _best(matches, subset.reshape(count, _SUBSETS, _SUBSET_SIZE), by_view=True)
        few = Matches(
            drawn.world_m.reshape(-1, _SUBSET_SIZE, 3),
            drawn.pixel.reshape(-1, _SUBSET_SIZE, 2),
            (drawn.weight.reshape(-1, _SUBSET_SIZE) > 0).to(drawn.weight.dtype),
        )
        view = torch.arange(count * _SUBSETS) // _SUBSETS
        return refine(
            self.camera, views.at(view), few, steps=_START_STEPS, kernel_px=(_WIDE, _WIDE)
        )

    def _distance(self, pose: Poses) -> Tensor:
        """How differently the map's views see than a pose, (views,)."""
        centre_m = -(pose.rotation[0].mT @ pose.translation_m[0][:, None])[:, 0]
        views = -(self.view_rotation.mT @ self.view_translation_m[..., None])[..., 0]
        gap_m = views - centre_m
        alike = (self.view_rotation[:, 2] * pose.rotation[0, 2]).sum(dim=-1)
        return torch.sqrt((gap_m * gap_m).sum(dim=-1)) / self.size_m[0] + 1 - alike

    def _near(self, keypoints: Keypoints, views: Tensor, pose: Poses) -> Matches:
        """The best matches of points with key points near where a pose expects them."""
        point_m, descriptor = self._points(views)
        point_m, descriptor = point_m.reshape(-1, 3), descriptor.reshape(-1, DESCRIPTOR)
        nowhere = Matches(point_m, torch.zeros(1, 2), torch.ones(1))
        expected = project(self.camera, pose, nowhere)
        gap2 = _squared_distances(expected.gap[0], keypoints.xy)
        limit = _NEAR_PX**2 * expected.is_in_front[0][:, None]
        similarity = torch.where(gap2 < limit, descriptor @ keypoints.descriptor.T, -1.0)
        best, row = similarity.max(dim=1)
        is_mutual = best >= torch.index_select(similarity.amax(dim=0), 0, row)
        is_there = torch.index_select(keypoints.score, 0, row) > 0
        worth = best * (is_mutual & (best > _NEAR_COSINE) & is_there)
        chosen, index = torch.topk(worth, _MATCHES)
        pixel = torch.index_select(keypoints.xy, 0, torch.index_select(row, 0, index))
        weight = (chosen > 0).to(best.dtype)
        return Matches(torch.index_select(point_m, 0, index)[None], pixel[None], weight[None])


class Found(NamedTuple):
    """A pose by points.

    Attributes:
        poses: Of shape (1,).
        matches: That it rests on, (1, N).
        inliers: How many key points agree, (1,).
    """

    poses: Poses
    matches: Matches
    inliers: Tensor


def _best(matches: Matches, index: Tensor, *, by_view: bool = False) -> Matches:
    """Matches at places of all views together, or of each view."""
    if by_view:
        count, points = matches.weight.shape
        number = torch.arange(count) * points
        index = index + number.reshape(-1, *([1] * (index.ndim - 1)))
    flat = index.reshape(-1)
    world_m, pixel, weight = (
        torch.index_select(part.reshape(-1, *part.shape[2:]), 0, flat) for part in matches
    )
    return Matches(
        world_m.reshape(*index.shape, 3),
        pixel.reshape(*index.shape, 2),
        weight.reshape(index.shape),
    )


def _squared_distances(left: Tensor, right: Tensor) -> Tensor:
    """Of all pairs, (n, m), from (n, 2) and (m, 2): by a product of matrices."""
    squares = (left * left).sum(dim=-1)[:, None] + (right * right).sum(dim=-1)
    return squares - 2 * left @ right.T


def _draw_subsets() -> np.ndarray:
    """Places among a view's best matches, the first ones more often, (subsets, size)."""
    rng = np.random.default_rng(0)
    return np.stack(
        [
            rng.choice(max(16, _SUBSET_OF * (row + 1) // _SUBSETS), _SUBSET_SIZE, replace=False)
            for row in range(_SUBSETS)
        ]
    )
