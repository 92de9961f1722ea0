"""Whether two images see the same things: which of their matches agree on one geometry.

Where the poses of both are roughly known, by VIO or by what was matched before, the matches are
held against them: that takes a hundredth of the time of a search (RANSAC), and a pair without a
common view cannot pass. Only what does not fit is searched for a geometry of its own: the poses
may be wrong. A geometry that was searched for fits some matches by chance; so it counts only if
chance would hardly ever give it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.colmap import load_pycolmap, to_rigid3d

MIN_INLIERS = 15
"""Matches that must agree on a geometry; COLMAP's own limit for using a pair."""

MIN_TURN_DEG = 0.5
"""Rays that turn by less tell no distance."""

MAX_MISS_DEG = 0.75
"""Two rays to one point miss each other by less, though poses are known to half a degree only."""

MIN_FITTING_SHARE = 0.6
"""Of a pair's matches, for poses to be right; of matches by chance, a tenth fits any poses."""

MAX_ERROR_PX, MIN_ERROR_PX = 4.0, 2.0
"""Of a match that agrees with a geometry: of images 1600 pixels long, and of small ones."""

MAX_FALSE_ALARMS = 1e-3
"""Geometries as good as a pair's to be expected among its matches, were they all by chance."""

MAX_TRIALS = 1000
"""Of a search. COLMAP's 10000 take three times as long, for 2 % more pairs."""

SAMPLE = 5
"""Matches that decide a geometry."""


class View(NamedTuple):
    """What verification needs of an image.

    Attributes:
        camera: COLMAP's.
        pixels: Of its features, shape (n, 2).
        rays: To these, unit vectors in the camera's axes, shape (n, 3).
    """

    camera: Any
    pixels: NDArray[np.float64]
    rays: NDArray[np.float64]


def make_view(camera: Any, keypoints: NDArray[np.floating]) -> View:
    """Prepare an image's features.

    Args:
        camera: COLMAP's.
        keypoints: Shape (n, at least 2), x and y first.
    """
    pixels = np.array(keypoints[:, :2], dtype=np.float64)
    level = np.column_stack([camera.cam_from_img(pixels), np.ones(len(pixels))])
    return View(camera, pixels, level / np.linalg.norm(level, axis=1, keepdims=True))


def verify(
    first: View,
    second: View,
    matches: NDArray[np.uint32],
    guesses: Sequence[Rigid3],
    seed: int,
) -> Any:
    """Find the matches that agree on one geometry.

    Args:
        first: One image.
        second: The other.
        matches: Rows of their features, shape (m, 2).
        guesses: What first_from_second may be, roughly; the first that fits is taken.
        seed: Of the random draws.

    Returns:
        COLMAP's two-view geometry, without inliers if there is none.
    """
    pycolmap = load_pycolmap()
    if len(matches) < MIN_INLIERS:
        return pycolmap.TwoViewGeometry()
    rays = first.rays[matches[:, 0]], second.rays[matches[:, 1]]
    for first_from_second in guesses:
        is_fitting = fits(*rays, first_from_second)
        if is_fitting.sum() >= max(MIN_INLIERS, MIN_FITTING_SHARE * len(matches)):
            return _geometry_of(first_from_second, matches[is_fitting])
    return _search(first, second, matches, seed)


def _geometry_of(first_from_second: Rigid3, matches: NDArray[np.uint32]) -> Any:
    """The geometry of known poses."""
    pycolmap = load_pycolmap()
    geometry = pycolmap.TwoViewGeometry()
    geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
    geometry.cam2_from_cam1 = to_rigid3d(first_from_second.inverse())
    geometry.E = pycolmap.essential_matrix_from_pose(geometry.cam2_from_cam1)
    geometry.inlier_matches = matches
    return geometry


def _search(first: View, second: View, matches: NDArray[np.uint32], seed: int) -> Any:
    pycolmap = load_pycolmap()
    options = pycolmap.TwoViewGeometryOptions()
    longest_px = max(max(view.camera.width, view.camera.height) for view in (first, second))
    error_px = max(MAX_ERROR_PX * min(longest_px / 1600, 1.0), MIN_ERROR_PX)
    options.ransac.max_error = error_px
    options.ransac.random_seed = seed
    options.ransac.max_num_trials = MAX_TRIALS
    options.detect_watermark = False
    geometry = pycolmap.estimate_calibrated_two_view_geometry(
        first.camera, first.pixels, second.camera, second.pixels, matches, options
    )
    inliers = np.asarray(geometry.inlier_matches)
    if len(inliers) < MIN_INLIERS:
        return pycolmap.TwoViewGeometry()
    alarms = log10_false_alarms(
        _count_places(first, second, matches), _count_places(first, second, inliers),
        chance_of_fit(error_px, second.camera.width, second.camera.height),
    )  # fmt: skip
    return geometry if alarms <= np.log10(MAX_FALSE_ALARMS) else pycolmap.TwoViewGeometry()


def _count_places(first: View, second: View, matches: NDArray[np.uint32]) -> int:
    """Count matches between different places: one may have features of several orientations."""
    places = [
        len(np.unique(np.round(view.pixels[matches[:, side]]), axis=0))
        for side, view in enumerate((first, second))
    ]
    return min(places)


def chance_of_fit(error_px: float, width_px: float, height_px: float) -> float:
    """The chance that a point anywhere in an image is within some pixels of a given line."""
    diagonal_px = float(np.hypot(width_px, height_px))
    return min(2 * error_px * diagonal_px / (width_px * height_px), 1.0)


def log10_false_alarms(matches: int, inliers: int, chance: float) -> float:
    """The expected number of geometries as good as one, if all matches were by chance.

    Moisan and Stival (2004), "A probabilistic criterion to detect rigid point matches".

    Args:
        matches: Their number.
        inliers: Number of those that agree.
        chance: That a match by chance agrees with a given geometry.

    Returns:
        Its logarithm to base 10.
    """
    if inliers <= SAMPLE:
        return float(np.log10(max(matches, 1)))
    ways = _log10_choose(matches, inliers) + _log10_choose(inliers, SAMPLE)
    return float(np.log10(matches) + ways + (inliers - SAMPLE) * np.log10(chance))


def _log10_choose(count: int, chosen: int) -> float:
    return float(
        (gammaln(count + 1) - gammaln(chosen + 1) - gammaln(count - chosen + 1)) / np.log(10)
    )


def fits(
    first: NDArray[np.float64], second: NDArray[np.float64], first_from_second: Rigid3
) -> NDArray[np.bool_]:
    """Whether two rays each, in the axes of their cameras, meet, and before the cameras."""
    second = quaternion.rotate(first_from_second.quat_xyzw, second)
    way = first_from_second.translation_m
    normal = np.cross(first, second)
    sine = np.linalg.norm(normal, axis=1)
    is_parallel = sine < np.sin(np.radians(MIN_TURN_DEG))
    length = float(np.linalg.norm(way))
    if length < 1e-9:
        return is_parallel
    # How far the second ray is from the plane of the way and the first ray.
    plane = np.cross(way / length, first)
    off = (second * plane).sum(axis=1) / np.maximum(np.linalg.norm(plane, axis=1), 1e-9)
    is_before = (np.cross(way, second) * normal).sum(axis=1) > 0
    is_before &= (np.cross(way, first) * normal).sum(axis=1) > 0
    return (np.abs(off) < np.sin(np.radians(MAX_MISS_DEG))) & (is_before | is_parallel)
