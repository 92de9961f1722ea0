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
from vioapr.mapping.localization.localizer import PointMapLocalizer
from vioapr.mapping.localization.params import PointMapParams
from vioapr.mapping.localization.point_map import PointMap, build_point_map
from vioapr.mapping.localization.posed_images import PosedImage
from vioapr.mapping.localization.sources import MapSource, find_source, read_features
from vioapr.mapping.localization.triangulation import MODEL_FOLDER, choose_pairs, triangulate
from vioapr.mapping.localization.uncertainty import PoseSigmas, error_of, sigma_of_map
from vioapr.scene.scene import Scene
from vioapr.work.child import run_in_child
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Progress, Tick, ignore, silent

POINT_MAP_FILE = "models/map/points.npz"
"""In a scene."""

FOLDS = 5
"""Parts of the map, each localized without itself, to see how exact answers are."""

MAX_CHECKED = 60
"""Images of the map that are localized for that."""

MIN_ANSWERS = 5
"""Fewer do not tell how exact they are."""


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
    place = build_point_map(
        images,
        features,
        *points_of_model(model),
        key=key,
        source=source.label,
        is_gravity_aligned=source.is_gravity_aligned,
        max_image_size=source.mapping.max_image_size,
        max_features=source.mapping.max_features,
    )
    rows = rows_to_check(len(place.header.names))
    with progress("checking the map", len(rows)) as tick:
        return place.with_sigmas(measure_sigmas(place, images, features, rows, tick))


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


def rows_to_check(count: int) -> NDArray[np.intp]:
    """Rows of a map's images that are localized to see how exact answers are."""
    return np.unique(np.linspace(0, count - 1, min(count, MAX_CHECKED)).astype(np.intp))


def measure_sigmas(
    place: PointMap,
    images: list[PosedImage],
    features: Mapping[str, Sift],
    rows: NDArray[np.intp],
    tick: Tick = ignore,
) -> PoseSigmas:
    """Find what the map itself adds to the standard deviations of poses in it.

    Images are localized in the map without a fifth of it, their own: consecutive images, so that
    an answer comes from as far as one of a walk elsewhere in the place would.

    Args:
        place: The map, which states nothing yet.
        images: Its images, among others.
        features: Theirs, by name.
        rows: Of the map's images that are localized.
        tick: Called once an image.

    Returns:
        NaN if too few images are localized to tell.
    """
    localizer, count = PointMapLocalizer(place.with_sigmas(PoseSigmas(0.0, 0.0))), len(place.looks)
    cameras = {image.name: image.camera for image in images}
    bounds = np.linspace(0, count, min(FOLDS, count) + 1).astype(int).tolist()
    errors, stated = [], []
    for row in rows.tolist():
        fold = int(np.searchsorted(bounds, row, side="right")) - 1
        name = place.header.names[row]
        answer = localizer.localize_features(
            features[name], cameras[name], slice(bounds[fold], bounds[fold + 1])
        )
        if answer is not None:
            errors.append(error_of(answer.world_from_cam, place.world_from_cam.at(row)))
            stated.append(answer.sigmas)
        tick()
    if len(errors) < MIN_ANSWERS:
        return PoseSigmas(np.nan, np.nan)
    columns = zip(np.array(errors).T, np.array(stated).T, strict=True)
    return PoseSigmas(*(sigma_of_map(error, sigma) for error, sigma in columns))


def _is_current(path: Path, key: str) -> bool:
    try:
        return PointMap.load_header(path).key == key
    except FileError:  # missing, or broken
        return False
