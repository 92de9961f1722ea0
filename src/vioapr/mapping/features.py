"""Cameras, images and their features in COLMAP's database."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MappingError
from vioapr.mapping.colmap import load_pycolmap, open_database, translated_errors
from vioapr.mapping.inputs import CameraGroup, MapImages
from vioapr.mapping.params import MappingParams
from vioapr.work.progress import Tick

CHUNK = 16
"""Images between two reports of progress, and the most that a kill can cost."""

PEAK_THRESHOLD = 0.002
"""Contrast from which a feature counts. COLMAP's 0.0067 finds too few in small pictures and dull
light: a third fewer, and fewer pairs that match (docs/design/mapping.md)."""

GUESSED_FOCAL = 1.2
"""Focal length by the longer side of images whose intrinsics are not known, as COLMAP guesses."""


def extract_features(
    path: Path,
    image_folder: Path,
    images: MapImages,
    params: MappingParams,
    tick: Tick,
) -> dict[str, str]:
    """Find the features of all images that have none in the database yet.

    Args:
        path: The database, made if needed.
        image_folder: What the images' names are relative to.
        images: The images.
        params: Size and number of features.
        tick: Called once an image.

    Returns:
        Names of images that could not be decoded, and why.

    Raises:
        MappingError: The database cannot be written.
    """
    pycolmap = load_pycolmap()
    with open_database(path) as database:
        # The first cameras are there already if an earlier run was interrupted.
        camera_ids = sorted(camera.camera_id for camera in database.read_all_cameras())
        new = images.cameras[len(camera_ids) :]
        camera_ids += [database.write_camera(make_camera(camera)) for camera in new]
        done = _names_with_features(database)
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = params.max_image_size
    options.num_threads = params.threads
    options.sift.max_num_features = params.max_features
    options.sift.peak_threshold = PEAK_THRESHOLD
    for camera, camera_id in enumerate(camera_ids):
        names = [images.names[row] for row in np.flatnonzero(images.camera == camera)]
        todo = [name for name in names if name not in done]
        for _ in range(len(names) - len(todo)):
            tick()
        reader = pycolmap.ImageReaderOptions()
        reader.existing_camera_id = camera_id
        for start in range(0, len(todo), CHUNK):
            chunk = todo[start : start + CHUNK]
            with translated_errors(path):
                pycolmap.extract_features(
                    path,
                    image_folder,
                    image_names=chunk,
                    reader_options=reader,
                    extraction_options=options,
                )
            for _ in chunk:
                tick()
    with open_database(path) as database:
        done = _names_with_features(database)
    missing = [name for name in images.names if name not in done]
    return dict.fromkeys(missing, "cannot be decoded, or has no features")


def make_camera(group: CameraGroup) -> Any:
    """A pinhole, or, where nothing is known, a guess with radial distortion to be refined."""
    pycolmap = load_pycolmap()
    is_known = group.fx is not None
    focal = group.fx or GUESSED_FOCAL * max(group.width, group.height)
    model = "PINHOLE" if is_known else "SIMPLE_RADIAL"
    camera = pycolmap.Camera.create_from_model_name(1, model, focal, group.width, group.height)
    if is_known:
        camera.params = [group.fx, group.fy, group.cx, group.cy]
        camera.has_prior_focal_length = True
    return camera


def _names_with_features(database: Any) -> set[str]:
    return {
        image.name
        for image in database.read_all_images()
        if database.num_keypoints_for_image(image.image_id) > 0
        and database.num_descriptors_for_image(image.image_id) > 0
    }


def image_ids(database: Any) -> dict[str, int]:
    """COLMAP's number of each image, by name."""
    return {image.name: image.image_id for image in database.read_all_images()}


def read_descriptors(database: Any, image_id: int) -> NDArray[np.float32]:
    """Unit SIFT descriptors, shape (features, 128)."""
    data = np.asarray(database.read_descriptors(image_id).data, dtype=np.float32)
    norms = np.linalg.norm(data, axis=1, keepdims=True)
    if not np.isfinite(norms).all():
        raise MappingError(f"image {image_id}: broken descriptors in the database")
    return data / np.maximum(norms, 1e-9)
