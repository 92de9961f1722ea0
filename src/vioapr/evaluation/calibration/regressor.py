"""What a regressor errs by, measured against ground truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.cases import Case
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.calibration import PredictionErrors

_SIGMAS_OF_MAD = 1.4826
_COMMON = 1 / np.e
"""Share of the errors' variance that two views still have in common at the view length."""

_VIEW_RAD = 0.26
"""Views are compared only where their directions are at most so far apart."""

_MOST_FRAMES = 400
"""Of a walk, frames of which all pairs are compared."""

_FARTHEST_M = 50.0
_FORWARD = np.array([0.0, 0.0, 1.0])


def measure_regressor(cases: Sequence[Case]) -> PredictionErrors:
    """Measure the regressor of some cases, all with the same one.

    Args:
        cases: At least one frame in all has both a prediction and ground truth.
    """
    walks = [_of_walk(case) for case in {(c.set_name, c.walk): c for c in cases}.values()]
    gt, apr = (
        Rigid3(*(np.concatenate(parts) for parts in zip(*poses, strict=True)))
        for poses in ([walk[side] for walk in walks] for side in (0, 1))
    )
    wrong_m, wrong_rad = errors_in_camera(gt, apr)
    distance_m, angle_rad = (np.linalg.norm(e, axis=-1) for e in (wrong_m, wrong_rad))
    position, orientation = (_spread(e) for e in (wrong_m, wrong_rad))
    return PredictionErrors(
        position_axes_m=position,
        orientation_axes_rad=orientation,
        position_tail=_tail(distance_m),
        orientation_tail=_tail(angle_rad),
        view_length_m=view_length_m(walks),
        look_at_m=look_at_m(gt, apr),
    )


def _of_walk(case: Case) -> tuple[Rigid3, Rigid3]:
    rows = case.has_gt & case.frames.inputs.has_apr
    return case.gt_world_from_cam.at(rows), case.frames.inputs.apr_world_from_cam.at(rows)


def errors_in_camera(gt: Rigid3, apr: Rigid3) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Predicted less true position, and the turn from true to predicted, in the camera's axes.

    Shape (n, 3) each, m and rad.
    """
    to_camera = quaternion.inverse(gt.quat_xyzw)
    wrong_m = quaternion.rotate(to_camera, apr.translation_m - gt.translation_m)
    return wrong_m, quaternion.to_rotvec(quaternion.multiply(to_camera, apr.quat_xyzw))


def _spread(errors: NDArray[np.float64]) -> tuple[float, float, float]:
    """Robust standard deviations about zero of three columns."""
    x, y, z = (np.median(np.abs(errors), axis=0) * _SIGMAS_OF_MAD).tolist()
    return x, y, z


def _tail(errors: NDArray[np.float64]) -> float:
    median, far = np.percentile(errors, [50, 95])
    return float(far / median) if median > 0 else 0.0


def view_length_m(walks: Sequence[tuple[Rigid3, Rigid3]]) -> float:
    """Motion after which two predictions of like direction have lost most of their common error.

    The typical squared difference of two errors grows with the distance between their views, to
    twice the errors' variance (a variogram). Of the errors at any distance, neighbours have all
    in common but what changes from frame to frame.

    Args:
        walks: True and predicted poses of each.

    Returns:
        0 where no walk goes so far.
    """
    apart: list[NDArray[np.float64]] = []
    gaps: list[NDArray[np.float64]] = []
    for gt, apr in walks:
        rows = np.unique(np.linspace(0, len(gt.quat_xyzw) - 1, _MOST_FRAMES).astype(int))
        place_m = gt.translation_m[rows]
        error_m = apr.translation_m[rows] - place_m
        gaze = quaternion.rotate(gt.quat_xyzw[rows], _FORWARD)
        first, second = np.triu_indices(len(rows), 1)
        is_alike = np.sum(gaze[first] * gaze[second], axis=-1) > np.cos(_VIEW_RAD)
        first, second = first[is_alike], second[is_alike]
        apart.append(np.linalg.norm(place_m[first] - place_m[second], axis=-1))
        gaps.append(np.sum((error_m[first] - error_m[second]) ** 2, axis=-1))
    distance_m, gap2 = np.concatenate(apart), np.concatenate(gaps)
    if len(distance_m) < 50:
        return 0.0
    edges = np.quantile(distance_m, np.linspace(0, 1, 21))
    bins = np.clip(np.searchsorted(edges, distance_m, side="right") - 1, 0, 19)
    levels = np.array([np.median(gap2[bins == b]) for b in np.unique(bins)])
    centres = np.array([np.median(distance_m[bins == b]) for b in np.unique(bins)])
    sill = float(np.median(levels[len(levels) // 2 :]))
    is_apart = levels >= levels[0] + (1 - _COMMON) * (sill - levels[0])
    return float(centres[np.argmax(is_apart)]) if is_apart.any() else 0.0


def look_at_m(gt: Rigid3, apr: Rigid3) -> float:
    """Distance in front of the camera of the point about which predictions err as if turned."""
    swing = quaternion.rotate(apr.quat_xyzw, _FORWARD) - quaternion.rotate(gt.quat_xyzw, _FORWARD)
    wrong_m = apr.translation_m - gt.translation_m
    length2 = np.sum(swing**2, axis=-1)
    if not length2.any():
        return 0.0
    depth = 0.0
    for _ in range(20):  # Cauchy weights
        left2 = np.sum((wrong_m + depth * swing) ** 2, axis=-1)
        weight = 1 / (np.median(left2) + left2 + 1e-12)
        depth = -float(np.sum(weight * np.sum(wrong_m * swing, axis=-1)))
        depth = depth / max(float(np.sum(weight * length2)), 1e-12)
    return float(np.clip(depth, 0.0, _FARTHEST_M))
