"""Points from images whose poses are known: matches that obey the poses, COLMAP's tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import rigid
from vioapr.geometry.vectors import angle_between_deg
from vioapr.mapping.colmap import (
    load_pycolmap,
    open_database,
    to_rigid3d,
    translated_errors,
    write_model,
)
from vioapr.mapping.features import Sift, unit_descriptors
from vioapr.mapping.localization.cameras import to_colmap
from vioapr.mapping.localization.posed_images import PosedImage
from vioapr.mapping.matching import match_descriptors
from vioapr.mapping.pairs import Pairs, unique_pairs, viewing_directions
from vioapr.mapping.retrieval import describe_images
from vioapr.mapping.verification import MIN_INLIERS, fits, make_view
from vioapr.work.progress import Tick

NEIGHBOURS = 12
"""Every image is matched with this many that are near and look the same way."""

ALIKE = 4
"""And with this many that look alike: they see the same things from further away."""

MAX_ANGLE_DEG = 60.0
"""Between the optical axes of images that are matched."""

DATABASE_FILE, MODEL_FOLDER = "database.db", "points"


def choose_pairs(
    images: Sequence[PosedImage], features: Mapping[str, Sift], seed: int = 0
) -> Pairs:
    """Choose pairs of images that see the same things, by their poses and by their looks.

    The scale of the world plays no part: a COLMAP model may have any.

    Returns:
        Rows, shape (m, 2), the smaller first.
    """
    poses = rigid.stack([image.world_from_cam for image in images])
    views = viewing_directions(poses.quat_xyzw)
    names = [image.name for image in images]
    looks = describe_images(
        lambda name: unit_descriptors(features[name].descriptors), names, seed=seed
    )
    chosen = [np.zeros((0, 2), dtype=np.intp)]
    for row in range(len(images)):
        distance = np.linalg.norm(poses.translation_m - poses.translation_m[row], axis=1)
        angle_deg = angle_between_deg(views, views[row])
        is_possible = (angle_deg <= MAX_ANGLE_DEG) & (np.arange(len(images)) != row)
        reach = max(float(np.sort(distance)[: 2 * NEIGHBOURS].max()), 1e-9)
        cost = distance / reach + angle_deg / MAX_ANGLE_DEG
        for count, score in ((NEIGHBOURS, -cost), (ALIKE, looks @ looks[row])):
            best = np.argsort(np.where(is_possible, -score, np.inf), kind="stable")[:count]
            best = best[is_possible[best]]
            chosen.append(np.column_stack([np.full(len(best), row), best]))
    return unique_pairs(np.concatenate(chosen))


def triangulate(
    images: Sequence[PosedImage],
    features: Mapping[str, Sift],
    pairs: Pairs,
    folder: Path,
    *,
    tick: Tick,
    seed: int = 0,
) -> None:
    """Triangulate the points that images of known poses see, and write them as a COLMAP model.

    Args:
        images: Their names are those in the model, their rows count from 1 in it.
        features: Of every image, by name.
        pairs: Rows of images to match.
        folder: Where the model is written, with the database in it; it is there and empty.
        tick: Called once a pair.
        seed: Of random draws.

    Raises:
        MappingError: COLMAP failed.
    """
    pycolmap = load_pycolmap()
    model = make_model(images, features)
    path, matcher = folder / DATABASE_FILE, _Matcher(images, features)
    with open_database(path) as database:
        for camera in model.cameras.values():
            database.write_camera(camera, use_camera_id=True)
        for rig in model.rigs.values():
            database.write_rig(rig, use_rig_id=True)
        for frame in model.frames.values():  # before images, which look them up
            database.write_frame(frame, use_frame_id=True)
        for image in model.images.values():
            database.write_image(image, use_image_id=True)
        for row, image in enumerate(images):
            database.write_keypoints(row + 1, features[image.name].keypoints)
        for first, second in pairs.tolist():
            matches = matcher.match(first, second)
            if len(matches) >= MIN_INLIERS:
                geometry = pycolmap.TwoViewGeometry()
                geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
                geometry.inlier_matches = matches
                database.write_two_view_geometry(first + 1, second + 1, geometry)
            tick()
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = seed
    options.triangulation.random_seed = seed
    with translated_errors(path):
        found = pycolmap.triangulate_points(model, path, folder, folder, options=options)
    write_model(found, folder / MODEL_FOLDER)


class _Matcher:
    """Matches images of known poses: only what may be one point, by these, is a match."""

    def __init__(self, images: Sequence[PosedImage], features: Mapping[str, Sift]) -> None:
        self.images, self.features = images, features
        self.views = [
            make_view(to_colmap(image.camera), features[image.name].keypoints) for image in images
        ]

    def match(self, first: int, second: int) -> NDArray[np.uint32]:
        """Rows of features of two images, by their rows, shape (m, 2)."""
        both = [self.images[row] for row in (first, second)]
        matches = match_descriptors(
            *(unit_descriptors(self.features[image.name].descriptors) for image in both)
        )
        rays = [self.views[row].rays[matches[:, side]] for side, row in enumerate((first, second))]
        first_from_second = rigid.between(*(image.world_from_cam for image in both))
        return matches[fits(rays[0], rays[1], first_from_second)]


def make_model(images: Sequence[PosedImage], features: Mapping[str, Sift]) -> Any:
    """A COLMAP model of the images, with their features and without points."""
    pycolmap = load_pycolmap()
    model = pycolmap.Reconstruction()
    number = {camera: k + 1 for k, camera in enumerate(dict.fromkeys(i.camera for i in images))}
    for camera, camera_id in number.items():
        model.add_camera_with_trivial_rig(to_colmap(camera, camera_id))
    for row, posed in enumerate(images):
        image = pycolmap.Image()
        image.name, image.image_id = posed.name, row + 1
        image.camera_id = number[posed.camera]
        pixels = features[posed.name].keypoints[:, :2].astype(np.float64)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(pixel) for pixel in pixels])
        model.add_image_with_trivial_frame(image, to_rigid3d(posed.world_from_cam.inverse()))
    return model
