"""What a scene's point map is made from: a map with its features, or images of known poses."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vioapr.errors import MappingError
from vioapr.files.text import read_text
from vioapr.geometry import rigid
from vioapr.mapping.colmap import open_database, read_model
from vioapr.mapping.features import Sift, image_ids
from vioapr.mapping.kept import SUMMARY_FILE, foreign_gt_ids
from vioapr.mapping.localization.params import PointMapParams
from vioapr.mapping.localization.posed_images import (
    PosedImage,
    find_image_folder,
    images_of_model,
    images_of_recordings,
)
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pipeline import WORK_FOLDER
from vioapr.scene.scene import Scene
from vioapr.schemas.base import decode
from vioapr.schemas.map_summary import MapSummary
from vioapr.work.steps import fingerprint

_VERSION = 1
"""Raise it when point maps are made otherwise."""

_SAME_PX = 0.01
"""Pixels of a map and of the features that it was made from are equal but for rounding."""


class MapSource(NamedTuple):
    """What a point map is made from.

    Attributes:
        label: For people.
        images: With their poses.
        is_gravity_aligned: Whether the world's z axis is up.
        mapping: How features are found.
        model: COLMAP's, or None where points must be triangulated.
        database: That may hold the features of the model's images.
    """

    label: str
    images: list[PosedImage]
    is_gravity_aligned: bool
    mapping: MappingParams
    model: Any | None = None
    database: Path | None = None

    @property
    def key(self) -> str:
        """Changes with all that a point map is made from."""
        stats = [image.path.stat() for image in self.images]
        poses = rigid.stack([image.world_from_cam for image in self.images])
        mapping = [self.mapping.max_image_size, self.mapping.max_features]
        return fingerprint(
            [_VERSION, self.label, self.is_gravity_aligned, self.model is not None, mapping],
            [[image.name, image.camera] for image in self.images],
            [[stat.st_size, stat.st_mtime_ns] for stat in stats],
            poses.translation_m,
            poses.quat_xyzw,
            0 if self.model is None else self.model.num_points3D(),
        )


def find_source(scene: Scene, params: PointMapParams) -> MapSource:
    """Find what a scene's point map is to be made from.

    Raises:
        MappingError: There is neither a map nor ground truth, or its images are missing.
        FileError: A file is missing or broken.
    """
    if params.map is not None:
        return _source_of_model(scene, params.map, params.map_images)
    foreign = foreign_gt_ids(scene)
    ids = [id_ for id_ in scene.splits.get("train", ()) if id_ in foreign]
    if not ids and (scene.map_folder / SUMMARY_FILE).exists():
        return _source_of_model(scene, scene.map_folder, None)
    if not ids:
        raise MappingError(
            f"{scene.folder}: expected a map, or ground truth of training recordings, to localize "
            "images in: make it with vioapr map, or name a COLMAP model with `map`"
        )
    images = images_of_recordings(scene, ids, params.max_rate_hz)
    if not images:
        raise MappingError(
            f"{scene.folder}: expected images with ground truth in the training recordings, got "
            "none: is it on the clock of the images?"
        )
    label = f"ground truth of {', '.join(ids)}"
    return MapSource(label, images, scene.world.is_gravity_aligned, MappingParams())


def _source_of_model(scene: Scene, folder: Path, image_folder: Path | None) -> MapSource:
    """A COLMAP model; of one that `vioapr map` made, the features are kept beside it."""
    model = read_model(folder)
    image_folder = image_folder or find_image_folder(model, folder, scene)
    images, mapping, is_own = images_of_model(model, image_folder), MappingParams(), False
    if folder.resolve() == scene.map_folder.resolve() and (folder / SUMMARY_FILE).exists():
        path = folder / SUMMARY_FILE
        stated = decode(path, read_text(path), MapSummary).params
        size, features = (stated.get(name) for name in ("max_image_size", "max_features"))
        if isinstance(size, int) and isinstance(features, int):
            mapping = MappingParams(max_image_size=size, max_features=features)
        is_own = True
    database = scene.folder / WORK_FOLDER / "database.db"
    is_level = is_own and scene.world.is_gravity_aligned
    return MapSource(str(folder), images, is_level, mapping, model, database if is_own else None)


def read_features(source: MapSource) -> dict[str, Sift] | None:
    """Read the features that a map's points are of.

    Returns:
        By the images' names; None if they are no longer there, or the map is of others.
    """
    if source.model is None or source.database is None or not source.database.is_file():
        return None
    pixels = {
        image.name: np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        for image in source.model.images.values()
    }
    found = {}
    with open_database(source.database) as database:
        ids = image_ids(database)
        for image in source.images:
            if image.name not in ids:
                return None
            keypoints = np.asarray(database.read_keypoints(ids[image.name]), dtype=np.float32)
            descriptors = np.asarray(database.read_descriptors(ids[image.name]).data)
            place = pixels[image.name]
            is_same = len(keypoints) == len(place) == len(descriptors)
            if not is_same or np.abs(keypoints[:, :2] - place).max(initial=0.0) > _SAME_PX:
                return None
            found[image.name] = Sift(keypoints, descriptors.astype(np.uint8))
    return found
