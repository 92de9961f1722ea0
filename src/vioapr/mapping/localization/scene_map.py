"""A scene's point map: made if it is not there, and checked on its own images."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileError, UnwritableError
from vioapr.mapping.colmap import load_pycolmap, read_model, registered_images
from vioapr.mapping.features import Sift, find_features, load_opencv
from vioapr.mapping.localization.checking import CheckedMap
from vioapr.mapping.localization.params import PointMapParams
from vioapr.mapping.localization.point_map import PointMap, build_point_map
from vioapr.mapping.localization.posed_images import PosedImage
from vioapr.mapping.localization.sources import MapSource, find_source, read_features
from vioapr.mapping.localization.triangulation import MODEL_FOLDER, choose_pairs, triangulate
from vioapr.scene.scene import Scene
from vioapr.work.child import run_in_child
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Progress, Tick, silent

POINT_MAP_FILE = "models/map/points.npz"
"""In a scene."""


def open_point_map(
    scene: Scene, params: PointMapParams | None = None, progress: Progress = silent
) -> PointMap:
    """Open a scene's point map; it is made first, if it is not there, or of something else.

    Args:
        scene: Whose images are to be localized; the file goes into its `models/map/`.
        params: What the map is made from.
        progress: Opened for every part of the work that takes long.

    Raises:
        MappingError: There is nothing to make it from, or too little.
        LockedError: Another process makes it.
        VioAprError: A file is broken, or cannot be written; a package is missing.
    """
    load_pycolmap()
    load_opencv().setNumThreads(1)  # images are done side by side
    source = find_source(scene, params or PointMapParams())
    path, key = scene.folder / POINT_MAP_FILE, source.key
    with locked_folder(path.parent):
        if not _is_current(path, key):
            make_point_map(source, key, path.parent, progress).save(path)
        return PointMap.load(path)


def make_point_map(source: MapSource, key: str, folder: Path, progress: Progress) -> PointMap:
    """Make a point map, and find how exact answers in it are.

    Args:
        source: What it is made from.
        key: The source's.
        folder: For intermediate files, which are gone after it; it is there.
        progress: Opened for every part of the work that takes long.

    Raises:
        MappingError: No points can be found, or COLMAP failed.
        UnwritableError: The folder cannot be written to.
    """
    images, model, features = source.images, source.model, read_features(source)
    if model is None or features is None:
        with progress("finding features", len(images)) as tick:
            features = find_all_features(source, tick)
        # An image without features can see no point.
        images = [image for image in images if not features[image.name].problem]
        model = triangulate_apart(images, features, folder, progress)
    seen, points_m = points_of_model(model)
    place = build_point_map(
        images,
        features,
        seen,
        points_m,
        key=key,
        source=source.label,
        is_gravity_aligned=source.is_gravity_aligned,
        shares_cameras=source.model is not None,
        max_image_size=source.mapping.max_image_size,
        max_features=source.mapping.max_features,
    )
    checked = CheckedMap(place, images, features, seen)
    with progress("checking the map", len(checked.rows)) as tick:
        return place.with_sigmas(checked.measure_sigmas(tick))


def find_all_features(source: MapSource, tick: Tick) -> dict[str, Sift]:
    """Find the features of all images, by name."""
    found = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        paths = [image.path for image in source.images]
        results = pool.map(lambda path: find_features(path, source.mapping), paths)
        for image, sift in zip(source.images, results, strict=True):
            found[image.name] = sift
            tick()
    return found


def triangulate_apart(
    images: list[PosedImage], features: Mapping[str, Sift], folder: Path, progress: Progress
) -> Any:
    """Triangulate in a process of its own, which a full disk may end; see `triangulate`.

    Returns:
        COLMAP's model.
    """
    pairs = choose_pairs(images, features)
    try:
        with (
            tempfile.TemporaryDirectory(dir=folder, prefix=".triangulation-") as scratch,
            progress("matching images of known poses", len(pairs)) as tick,
        ):
            run_in_child(triangulate, images, dict(features), pairs, Path(scratch), tick=tick)
            return read_model(Path(scratch) / MODEL_FOLDER)
    except OSError as error:
        raise UnwritableError.of(folder, error) from None


def points_of_model(
    model: Any,
) -> tuple[dict[str, NDArray[np.int64]], dict[int, NDArray[np.float64]]]:
    """The points of a COLMAP model: of every image's features, by name; and where they are."""
    seen = {
        name: np.array(
            [p.point3D_id if p.has_point3D() else -1 for p in image.points2D], dtype=np.int64
        )
        for name, image in registered_images(model).items()
    }
    return seen, {number: np.array(point.xyz) for number, point in model.points3D.items()}


def _is_current(path: Path, key: str) -> bool:
    try:
        return PointMap.load_header(path).key == key
    except FileError:  # missing, or broken
        return False
