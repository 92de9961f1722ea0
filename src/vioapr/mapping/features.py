"""Cameras, images and their features in COLMAP's database.

The features are SIFT, found by OpenCV: five to eight times faster than by COLMAP, and as exact
(docs/design/mapping.md).
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileError, MappingError, MissingExtraError
from vioapr.files.images import read_grey
from vioapr.mapping.colmap import load_pycolmap, open_database, translated_errors
from vioapr.mapping.inputs import CameraGroup, MapImages
from vioapr.mapping.params import MappingParams
from vioapr.work.progress import Tick

CHUNK = 16
"""Images that are written together, and the most that a kill can cost."""

CONTRAST_THRESHOLD = 0.01
"""Contrast from which a feature counts. OpenCV's 0.04 finds too few in small pictures and dull
light (docs/design/mapping.md)."""

GUESSED_FOCAL = 1.2
"""Focal length by the longer side of images whose intrinsics are not known, as COLMAP guesses."""


class Sift(NamedTuple):
    """The features of an image.

    Attributes:
        keypoints: x, y, scale and orientation in rad, shape (n, 4); the middle of the first
            pixel is at (0.5, 0.5), as COLMAP has it.
        descriptors: Shape (n, 128).
        problem: Why there are none, or "".
    """

    keypoints: NDArray[np.float32]
    descriptors: NDArray[np.uint8]
    problem: str = ""


def load_opencv() -> Any:
    """The module.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("mapping", "OpenCV", "mapping") from None
    return cv2


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
        Names of images without features, and why.

    Raises:
        MappingError: The database cannot be written.
    """
    load_opencv().setNumThreads(1)  # images are done side by side
    problems: dict[str, str] = {}
    with open_database(path) as database, translated_errors(path):
        writer = _Writer(database, images)
        done = _names_with_features(database)
        todo = [row for row, name in enumerate(images.names) if name not in done]
        for _ in range(len(images) - len(todo)):
            tick()
        threads = params.threads if params.threads > 0 else os.cpu_count()
        with ThreadPoolExecutor(threads) as pool:
            for start in range(0, len(todo), CHUNK):
                chunk = todo[start : start + CHUNK]
                paths = [image_folder / images.names[row] for row in chunk]
                found = list(pool.map(lambda file: find_features(file, params), paths))
                with load_pycolmap().DatabaseTransaction(database):  # whole images, or none
                    for row, sift in zip(chunk, found, strict=True):
                        if sift.problem:
                            problems[images.names[row]] = sift.problem
                        else:
                            writer.write(row, sift)
                for _ in chunk:
                    tick()
    return problems


def find_features(path: Path, params: MappingParams) -> Sift:
    """Find the SIFT features of an image file, the descriptors as RootSIFT (Arandjelovic 2012).

    Args:
        path: A JPEG or PNG.
        params: Largest size and number.
    """
    cv2 = load_opencv()
    nothing = Sift(np.zeros((0, 4), np.float32), np.zeros((0, 128), np.uint8))
    try:
        grey = read_grey(path, params.max_image_size)
    except FileError as error:
        return nothing._replace(problem=error.problem)
    # Without the exact doubling of the picture, all positions are off by a quarter of a pixel.
    sift = cv2.SIFT_create(
        nfeatures=params.max_features,
        contrastThreshold=CONTRAST_THRESHOLD,
        enable_precise_upscale=True,
    )
    points, descriptors = sift.detectAndCompute(grey.pixels, None)
    if not points:
        return nothing._replace(problem="has no features")
    place = (np.array([point.pt for point in points]) + 0.5) * grey.scale
    sizes = np.array([point.size for point in points]) / 2 * grey.scale[0]
    angles = np.radians([point.angle for point in points])
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9))
    return Sift(
        np.column_stack([place, sizes, angles]).astype(np.float32),
        np.clip(np.rint(512 * root), 0, 255).astype(np.uint8),
    )


class _Writer:
    """Writes images with features; cameras are written if they are not there yet."""

    def __init__(self, database: Any, images: MapImages) -> None:
        self.database, self.images = database, images
        # The first cameras are there already if an earlier run was interrupted.
        self.cameras = sorted(camera.camera_id for camera in database.read_all_cameras())
        self.rigs = {rig.ref_sensor_id.id: rig.rig_id for rig in database.read_all_rigs()}
        for group in images.cameras[len(self.cameras) :]:
            self.cameras.append(database.write_camera(make_camera(group)))

    def write(self, row: int, sift: Sift) -> None:
        """Write one image."""
        pycolmap = load_pycolmap()
        camera = self.cameras[self.images.camera[row]]
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera)
        if camera not in self.rigs:  # COLMAP wants a rig even of a single camera
            rig = pycolmap.Rig()
            rig.add_ref_sensor(sensor)
            self.rigs[camera] = self.database.write_rig(rig)
        id_ = self.database.write_image(pycolmap.Image(self.images.names[row], camera_id=camera))
        frame = pycolmap.Frame()
        frame.frame_id, frame.rig_id = id_, self.rigs[camera]
        frame.add_data_id(pycolmap.data_t(sensor, id_))
        self.database.write_frame(frame, use_frame_id=True)
        self.database.write_keypoints(id_, sift.keypoints)
        kind = pycolmap.FeatureExtractorType.SIFT
        self.database.write_descriptors(id_, pycolmap.FeatureDescriptors(kind, sift.descriptors))


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
    data = np.asarray(database.read_descriptors(image_id).data)
    if not np.isfinite(data).all():
        raise MappingError(f"image {image_id}: broken descriptors in the database")
    return unit_descriptors(data)


def unit_descriptors(descriptors: NDArray[np.number]) -> NDArray[np.float32]:
    """Descriptors of length 1, shape (n, 128)."""
    data = descriptors.astype(np.float32)
    return data / np.maximum(np.linalg.norm(data, axis=1, keepdims=True), 1e-9)
