"""Poses of further images in a finished map, which stays as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.colmap import (
    load_pycolmap,
    open_database,
    registered_images,
    translated_errors,
)
from vioapr.mapping.features import image_ids
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.joining import MAX_TILT_DEG
from vioapr.mapping.pairs import Pairs, query_pairs, view_cost, viewing_directions
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pruning import tilt_deg
from vioapr.schemas.base import Record
from vioapr.work.progress import Tick

MAX_ERROR_PX = 6.0
"""Largest reprojection error of a point that agrees with a pose, of images 640 pixels long."""

MIN_ERROR_PX = 3.0
"""But not less: features are not found more exactly on small images."""


class RegisteredImage(Record, frozen=True):
    """The pose of one image.

    Attributes:
        row: The image.
        position_m: Of the camera in the world, shape (3,).
        quat_xyzw: Its orientation, world_from_cam.
        inliers: Number of points that agree with the pose.
        error_px: Their median reprojection error.
    """

    row: int
    position_m: list[float]
    quat_xyzw: list[float]
    inliers: int
    error_px: float

    @property
    def world_from_cam(self) -> Rigid3:
        """The pose."""
        return Rigid3(np.array(self.position_m), np.array(self.quat_xyzw))


def register_images(
    database_path: Path,
    model: Any,
    images: MapImages,
    pairs: Pairs,
    params: MappingParams,
    tick: Tick,
) -> list[RegisteredImage]:
    """Find the poses of images from their matches with images of the map.

    Args:
        database_path: With verified matches of the pairs.
        model: The map.
        images: All images.
        pairs: Rows: an image to register, an image of the map.
        params: Smallest number of agreeing points, seed.
        tick: Called once an image to register.

    Returns:
        Those that could be registered, by row.
    """
    # The 3D point of every feature of the map's images, -1 where it has none.
    points = {
        name: np.array(
            [p.point3D_id if p.has_point3D() else -1 for p in image.points2D], dtype=np.int64
        )
        for name, image in registered_images(model).items()
    }
    found = []
    with open_database(database_path) as database, translated_errors(database_path):
        ids = image_ids(database)
        for row in np.unique(pairs[:, 0]):
            query = ids[images.names[row]]
            partners = [images.names[k] for k in pairs[pairs[:, 0] == row, 1]]
            matches = [
                match_points(database, query, ids[name], points[name])
                for name in partners
                if name in points
            ]
            answer = estimate_pose(database, model, query, matches, params)
            tick()
            if answer is None:
                continue
            pose, inliers, error_px = answer
            # A place that looks alike: VIO's gravity rules the pose out.
            has_up = images.has_vio[row] and images.is_level[row]
            if has_up and tilt_deg(images, np.array([row]), pose.at(None))[0] > MAX_TILT_DEG:
                continue
            position, quat = (part.tolist() for part in pose)
            found.append(
                RegisteredImage(
                    row=int(row), position_m=position, quat_xyzw=quat, inliers=inliers,
                    error_px=error_px,
                )
            )  # fmt: skip
    return found


def pairs_by_vio(
    images: MapImages,
    rows: NDArray[np.intp],
    found: list[RegisteredImage],
    mapped: NDArray[np.intp],
    mapped_poses: Rigid3,
    count: int,
) -> Pairs:
    """For images that were not registered: those of the map that see the same, by VIO.

    The pose of an image is predicted from the registered image of its tracking world that is
    nearest in time, and VIO between the two.

    Args:
        images: All images.
        rows: Those to register.
        found: Those of them that are registered.
        mapped: The map's images.
        mapped_poses: Their poses, world_from_cam.
        count: Number of pairs for each image.

    Returns:
        Rows, shape (m, 2): an image to register, an image of the map.
    """
    known = {registered.row: registered.world_from_cam for registered in found}
    views = viewing_directions(mapped_poses.quat_xyzw)
    queries, scores = [], []
    for row in rows:
        world = images.tracking_world[row]
        anchors = [k for k in known if images.tracking_world[k] == world and images.has_vio[k]]
        if row in known or not anchors or not images.has_vio[row]:
            continue
        time_s = images.timestamp_s[row]
        anchor = min(anchors, key=lambda k: abs(images.timestamp_s[k] - time_s))
        vio = images.vio_from_cam
        predicted = known[anchor] @ rigid.between(vio.at(anchor), vio.at(row))
        view = viewing_directions(predicted.quat_xyzw)
        queries.append(row)
        scores.append(-view_cost(mapped_poses.translation_m, views, predicted.translation_m, view))
    return query_pairs(np.array(queries, dtype=np.intp), mapped, np.array(scores), count)


def match_points(
    database: Any, query: int, other: int, point_of_feature: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Find the points of the map that features of an image see, by its matches with another.

    Args:
        database: COLMAP's, open.
        query: Number of the image.
        other: Number of an image of the map.
        point_of_feature: The 3D point of each of its features, -1 where it has none.

    Returns:
        Rows of a feature and a 3D point, shape (m, 2).
    """
    if not database.exists_two_view_geometry(query, other):
        return np.zeros((0, 2), dtype=np.int64)
    matches = database.read_two_view_geometry(query, other).inlier_matches
    features = np.asarray(matches, dtype=np.int64).reshape(-1, 2)
    points = point_of_feature[features[:, 1]]
    return np.column_stack([features[:, 0], points])[points >= 0]


def estimate_pose(
    database: Any,
    model: Any,
    image_id: int,
    matches: list[NDArray[np.int64]],
    params: MappingParams,
) -> tuple[Rigid3, int, float] | None:
    """Estimate the pose of an image from the points that it sees (P3P, RANSAC).

    Args:
        database: COLMAP's, open.
        model: The map.
        image_id: COLMAP's number of the image.
        matches: Rows of a feature and a 3D point, by each image of the map.
        params: Smallest number of agreeing points, seed.

    Returns:
        The pose, world_from_cam, the number of agreeing features and their median error in
        pixels; None if too few agree.
    """
    pycolmap = load_pycolmap()
    together = np.unique(np.concatenate([np.zeros((0, 2), np.int64), *matches]), axis=0)
    if len(together) < params.min_inliers:
        return None
    # The camera as the map has adjusted it, if the map has it.
    camera_id = database.read_image(image_id).camera_id
    is_in_map = camera_id in model.cameras
    camera = model.cameras[camera_id] if is_in_map else database.read_camera(camera_id)
    keypoints = np.asarray(database.read_keypoints(image_id))
    pixels = np.asarray(keypoints[together[:, 0], :2], dtype=np.float64)
    world = np.array([model.points3D[point].xyz for point in together[:, 1]])
    options = pycolmap.AbsolutePoseEstimationOptions()
    scale = max(camera.width, camera.height) / 640
    options.ransac.max_error = max(MAX_ERROR_PX * scale, MIN_ERROR_PX)
    options.ransac.random_seed = params.seed
    answer = pycolmap.estimate_and_refine_absolute_pose(pixels, world, camera, options)
    if answer is None:
        return None
    is_inlier = np.asarray(answer["inlier_mask"], dtype=bool)
    # A feature that matches two points counts once.
    inliers = len(np.unique(together[is_inlier, 0]))
    if inliers < params.min_inliers:
        return None
    cam_from_world = answer["cam_from_world"]
    seen = np.asarray(camera.img_from_cam(cam_from_world * world[is_inlier]))
    error_px = float(np.median(np.linalg.norm(seen - pixels[is_inlier], axis=1)))
    pose = Rigid3(np.array(cam_from_world.translation), np.array(cam_from_world.rotation.quat))
    return pose.inverse(), inliers, error_px
