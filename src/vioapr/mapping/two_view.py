"""What verified matches say of two images: their rotation, the direction, and roughly the distance.

The length of the way between two images is not in their matches, but how much the rays to their
common points turn on the way is. The same turn between images that follow each other, whose
distance VIO knows, tells how far away the points are; so the length is known to a factor, and
that is enough to tell a facade's next window from one ten metres on.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3, between
from vioapr.mapping.colmap import load_pycolmap, open_database
from vioapr.mapping.features import image_ids
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.pairs import Pairs
from vioapr.mapping.verification import MIN_INLIERS, MIN_TURN_DEG, View, fits, make_view
from vioapr.work.progress import Tick

NEIGHBOUR_S = 5.0
"""Images of one tracking world no further apart in time tell the distance of what they see."""


class PairGeometries(NamedTuple):
    """Pairs of images, m of them, with what their matches say.

    Attributes:
        rows: Rows of the images, shape (m, 2).
        inliers: Matches, shape (m,).
        second_from_first: Rotations, quaternions xyzw, shape (m, 4).
        direction: From the first camera to the second, unit vectors in the axes of the first,
            shape (m, 3).
        turn_deg: Median angle between the two rays to a common point, shape (m,).
    """

    rows: NDArray[np.intp]
    inliers: NDArray[np.intp]
    second_from_first: NDArray[np.float64]
    direction: NDArray[np.float64]
    turn_deg: NDArray[np.float64]

    def at(self, index: Any) -> PairGeometries:
        """Some of them."""
        return PairGeometries._make(column[index] for column in self)

    def and_also(self, others: PairGeometries) -> PairGeometries:
        """These, then those."""
        return PairGeometries._make(np.concatenate(both) for both in zip(self, others, strict=True))


def read_geometries(path: Path, images: MapImages, pairs: Pairs, tick: Tick) -> PairGeometries:
    """Those of the pairs whose matches were verified and whose images both have VIO poses.

    Args:
        path: The database.
        images: The images.
        pairs: Rows of images.
        tick: Called once a pair.

    Raises:
        MappingError: The database cannot be read.
    """
    rows, columns = [], []
    with open_database(path) as database:
        reader = _Reader(database, images)
        for first, second in pairs.tolist():
            tick()
            if images.has_vio[first] and images.has_vio[second]:
                found = reader.read(first, second)
                if found is not None:
                    rows.append((first, second))
                    columns.append(found)
    inliers, rotations, directions, turns = zip(*columns, strict=True) if columns else [[]] * 4
    return PairGeometries(
        np.array(rows, dtype=np.intp).reshape(-1, 2),
        np.array(inliers, dtype=np.intp),
        np.array(rotations, dtype=np.float64).reshape(-1, 4),
        np.array(directions, dtype=np.float64).reshape(-1, 3),
        np.array(turns, dtype=np.float64),
    )


class _Reader:
    """Reads pairs; keeps the features of images, which are in many."""

    def __init__(self, database: Any, images: MapImages) -> None:
        self.database, self.images = database, images
        self.ids = image_ids(database)
        self.cameras = {camera.camera_id: camera for camera in database.read_all_cameras()}
        self.views: dict[int, View] = {}

    def read(self, first: int, second: int) -> tuple[Any, ...] | None:
        """Inliers, rotation, direction and turn of one pair."""
        both = self.ids[self.images.names[first]], self.ids[self.images.names[second]]
        if not self.database.exists_two_view_geometry(*both):
            return None
        geometry = self.database.read_two_view_geometry(*both)
        if len(geometry.inlier_matches) < MIN_INLIERS:
            return None
        one, other = (self._view(id_) for id_ in both)
        is_known = load_pycolmap().estimate_two_view_geometry_pose(
            one.camera, one.pixels, other.camera, other.pixels, geometry
        )
        if not is_known or geometry.cam2_from_cam1 is None:
            return None
        quat = np.array(geometry.cam2_from_cam1.rotation.quat)
        offset = -quaternion.rotate(
            quaternion.inverse(quat), np.array(geometry.cam2_from_cam1.translation)
        )
        length = float(np.linalg.norm(offset))
        direction = offset / length if length > 0 else np.zeros(3)
        return len(geometry.inlier_matches), quat, direction, np.degrees(geometry.tri_angle)

    def read_rays(self, first: int, second: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit vectors to the matches, each in the axes of its camera, shape (k, 3) each."""
        both = self.ids[self.images.names[first]], self.ids[self.images.names[second]]
        matches = self.database.read_two_view_geometry(*both).inlier_matches
        return self._view(both[0]).rays[matches[:, 0]], self._view(both[1]).rays[matches[:, 1]]

    def _view(self, id_: int) -> View:
        if id_ not in self.views:
            camera = self.cameras[self.database.read_image(id_).camera_id]
            self.views[id_] = make_view(camera, self.database.read_keypoints(id_))
        return self.views[id_]


def misfits(
    path: Path, images: MapImages, found: PairGeometries, poses: Rigid3, tick: Tick
) -> NDArray[np.bool_]:
    """Pairs most of whose matches cannot be of one point, were the images at given poses.

    This asks the matches and not the rotation that was computed from them: of points in one plane,
    as facades are, that rotation has two solutions, and the wrong one is taken often.

    Args:
        path: The database.
        images: The images.
        found: Pairs.
        poses: Of all images, in one world.
        tick: Called once a pair.

    Returns:
        Shape (m,).
    """
    result = np.zeros(len(found.rows), dtype=bool)
    with open_database(path) as database:
        reader = _Reader(database, images)
        for k, (first, second) in enumerate(found.rows.tolist()):
            tick()
            first_from_second = between(poses.at(first), poses.at(second))
            rays = reader.read_rays(first, second)
            result[k] = fits(*rays, first_from_second).mean() < 0.5
    return result


def estimate_distances_m(images: MapImages, found: PairGeometries) -> NDArray[np.float64]:
    """Distance between the cameras of every pair to a factor, shape (m,); NaN where unknown.

    Args:
        images: The images.
        found: Pairs, those of neighbours in time among them.
    """
    first, second = found.rows.T
    vio = images.vio_from_cam
    length_m = np.linalg.norm(between(vio.at(first), vio.at(second)).translation_m, axis=1)
    turn = 2 * np.tan(np.radians(found.turn_deg) / 2)
    is_near = images.tracking_world[first] == images.tracking_world[second]
    is_near &= np.abs(images.timestamp_s[first] - images.timestamp_s[second]) <= NEIGHBOUR_S
    is_near &= found.turn_deg >= MIN_TURN_DEG
    depth_m = np.full(len(images), np.nan)
    for row in np.unique(found.rows[is_near]):
        own = is_near & ((first == row) | (second == row))
        depth_m[row] = np.median(length_m[own] / turn[own])
    one, other = depth_m[first], depth_m[second]
    is_unknown = ~np.isfinite(one), ~np.isfinite(other)
    return np.sqrt(np.where(is_unknown[0], other, one) * np.where(is_unknown[1], one, other)) * turn


def between_worlds_deg(
    found: PairGeometries, poses: Rigid3
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """By how much poses contradict the rotations of pairs: about up and across it.

    Args:
        found: Pairs.
        poses: Of all images, in a world, or worlds, with y up.

    Returns:
        heading_deg: What the second camera's world must be turned by about y, so that it
            agrees with the first's, shape (m,).
        tilt_deg: What no such turn explains, shape (m,).
    """
    first, second = (poses.quat_xyzw[rows] for rows in found.rows.T)
    turn = quaternion.multiply(
        first, quaternion.inverse(quaternion.multiply(second, found.second_from_first))
    )
    heading_deg = np.degrees(2 * np.arctan2(turn[:, 1], turn[:, 3]))
    tilt_deg = 2 * np.degrees(np.arctan2(np.hypot(turn[:, 0], turn[:, 2]),
                                         np.hypot(turn[:, 1], turn[:, 3])))  # fmt: skip
    return (heading_deg + 180) % 360 - 180, tilt_deg
