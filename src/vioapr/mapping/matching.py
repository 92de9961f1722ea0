"""Matching pairs of images."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry.rigid import Rigid3, between
from vioapr.mapping.colmap import load_pycolmap, open_database, translated_errors
from vioapr.mapping.features import image_ids, read_descriptors
from vioapr.mapping.inputs import Located, MapImages
from vioapr.mapping.pairs import Pairs
from vioapr.mapping.params import MappingParams
from vioapr.mapping.verification import View, make_view, verify
from vioapr.work.progress import Tick

CHUNK = 50
"""Pairs that are written together, and the most that a kill can cost."""

KEPT_IMAGES = 256
"""Images whose features stay in memory: pairs are in order, so most are used again soon."""

MAX_RATIO = 0.8
"""The angle between matched descriptors by that to the next best (Lowe 2004)."""

MAX_ANGLE_RAD = 0.7
"""The largest angle between matched descriptors; both are COLMAP's limits."""


class Features(NamedTuple):
    """An image's features.

    Attributes:
        descriptors: Unit vectors, shape (n, 128).
        view: Where they are.
    """

    descriptors: NDArray[np.float32]
    view: View


def match_pairs(
    path: Path,
    images: MapImages,
    pairs: Pairs,
    guesses: Sequence[Located],
    params: MappingParams,
    tick: Tick,
) -> None:
    """Match and verify all pairs that are not in the database yet.

    Args:
        path: The database, with features.
        images: The images.
        pairs: Rows of images.
        guesses: Where the images may be; the first that fits a pair's matches is taken.
        params: Threads and seed.
        tick: Called once a pair.

    Raises:
        MappingError: The database cannot be read or written.
    """
    with open_database(path) as database, translated_errors(path):
        ids = image_ids(database)
        numbers = [(ids[images.names[a]], ids[images.names[b]]) for a, b in pairs]
        todo = [k for k, pair in enumerate(numbers) if not database.exists_two_view_geometry(*pair)]
        for _ in range(len(pairs) - len(todo)):
            tick()
        read = _reader_of(database)
        known = {k: _known_poses(guesses, *pairs[k]) for k in todo}
        threads = params.threads if params.threads > 0 else os.cpu_count()
        with ThreadPoolExecutor(threads) as pool:

            def match(k: int, features: tuple[Features, Features]) -> Any:
                first, second = features
                matches = match_descriptors(first.descriptors, second.descriptors)
                return verify(first.view, second.view, matches, known[k], params.seed)

            for start in range(0, len(todo), CHUNK):
                chunk = todo[start : start + CHUNK]
                features = [(read(numbers[k][0]), read(numbers[k][1])) for k in chunk]
                found = list(pool.map(match, chunk, features))
                with load_pycolmap().DatabaseTransaction(database):
                    for k, geometry in zip(chunk, found, strict=True):
                        database.write_two_view_geometry(*numbers[k], geometry)
                for _ in chunk:
                    tick()


def _reader_of(database: Any) -> Any:
    """Reads features by COLMAP's number of an image; keeps those last used."""
    cameras = {camera.camera_id: camera for camera in database.read_all_cameras()}

    @lru_cache(KEPT_IMAGES)
    def read(id_: int) -> Features:
        camera = cameras[database.read_image(id_).camera_id]
        view = make_view(camera, np.asarray(database.read_keypoints(id_)))
        return Features(read_descriptors(database, id_), view)

    return read


def _known_poses(guesses: Sequence[Located], first: int, second: int) -> list[Rigid3]:
    """first_from_second by every guess that has both images in one world."""
    both = np.array([first, second])
    poses = [
        guess.world_from_cam.at(both)
        for guess in guesses
        if guess.world[first] == guess.world[second]
    ]
    return [between(each.at(0), each.at(1)) for each in poses if each.is_known.all()]


def match_descriptors(
    first: NDArray[np.float32], second: NDArray[np.float32]
) -> NDArray[np.uint32]:
    """Match features that are each other's nearest, and much nearer than the second nearest.

    Args:
        first: Unit descriptors of one image, shape (n, 128).
        second: Of the other, shape (k, 128).

    Returns:
        Rows of both, shape (m, 2).
    """
    nothing = np.zeros((0, 2), dtype=np.uint32)
    if len(first) < 1 or len(second) < 2:
        return nothing
    cosine = first @ second.T
    rows = np.arange(len(first))
    best = cosine.argmax(axis=1)
    nearest = cosine[rows, best]
    cosine[rows, best] = -1.0
    runner_up = cosine.max(axis=1)
    cosine[rows, best] = nearest
    angle, next_angle = (np.arccos(np.clip(each, -1, 1)) for each in (nearest, runner_up))
    chosen = np.flatnonzero((angle < MAX_RATIO * next_angle) & (angle <= MAX_ANGLE_RAD))
    # Only the few that are left are looked at from the other side.
    is_mutual = cosine[:, best[chosen]].max(axis=0, initial=-1.0) <= nearest[chosen]
    chosen = chosen[is_mutual]
    return np.column_stack([chosen, best[chosen]]).astype(np.uint32)


def count_inliers(path: Path, images: MapImages, pairs: Pairs) -> NDArray[np.intp]:
    """Count the verified matches of every pair, shape (m,).

    Raises:
        MappingError: The database cannot be read.
    """
    counts = np.zeros(len(pairs), dtype=np.intp)
    with open_database(path) as database:
        ids = image_ids(database)
        for k, rows in enumerate(pairs):
            pair = [ids[images.names[row]] for row in rows]
            if database.exists_two_view_geometry(*pair):
                counts[k] = len(database.read_two_view_geometry(*pair).inlier_matches)
    return counts
