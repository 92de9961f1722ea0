"""Where images are, by VIO and matches together; and matches that contradict it.

Facades that repeat look alike, but to get from one window to the next takes a way that VIO has
not gone. Pairs of images that would need it are taken out before mapping, where they would bend
or fold the model.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.colmap import load_pycolmap, open_database
from vioapr.mapping.drift import correct_drift
from vioapr.mapping.features import image_ids
from vioapr.mapping.inputs import Located, MapImages
from vioapr.mapping.joining import MIN_AGREEING_PAIRS, can_be_joined, join_worlds
from vioapr.mapping.pairs import Pairs
from vioapr.mapping.two_view import PairGeometries, estimate_distances_m, misfits, read_geometries
from vioapr.work.progress import Tick

_UP = np.array([0.0, 1.0, 0.0])


def locate(images: MapImages, found: PairGeometries, seed: int) -> Located:
    """Join the tracking worlds and correct their drift.

    Args:
        images: The images.
        found: Pairs, those of neighbours in time among them.
        seed: Of random draws.
    """
    distance_m = estimate_distances_m(images, found)
    poses, world = join_worlds(images, found, distance_m, seed)
    is_inside = world[found.rows[:, 0]] == world[found.rows[:, 1]]
    corrected = correct_drift(images, found.at(is_inside), distance_m[is_inside], poses)
    return Located(corrected, world)


def prune_pairs(
    path: Path,
    images: MapImages,
    pairs: Pairs,
    others: Pairs,
    seed: int,
    tick: Tick,
) -> int:
    """Empty those of the pairs in the database that VIO contradicts.

    Args:
        path: The database, with verified matches.
        images: The images.
        pairs: Rows of images.
        others: Further pairs, which help to locate the images and stay as they are.
        seed: Of random draws.
        tick: Called once a pair.

    Returns:
        How many were emptied.

    Raises:
        MappingError: The database cannot be written.
    """
    pycolmap = load_pycolmap()
    checked = read_geometries(path, images, pairs, int)
    helping = read_geometries(path, images, others, int)
    everything = checked.and_also(helping)
    located = locate(images, everything, seed)
    # Pairs between worlds that could be joined, and were not, agree on no place.
    worlds = np.sort(located.world[everything.rows], axis=1)
    _, kind, count = np.unique(worlds, axis=0, return_inverse=True, return_counts=True)
    is_between = (worlds[:, 0] != worlds[:, 1]) & can_be_joined(images, everything)
    bad = (is_between & (count[kind.ravel()] >= MIN_AGREEING_PAIRS))[: len(checked.rows)]
    is_inside = located.world[checked.rows[:, 0]] == located.world[checked.rows[:, 1]]
    bad[is_inside] = misfits(path, images, checked.at(is_inside), located.world_from_cam, tick)
    # Corrected poses are wrong where pairs are; what VIO itself confirms is right.
    is_suspect = bad & (
        images.tracking_world[checked.rows[:, 0]] == images.tracking_world[checked.rows[:, 1]]
    )
    bad[is_suspect] = misfits(path, images, checked.at(is_suspect), images.vio_from_cam, int)
    with open_database(path) as database:
        ids = image_ids(database)
        for first, second in checked.rows[bad]:
            database.update_two_view_geometry(
                ids[images.names[first]], ids[images.names[second]], pycolmap.TwoViewGeometry()
            )
    return int(bad.sum())


def up_in_cam(images: MapImages, rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """VIO's up in the axes of the cameras, unit vectors, shape (len(rows), 3)."""
    return quaternion.rotate(quaternion.inverse(images.vio_from_cam.quat_xyzw[rows]), _UP)


def tilt_deg(
    images: MapImages, rows: NDArray[np.intp], world_from_cam: Rigid3
) -> NDArray[np.float64]:
    """The angle between VIO's up and the world's z, for images of given poses, (len(rows),)."""
    up = quaternion.rotate(world_from_cam.quat_xyzw, up_in_cam(images, rows))
    return np.degrees(np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2]))
