"""Matches that VIO contradicts: facades that repeat look alike, but not to a gyroscope.

Two images of one tracking world have a relative rotation that VIO knows. Of two tracking worlds,
both with gravity, only the heading between them is not known: each pair of images must agree on
up, and all pairs together on the heading. Pairs that do not are taken out before mapping, where
they would bend or fold the model.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.colmap import load_pycolmap, open_database
from vioapr.mapping.features import image_ids
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.matching import MIN_INLIERS
from vioapr.mapping.pairs import Pairs

MAX_TURN_DEG = 10.0
"""Within a tracking world: VIO turns by less between two images that see the same."""

MAX_TILT_DEG = 5.0
"""VIO's gravity is exact to tenths of degrees, the rotation between two images to a few."""

MAX_HEADING_DEG = 20.0
"""From the heading that most matches agree on; VIO's heading drifts over a walk."""

NEAR_M, NEAR_DEG = 3.0, 45.0
"""Images of one tracking world this close see the same anyway; of few or flat points the rotation
between them may still come out wrong."""

MIN_VOTES = 60
"""Matches that must agree on a heading between two tracking worlds, to rule out others."""

_UP = np.array([0.0, 1.0, 0.0])


class PairRotations(NamedTuple):
    """Pairs of images whose relative rotation is known from their matches.

    Attributes:
        rows: Rows of the images, shape (m, 2).
        inliers: Matches, shape (m,).
        second_from_first: Quaternions xyzw, shape (m, 4).
    """

    rows: NDArray[np.intp]
    inliers: NDArray[np.intp]
    second_from_first: NDArray[np.float64]


def prune_pairs(path: Path, images: MapImages, pairs: Pairs, tick: Callable[[], object]) -> int:
    """Empty those of the pairs in the database that VIO contradicts.

    Args:
        path: The database, with verified matches.
        images: The images.
        pairs: Rows of images.
        tick: Called once a pair.

    Returns:
        How many were emptied.

    Raises:
        MappingError: The database cannot be written.
    """
    pycolmap = load_pycolmap()
    with open_database(path) as database:
        found = _read_rotations(database, images, pairs, tick)
        bad = contradicted(images, found)
        ids = image_ids(database)
        for first, second in found.rows[bad]:
            database.update_two_view_geometry(
                ids[images.names[first]], ids[images.names[second]], pycolmap.TwoViewGeometry()
            )
    return int(bad.sum())


def _read_rotations(
    database: Any, images: MapImages, pairs: Pairs, tick: Callable[[], object]
) -> PairRotations:
    pycolmap = load_pycolmap()
    ids = image_ids(database)
    cameras = {camera.camera_id: camera for camera in database.read_all_cameras()}
    pixels: dict[int, Any] = {}

    def camera_and_pixels(row: int) -> tuple[Any, NDArray[np.float64]]:
        if row not in pixels:
            id_ = ids[images.names[row]]
            camera = cameras[database.read_image(id_).camera_id]
            pixels[row] = camera, np.array(database.read_keypoints(id_)[:, :2], dtype=np.float64)
        return pixels[row]

    rows, inliers, rotations = [], [], []
    for first, second in pairs.tolist():
        tick()
        both = ids[images.names[first]], ids[images.names[second]]
        if not (images.has_vio[first] and images.has_vio[second]):
            continue
        if not database.exists_two_view_geometry(*both):
            continue
        geometry = database.read_two_view_geometry(*both)
        if len(geometry.inlier_matches) < MIN_INLIERS:
            continue
        is_known = pycolmap.estimate_two_view_geometry_pose(
            *camera_and_pixels(first), *camera_and_pixels(second), geometry
        )
        if is_known and geometry.cam2_from_cam1 is not None:
            rows.append((first, second))
            inliers.append(len(geometry.inlier_matches))
            rotations.append(np.array(geometry.cam2_from_cam1.rotation.quat))
    return PairRotations(
        np.array(rows, dtype=np.intp).reshape(-1, 2),
        np.array(inliers, dtype=np.intp),
        np.array(rotations).reshape(-1, 4),
    )


def contradicted(images: MapImages, found: PairRotations) -> NDArray[np.bool_]:
    """Which pairs VIO rules out, shape (m,)."""
    first, second = found.rows.T
    worlds = images.tracking_world[found.rows]
    is_same = worlds[:, 0] == worlds[:, 1]
    return np.where(
        is_same,
        _turns_otherwise(images, found) & ~_are_near(images, first, second),
        _tilts_otherwise(images, found) | _heads_otherwise(images, found, worlds),
    )


def _turns_otherwise(images: MapImages, found: PairRotations) -> NDArray[np.bool_]:
    """Whether the rotation is not VIO's."""
    first, second = (images.vio_from_cam.quat_xyzw[rows] for rows in found.rows.T)
    by_vio = quaternion.multiply(quaternion.inverse(second), first)
    return quaternion.angle_between_deg(found.second_from_first, by_vio) > MAX_TURN_DEG


def _are_near(
    images: MapImages, first: NDArray[np.intp], second: NDArray[np.intp]
) -> NDArray[np.bool_]:
    vio = images.vio_from_cam
    apart_m = np.linalg.norm(vio.translation_m[first] - vio.translation_m[second], axis=1)
    turn_deg = quaternion.angle_between_deg(vio.quat_xyzw[first], vio.quat_xyzw[second])
    return (apart_m <= NEAR_M) & (turn_deg <= NEAR_DEG)


def _tilts_otherwise(images: MapImages, found: PairRotations) -> NDArray[np.bool_]:
    """Whether up in the first image is not up in the second."""
    first, second = found.rows.T
    up_first, up_second = (up_in_cam(images, rows) for rows in (first, second))
    turned = quaternion.rotate(found.second_from_first, up_first)
    cosine = np.clip((turned * up_second).sum(axis=-1), -1, 1)
    knows_up = images.is_level[first] & images.is_level[second]
    return (np.degrees(np.arccos(cosine)) > MAX_TILT_DEG) & knows_up


def up_in_cam(images: MapImages, rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """VIO's up in the axes of the cameras, unit vectors, shape (len(rows), 3)."""
    return quaternion.rotate(quaternion.inverse(images.vio_from_cam.quat_xyzw[rows]), _UP)


def tilt_deg(
    images: MapImages, rows: NDArray[np.intp], world_from_cam: Rigid3
) -> NDArray[np.float64]:
    """How far VIO's up is from the world's z in images of given poses, shape (len(rows),)."""
    up = quaternion.rotate(world_from_cam.quat_xyzw, up_in_cam(images, rows))
    return np.degrees(np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2]))


def _heads_otherwise(
    images: MapImages, found: PairRotations, worlds: NDArray[np.integer]
) -> NDArray[np.bool_]:
    """Whether a pair's heading between two tracking worlds is not the one of most matches."""
    first, second = (images.vio_from_cam.quat_xyzw[rows] for rows in found.rows.T)
    between = quaternion.multiply(
        quaternion.multiply(second, found.second_from_first), quaternion.inverse(first)
    )
    heading_deg = np.degrees(2 * np.arctan2(between[:, 1], between[:, 3]))
    votes = np.where(_tilts_otherwise(images, found), 0, found.inliers)
    knows_up = images.is_level[found.rows].all(axis=1)
    is_off = np.zeros(len(worlds), dtype=bool)
    for one, other in np.unique(worlds, axis=0):
        members = np.flatnonzero((worlds == (one, other)).all(axis=1) & knows_up)
        if one != other and len(members):
            is_off[members] = _off_the_mode(heading_deg[members], votes[members])
    return is_off


def _off_the_mode(heading_deg: NDArray[np.float64], votes: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Headings far from the one that has most votes around it."""
    apart = np.abs((heading_deg[:, None] - heading_deg + 180) % 360 - 180)
    support = np.where(apart <= MAX_HEADING_DEG / 2, votes, 0).sum(axis=1)
    best = int(np.argmax(support))
    if support[best] < MIN_VOTES:
        return np.zeros(len(votes), dtype=bool)
    return apart[best] > MAX_HEADING_DEG
