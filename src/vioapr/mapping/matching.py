"""Matching pairs of images, and what is connected by matches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vioapr.mapping.colmap import load_pycolmap, open_database, translated_errors
from vioapr.mapping.features import image_ids
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.pairs import Pairs
from vioapr.mapping.params import MappingParams
from vioapr.work.progress import Tick

CHUNK = 200
"""Pairs between two reports of progress, and the most that a kill can cost."""

MIN_INLIERS = 15
"""Matches that must agree on a geometry; COLMAP's own limit for using a pair."""


def match_pairs(
    path: Path,
    images: MapImages,
    pairs: Pairs,
    params: MappingParams,
    tick: Tick,
) -> None:
    """Match and verify all pairs that are not in the database yet.

    Args:
        path: The database, with features.
        images: The images.
        pairs: Rows of images.
        params: Threads and seed.
        tick: Called once a pair.

    Raises:
        MappingError: The database cannot be written.
    """
    pycolmap = load_pycolmap()
    with open_database(path) as database:
        ids = image_ids(database)
        names = images.names
        numbers = [(ids[names[a]], ids[names[b]]) for a, b in pairs]
        is_done = [database.exists_two_view_geometry(*pair) for pair in numbers]
    todo = pairs[~np.array(is_done, dtype=bool)]
    for _ in range(len(pairs) - len(todo)):
        tick()
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = params.threads
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = params.seed
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = path.with_name("pairs.txt")
    for start in range(0, len(todo), CHUNK):
        chunk = todo[start : start + CHUNK]
        lines = [f"{names[a]} {names[b]}\n" for a, b in chunk]
        with translated_errors(path):
            pairing.match_list_path.write_text("".join(lines), encoding="utf-8")
            pycolmap.match_image_pairs(path, matching, pairing, verification)
        for _ in chunk:
            tick()


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


def find_islands(
    images: MapImages, pairs: Pairs, inliers: NDArray[np.intp], ids: Sequence[str]
) -> list[list[str]]:
    """Group the recordings that see common things: ids, the largest group of images first.

    Two recordings are of one group if images of the one match images of the other, directly or
    by way of further recordings.
    """
    good = pairs[inliers >= MIN_INLIERS]
    count = len(images)
    graph = coo_array((np.ones(len(good)), (good[:, 0], good[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    # A recording belongs where most of its images are.
    home = {id_: int(np.bincount(label[images.rows_of(id_)]).argmax()) for id_ in ids}
    sizes = dict.fromkeys(home.values(), 0)
    for id_, island in home.items():
        sizes[island] += len(images.rows_of(id_))
    order = sorted(sizes, key=lambda island: -sizes[island])
    return [[id_ for id_ in ids if home[id_] == island] for island in order]
