"""pycolmap: imported when it is needed, quiet, and with errors of ours."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vioapr.errors import MappingError, MissingExtraError
from vioapr.geometry.rigid import Rigid3

if TYPE_CHECKING:
    import pycolmap


def load_pycolmap() -> Any:
    """The module.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        import pycolmap
    except ImportError:
        raise MissingExtraError("mapping", "pycolmap", "mapping") from None
    # Its own log is for its developers; what goes wrong comes as exceptions.
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    return pycolmap


@contextmanager
def open_database(path: Path) -> Iterator[Any]:
    """COLMAP's database, made if needed, closed in any case.

    Raises:
        MappingError: It cannot be read or written.
    """
    pycolmap = load_pycolmap()
    with translated_errors(path):
        database = pycolmap.Database.open(path)
        try:
            yield database
        finally:
            database.close()


@contextmanager
def translated_errors(path: Path) -> Iterator[None]:
    """Turns COLMAP's complaints about files, e.g. of a full disk, into an error of ours."""
    try:
        yield
    except (RuntimeError, ValueError, OSError) as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else "unknown reason"
        raise MappingError(
            f"{path}: COLMAP failed: {reason[:300]} (is the disk full? what was finished before is "
            "kept: run again to resume)"
        ) from None


def read_model(folder: Path) -> Any:
    """A reconstruction.

    Raises:
        MappingError: It cannot be read.
    """
    with translated_errors(folder):
        return load_pycolmap().Reconstruction(folder)


def write_model(model: Any, folder: Path) -> None:
    """Write a reconstruction; what is in the folder is replaced.

    Raises:
        MappingError: It cannot be written.
    """
    with translated_errors(folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        model.write(folder)


def registered_images(model: Any) -> dict[str, Any]:
    """The images of a reconstruction that have a pose, by name."""
    return {image.name: image for image in model.images.values() if image.has_pose}


def world_from_cam(image: pycolmap.Image) -> Rigid3:
    """The pose of a registered image."""
    cam_from_world = image.cam_from_world()
    return Rigid3(
        np.array(cam_from_world.translation, dtype=np.float64),
        np.array(cam_from_world.rotation.quat, dtype=np.float64),
    ).inverse()


def to_rigid3d(pose: Rigid3) -> Any:
    """COLMAP's form of a pose."""
    pycolmap = load_pycolmap()
    return pycolmap.Rigid3d(pycolmap.Rotation3d(pose.quat_xyzw), pose.translation_m)
