"""Whether a model that was made from VIO can be trusted."""

from __future__ import annotations

from typing import Any

from vioapr.errors import MappingError
from vioapr.mapping.alignment import poses_of_model
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.metric import estimate_scales, mean_scale
from vioapr.mapping.outliers import find_breaks
from vioapr.plurals import count_of

MIN_REGISTERED_SHARE = 0.8
"""Of the images that were to be mapped."""

MAX_ERROR_PX = 1.5
"""Largest mean reprojection error, of images 640 pixels long; more for larger ones."""

MAX_BREAK_SHARE = 0.1
"""Of the steps between images; trackers jump now and then, and single images are misplaced."""


def find_fault(model: Any, images: MapImages, expected: int) -> str:
    """Find what speaks against a model that was made from VIO's poses.

    Args:
        model: COLMAP's reconstruction.
        images: All images.
        expected: Number of images that were to be mapped.

    Returns:
        The fault in words, or "" if there is none.
    """
    count = model.num_reg_images()
    if count < MIN_REGISTERED_SHARE * expected or count < 3:
        return f"{count_of(count, 'image')} of {expected} registered"
    size_px = max(max(camera.width, camera.height) for camera in model.cameras.values())
    limit_px = MAX_ERROR_PX * max(size_px / 640, 1.0)
    error_px = model.compute_mean_reprojection_error()
    if error_px > limit_px:
        return f"mean reprojection error {error_px:.2f} px, expected at most {limit_px:.2f}"
    rows, poses = poses_of_model(model, images)
    is_trusted = images.is_tracked[rows]
    rows, poses = rows[is_trusted], poses.at(is_trusted)
    vio, worlds = images.vio_from_cam.at(rows), images.tracking_world[rows]
    times_s = images.timestamp_s[rows]
    try:
        scale = mean_scale(estimate_scales(poses, vio, worlds, times_s))
    except MappingError:
        return "VIO says nothing about its scale"
    metric = poses._replace(translation_m=scale * poses.translation_m)
    breaks = find_breaks(metric, vio, worlds, times_s)
    if len(breaks) and breaks.mean() > MAX_BREAK_SHARE:
        return f"it moves otherwise than VIO in {int(breaks.sum())} of {len(breaks)} steps"
    return ""
