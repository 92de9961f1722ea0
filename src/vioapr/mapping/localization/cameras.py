"""Cameras of images, as COLMAP models them."""

from __future__ import annotations

from typing import Any

import numpy as np

from vioapr.mapping.colmap import load_pycolmap
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.point_map import CameraModel


def pinhole(intrinsics: Intrinsics, width: int, height: int) -> CameraModel | None:
    """The camera of an image; None if its focal length is not known.

    Args:
        intrinsics: One camera; they are of the image as stored.
        width: Of the image's file, pixels; intrinsics of another size are scaled.
        height: Of the image's file, pixels.
    """
    stated_width, _, *values = (float(np.asarray(value)) for value in intrinsics)
    if not np.isfinite(values).all():
        return None
    scale = width / stated_width if np.isfinite(stated_width) else 1.0
    return CameraModel(
        model="PINHOLE",
        width=width,
        height=height,
        params=tuple(scale * value for value in values),
    )


def to_colmap(camera: CameraModel, camera_id: int = 1) -> Any:
    """COLMAP's camera."""
    pycolmap = load_pycolmap()
    made = pycolmap.Camera.create_from_model_name(
        camera_id, camera.model, 1.0, camera.width, camera.height
    )
    made.params = list(camera.params)
    made.has_prior_focal_length = True
    return made


def from_colmap(camera: Any) -> CameraModel:
    """A camera of a COLMAP model."""
    params = tuple(float(value) for value in camera.params)
    return CameraModel(
        model=camera.model.name, width=int(camera.width), height=int(camera.height), params=params
    )
