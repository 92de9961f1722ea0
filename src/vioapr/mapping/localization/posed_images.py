"""Images of known poses: of recordings with ground truth, or of a COLMAP model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vioapr.errors import FileMissingError, FormatError, MappingError
from vioapr.files.images import probe_image
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.colmap import registered_images, world_from_cam
from vioapr.mapping.inputs import thin_frames
from vioapr.mapping.localization.cameras import from_colmap, pinhole
from vioapr.scene.recording import FRAMES_FILE, IMAGES_FOLDER
from vioapr.scene.scene import RECORDINGS_FOLDER, Scene
from vioapr.schemas.point_map import CameraModel
from vioapr.trajectory import poses_of_frames


class PosedImage(NamedTuple):
    """An image and its pose.

    Attributes:
        name: Different for all images of a map.
        path: Its file.
        camera: That took it.
        world_from_cam: Its pose.
    """

    name: str
    path: Path
    camera: CameraModel
    world_from_cam: Rigid3


def images_of_recordings(scene: Scene, ids: Sequence[str], max_rate_hz: float) -> list[PosedImage]:
    """Choose images of recordings that have ground truth.

    Args:
        scene: Whose.
        ids: Of the recordings.
        max_rate_hz: Largest number of images a second of every recording; 0 for all.

    Raises:
        FileMissingError: A recording has no ground truth.
        FormatError: The intrinsics of an image are not known.
        FileError: A recording or its ground truth is broken.
    """
    chosen = []
    for id_ in ids:
        gt, recording = scene.gt(id_), scene.recording(id_)
        if gt is None:
            problem = "expected ground truth, found none: run vioapr map, or import it"
            raise FileMissingError(scene.gt_path(id_), problem)
        frames = recording.frames
        poses = poses_of_frames(gt, frames.timestamp_s)
        known = np.flatnonzero(poses.is_known)
        for row in known[thin_frames(frames.at_rows(known), max_rate_hz)].tolist():
            path = recording.image_path(row)
            probe = probe_image(path)
            if probe.obstacle is not None:
                continue
            camera = pinhole(frames.intrinsics.at(row), probe.width, probe.height)
            if camera is None:
                problem = "expected a focal length to triangulate points by, got none"
                raise FormatError(recording.folder / FRAMES_FILE, problem, int(frames.lines[row]))
            name = f"{id_}/{IMAGES_FOLDER}/{frames.image[row]}"
            chosen.append(PosedImage(name, path, camera, poses.at(row)))
    return chosen


def images_of_model(model: Any, folder: Path) -> list[PosedImage]:
    """The registered images of a COLMAP model.

    Args:
        model: COLMAP's.
        folder: What the images' names are relative to.

    Raises:
        FileMissingError: An image is not there.
    """
    found = []
    for name, image in sorted(registered_images(model).items()):
        path = folder / name
        if not path.is_file():
            problem = "expected an image of the map, found no file of this name"
            raise FileMissingError(path, problem)
        camera = from_colmap(model.cameras[image.camera_id])
        found.append(PosedImage(name, path, camera, world_from_cam(image)))
    return found


def find_image_folder(model: Any, folder: Path, scene: Scene) -> Path:
    """Find what the names of a COLMAP model's images are relative to.

    Looked at are the scene's recordings, the model's folder, those above it, and folders named
    `images` in these.

    Args:
        model: COLMAP's.
        folder: The model's.
        scene: Whose map it is.

    Raises:
        MappingError: They are nowhere.
    """
    names = sorted(registered_images(model))
    if not names:
        raise MappingError(f"{folder}: expected a COLMAP model with registered images, got none")
    above = [folder, *folder.resolve().parents[:3]]
    places = [scene.folder / RECORDINGS_FOLDER, *(p / IMAGES_FOLDER for p in above), *above]
    for place in places:
        if (place / names[0]).is_file():
            return place
    raise MappingError(
        f"{folder}: the images of this map, e.g. {names[0]}, are not beside it: name their folder "
        "with `map_images`"
    )
