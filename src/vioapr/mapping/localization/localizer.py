"""The pose of one image in a point map: retrieval, matches, PnP with RANSAC, refinement."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.colmap import load_pycolmap
from vioapr.mapping.features import Sift, find_features, unit_descriptors
from vioapr.mapping.localization.cameras import to_colmap
from vioapr.mapping.localization.params import LocalizationParams
from vioapr.mapping.localization.point_map import PointMap
from vioapr.mapping.localization.uncertainty import PoseSigmas, sigmas_of_pnp
from vioapr.mapping.matching import match_descriptors
from vioapr.mapping.params import MappingParams
from vioapr.mapping.registration import MAX_ERROR_PX, MIN_ERROR_PX
from vioapr.mapping.retrieval import vlad
from vioapr.schemas.point_map import CameraModel

NOTHING = slice(0, 0)


class Localized(NamedTuple):
    """The pose of one image.

    Attributes:
        world_from_cam: The pose.
        inliers: Features that agree with it.
        error_px: Their median reprojection error.
        sigmas: Standard deviations that are stated for it.
    """

    world_from_cam: Rigid3
    inliers: int
    error_px: float
    sigmas: PoseSigmas


class PointMapLocalizer:
    """Finds the poses of images; threads may share it.

    Attributes:
        point_map: That they are found in.
        params: How.
    """

    def __init__(self, point_map: PointMap, params: LocalizationParams | None = None) -> None:
        """Prepare."""
        self.point_map = point_map
        self.params = params or LocalizationParams()
        header = point_map.header
        self._mapping = MappingParams(
            max_image_size=header.max_image_size, max_features=header.max_features
        )
        self._looks = point_map.looks.astype(np.float32)

    def localize(self, path: Path, camera: CameraModel) -> Localized | None:
        """Find the pose of an image.

        Args:
            path: The image.
            camera: That took it.

        Returns:
            None where too few features agree with a pose, or the image cannot be decoded.
        """
        features = find_features(path, self._mapping)
        if features.problem:
            return None
        return self.localize_features(features, camera)

    def localize_features(
        self, features: Sift, camera: CameraModel, left_out: slice = NOTHING
    ) -> Localized | None:
        """Find the pose of an image by its features.

        Args:
            features: Found as those of the map.
            camera: That took it.
            left_out: Images of the map that must not help.
        """
        pixel, point = self._match(features, left_out)
        if len(pixel) < self.params.min_inliers:
            return None
        return self._solve(pixel, self.point_map.points_m[point], camera)

    def similar_views(
        self, descriptor: NDArray[np.float32], left_out: slice = NOTHING
    ) -> NDArray[np.intp]:
        """The map's images that look most like one, by its unit descriptors."""
        likeness = self._looks @ vlad(descriptor, self.point_map.words)
        likeness[left_out] = -np.inf
        order = np.argsort(-likeness, kind="stable")[: self.params.views]
        return order[np.isfinite(likeness[order])]

    def _match(
        self, features: Sift, left_out: slice
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Features that match points, each pair once: pixels (k, 2), rows of points (k,)."""
        descriptor = unit_descriptors(features.descriptors)
        found = [np.zeros((0, 2), dtype=np.int64)]
        place = self.point_map
        is_placed = np.isfinite(place.points_m[:, 0])
        for view in self.similar_views(descriptor, left_out):
            block = slice(place.first[view], place.first[view + 1])
            stored = unit_descriptors(place.descriptor[block])
            rows, columns = match_descriptors(descriptor, stored).T
            point = place.point[block][columns].astype(np.int64)
            found.append(np.column_stack([rows, point])[is_placed[point]])
        together = np.unique(np.concatenate(found), axis=0)
        pixel = features.keypoints[together[:, 0], :2].astype(np.float64)
        return pixel, together[:, 1]

    def _solve(
        self, pixel: NDArray[np.float64], world_m: NDArray[np.float64], camera: CameraModel
    ) -> Localized | None:
        """The pose that most matches agree with, if enough do."""
        pycolmap = load_pycolmap()
        options = pycolmap.AbsolutePoseEstimationOptions()
        options.ransac.max_error = max(
            MAX_ERROR_PX * max(camera.width, camera.height) / 640, MIN_ERROR_PX
        )
        options.ransac.random_seed = self.params.seed
        colmap_camera = to_colmap(camera)
        answer = pycolmap.estimate_and_refine_absolute_pose(pixel, world_m, colmap_camera, options)
        if answer is None:
            return None
        is_inlier = np.asarray(answer["inlier_mask"], dtype=bool)
        cam_from_world = answer["cam_from_world"]
        seen = np.asarray(colmap_camera.img_from_cam(cam_from_world * world_m[is_inlier]))
        residual = pixel[is_inlier] - seen
        # A feature that matches two points counts once.
        _, once = np.unique(pixel[is_inlier], axis=0, return_index=True)
        if len(once) < self.params.min_inliers:
            return None
        quat, translation = cam_from_world.rotation.quat, cam_from_world.translation
        pose = Rigid3(np.array(translation), np.array(quat)).inverse()
        focal_px = float(colmap_camera.mean_focal_length())
        pnp = sigmas_of_pnp(pose, world_m[is_inlier][once], residual[once], focal_px)
        error_px = float(np.median(np.linalg.norm(residual, axis=1)))
        return Localized(pose, len(once), error_px, pnp.and_of_map(self.point_map.sigmas))
