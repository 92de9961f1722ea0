"""How exact poses in a map are, by the map's own images: each localized without its part.

Points are where all their observations put them, those of the image that is localized too. So
without its part of the map, points are placed again, by the other observations alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.mapping.features import Sift
from vioapr.mapping.localization.cameras import to_colmap
from vioapr.mapping.localization.localizer import PointMapLocalizer
from vioapr.mapping.localization.point_map import PointMap
from vioapr.mapping.localization.posed_images import PosedImage
from vioapr.mapping.localization.uncertainty import PoseSigmas, error_of, sigma_of_map
from vioapr.work.progress import Tick, ignore

FOLDS = 5
"""Parts of the map. Consecutive images are one part, so that an answer comes from as far as one
of a walk elsewhere in the place would."""

MAX_CHECKED = 60
"""Images that are localized."""

MIN_ANSWERS = 5
"""Fewer do not tell how exact they are."""

MIN_ANGLE_DEG = 1.5
"""Between the rays that place a point; COLMAP's limit."""


class CheckedMap:
    """A map with what its points were made from.

    Attributes:
        place: The map, which states nothing yet.
        rows: Of its images, those that are localized.
    """

    def __init__(
        self,
        place: PointMap,
        images: Sequence[PosedImage],
        features: Mapping[str, Sift],
        points: Mapping[str, NDArray[np.int64]],
    ) -> None:
        """Prepare.

        Args:
            place: The map.
            images: Its images, among others.
            features: Theirs, by name.
            points: By name of an image, the point that each feature sees, -1 for none.
        """
        self.place = place.with_sigmas(PoseSigmas(0.0, 0.0))
        self._features, names = features, place.header.names
        self._cameras = {image.name: image.camera for image in images}
        count = len(names)
        self.rows = np.unique(np.linspace(0, count - 1, min(count, MAX_CHECKED)).astype(np.intp))
        self._bounds = np.linspace(0, count, min(FOLDS, count) + 1).astype(int).tolist()
        self._view = np.repeat(np.arange(count), np.diff(place.first))
        rays = [self._rays(name, points[name] >= 0) for name in names]
        self._ray = quaternion.rotate(place.quat_xyzw[self._view], np.concatenate(rays))

    def _rays(self, name: str, is_seen: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Unit vectors to the points that an image sees, in its camera's axes, shape (k, 3)."""
        pixel = self._features[name].keypoints[is_seen, :2].astype(np.float64)
        camera = to_colmap(self._cameras[name])
        level = np.column_stack([camera.cam_from_img(pixel), np.ones(len(pixel))])
        return level / np.linalg.norm(level, axis=1, keepdims=True)

    def points_without(self, left_out: slice) -> NDArray[np.float64]:
        """Place the points by the observations of the other images.

        Each is where the squares of its distances from the rays, by their lengths, are least.

        Returns:
            Shape (n, 3); NaN where these are too few, or from one side.
        """
        count = len(self.place.points_m)
        is_out = np.zeros(len(self.place.looks), dtype=bool)
        is_out[left_out] = True
        kept = np.flatnonzero(~is_out[self._view])
        point, ray = self.place.point[kept], self._ray[kept]
        eye = self.place.position_m[self._view[kept]]
        across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
        length = np.linalg.norm(self.place.points_m[point] - eye, axis=1)
        weighted = across / np.maximum(length, 1e-9)[:, None, None] ** 2
        # Unweighted, the smallest eigenvalue says by how much the rays differ in direction.
        spread, normal, right = (
            np.zeros((count, 3, 3)),
            np.zeros((count, 3, 3)),
            np.zeros((count, 3)),
        )
        np.add.at(spread, point, across)
        np.add.at(normal, point, weighted)
        np.add.at(right, point, (weighted @ eye[:, :, None])[:, :, 0])
        # Two rays at an angle: 1 - cos(angle).
        is_placed = np.linalg.eigvalsh(spread)[:, 0] >= 1 - np.cos(np.radians(MIN_ANGLE_DEG))
        placed = np.full((count, 3), np.nan)
        solved = np.linalg.solve(normal[is_placed], right[is_placed][:, :, None])
        placed[is_placed] = solved[:, :, 0]
        return placed

    def measure_sigmas(self, tick: Tick = ignore) -> PoseSigmas:
        """Find what the map itself adds to the standard deviations of poses in it.

        Args:
            tick: Called once an image.

        Returns:
            NaN if too few images are localized to tell.
        """
        place, errors, stated = self.place, [], []
        fold_of = np.searchsorted(self._bounds, self.rows, side="right") - 1
        for fold in np.unique(fold_of).tolist():
            left_out = slice(self._bounds[fold], self._bounds[fold + 1])
            localizer = PointMapLocalizer(replace(place, points_m=self.points_without(left_out)))
            for row in self.rows[fold_of == fold].tolist():
                name = place.header.names[row]
                answer = localizer.localize_features(
                    self._features[name], self._cameras[name], left_out
                )
                if answer is not None:
                    errors.append(error_of(answer.world_from_cam, place.world_from_cam.at(row)))
                    stated.append(answer.sigmas)
                tick()
        if len(errors) < MIN_ANSWERS:
            return PoseSigmas(np.nan, np.nan)
        columns = zip(np.array(errors).T, np.array(stated).T, strict=True)
        return PoseSigmas(*(sigma_of_map(error, sigma) for error, sigma in columns))
