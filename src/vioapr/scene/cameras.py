"""Whether pictures are of the camera that a model knows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.scene.frames import Intrinsics

_TOLERANCE = 0.02
"""Of the image's size: phones' lenses move by less when they focus and stabilize."""


def relative_camera(intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Fx, fy, cx, cy over the image's width and height, shape (..., 4); NaN where not known."""
    width, height, fx, fy, cx, cy = (np.asarray(one, dtype=np.float64) for one in intrinsics)
    return np.stack([fx / width, fy / height, cx / width, cy / height], axis=-1)


def describe_other_camera(camera: ArrayLike, expected: ArrayLike | None) -> str | None:
    """Say that pictures are of another camera than a model knows.

    Args:
        camera: See `relative_camera`, of all pictures, shape (n, 4).
        expected: That of the model, shape (4,); None if it takes any.

    Returns:
        A sentence without its end; None if they are alike, or nothing is known.
    """
    known = np.asarray(camera, dtype=np.float64).reshape(-1, 4)
    known = known[np.isfinite(known).all(axis=-1)]
    if expected is None or not len(known):
        return None
    found, wanted = np.median(known, axis=0), np.asarray(expected, dtype=np.float64)
    if np.abs(found - wanted).max() <= _TOLERANCE:
        return None
    texts = (", ".join(f"{value:.3f}" for value in one) for one in (found, wanted))
    return (
        "the pictures are of another camera than the model knows (fx, fy, cx, cy over the image's "
        f"size: {next(texts)}, expected {next(texts)}), so its poses are wrong"
    )
