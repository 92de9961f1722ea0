"""Images by which the ranges of 8-bit arithmetic are found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.export.preprocess import Preprocessor
from vioapr.files.images import read_rgb
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.scene.scene import Scene

IMAGES = 100
"""More do not change the ranges by much."""


def training_images(
    scene_folder: Path, preprocess: Preprocessor
) -> Callable[[], list[NDArray[np.float32]]]:
    """Gives the network's inputs of some training images, evenly spread.

    Raises:
        FormatError: The scene has no training images.
    """
    scene = Scene.open(scene_folder)
    paths = []
    for id_ in scene.splits["train"]:
        names = scene.recording(id_).frames.image
        paths += [scene.recording_folder(id_) / IMAGES_FOLDER / name for name in names if name]
    if not paths:
        raise FormatError(scene_folder, "expected training images, found none")
    rows = np.unique(np.linspace(0, len(paths) - 1, IMAGES).astype(int))

    def load() -> list[NDArray[np.float32]]:
        with torch.no_grad():
            images = (torch.from_numpy(np.array(read_rgb(paths[row]))) for row in rows)
            return [preprocess(image).numpy() for image in images]

    return load
