"""Pose errors and their summaries (paper, equations 1-18 and section 6)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import rigid
from vioapr.geometry.arrays import Mask
from vioapr.geometry.relative import RelativeGap, relative_gap
from vioapr.geometry.rigid import Rigid3

PRECISION_LEVELS = {"high": (0.25, 2.0), "medium": (0.5, 5.0), "low": (5.0, 10.0)}
"""Largest position error (m) and orientation error (deg) of each level (Sattler et al. 2018)."""


class PoseErrors(NamedTuple):
    """Absolute pose errors, shape (..., n); NaN where there is no estimate.

    Attributes:
        position_m: APE, the distance between the positions (equations 15 and 17).
        orientation_deg: AOE, the angle between the orientations (equations 16 and 18).
    """

    position_m: NDArray[np.float64]
    orientation_deg: NDArray[np.float64]

    def at(self, index: Any) -> PoseErrors:
        """The errors at an index of all axes."""
        return PoseErrors(self.position_m[index], self.orientation_deg[index])


class Summary(NamedTuple):
    """Figures over the frames of a walk, shape (...); NaN where there are none.

    Attributes:
        median_m: Median position error, m.
        median_deg: Median orientation error, deg.
        p95_m: 95th percentile of the position error, m.
        p95_deg: 95th percentile of the orientation error, deg.
        high: Share of the frames within 0.25 m and 2 deg, 0 to 1.
        medium: Within 0.5 m and 5 deg.
        low: Within 5 m and 10 deg.
        share: Frames that were counted, as a share of all, 0 to 1.
    """

    median_m: NDArray[np.float64]
    median_deg: NDArray[np.float64]
    p95_m: NDArray[np.float64]
    p95_deg: NDArray[np.float64]
    high: NDArray[np.float64]
    medium: NDArray[np.float64]
    low: NDArray[np.float64]
    share: NDArray[np.float64]


def pose_errors(gt_world_from_cam: Rigid3, world_from_cam: Rigid3) -> PoseErrors:
    """APE and AOE of every frame, shape (...), any Array API backend."""
    return PoseErrors(
        rigid.distance_m(gt_world_from_cam, world_from_cam),
        rigid.angle_deg(gt_world_from_cam, world_from_cam),
    )


def relative_errors(
    gt_world_from_cam: Rigid3, other_from_cam: Rigid3, step: int = 1
) -> RelativeGap:
    """RPE and ROE between frames `step` apart (equations 10 and 11).

    Args:
        gt_world_from_cam: Shape (..., n).
        other_from_cam: Shape (..., n), in any world: only distances and angles are compared.
        step: Frames between the two of a pair.

    Returns:
        Shape (..., n - step).
    """
    earlier, later = (..., slice(None, -step), slice(None)), (..., slice(step, None), slice(None))
    return relative_gap(
        gt_world_from_cam.at(earlier),
        gt_world_from_cam.at(later),
        other_from_cam.at(earlier),
        other_from_cam.at(later),
    )


def summarize(errors: PoseErrors, is_counted: Mask | None = None) -> Summary:
    """Medians, 95th percentiles and precision levels over the last axis.

    Args:
        errors: Shape (..., n).
        is_counted: Shape (..., n), the frames to count; None for all that have an estimate.

    Returns:
        Shape (...).
    """
    has_estimate = np.isfinite(errors.position_m)
    counted = has_estimate if is_counted is None else has_estimate & is_counted
    position = np.where(counted, errors.position_m, np.nan)
    orientation = np.where(counted, errors.orientation_deg, np.nan)
    count = counted.sum(axis=-1)
    high, medium, low = (
        _ratio(((position <= limit_m) & (orientation <= limit_deg)).sum(axis=-1), count)
        for limit_m, limit_deg in PRECISION_LEVELS.values()
    )
    median_m, p95_m = _quantiles(position, count)
    median_deg, p95_deg = _quantiles(orientation, count)
    share = _ratio(count, np.full_like(count, counted.shape[-1]))
    return Summary(median_m, median_deg, p95_m, p95_deg, high, medium, low, share)


def _ratio(part: NDArray[np.integer], whole: NDArray[np.integer]) -> NDArray[np.float64]:
    return np.where(whole > 0, part / np.maximum(whole, 1), np.nan)


def _quantiles(
    values: NDArray[np.float64], count: NDArray[np.integer]
) -> list[NDArray[np.float64]]:
    """The median and the 95th percentile of the finite values along the last axis.

    Linear interpolation between order statistics, as NumPy's; NaNs sort to the end, so one
    sort serves any number of walks, where nanpercentile goes through them one by one.
    """
    if values.shape[-1] == 0:
        return [np.full(count.shape, np.nan)] * 2
    ordered = np.sort(values, axis=-1)
    quantiles: list[NDArray[np.float64]] = []
    for fraction in (0.5, 0.95):
        position = fraction * np.maximum(count - 1, 0)
        lower = np.floor(position).astype(np.intp)
        upper = np.minimum(lower + 1, np.maximum(count - 1, 0))
        low = np.take_along_axis(ordered, lower[..., None], axis=-1)[..., 0]
        high = np.take_along_axis(ordered, upper[..., None], axis=-1)[..., 0]
        quantiles.append(low + (position - lower) * (high - low))
    return quantiles


def cumulative_distribution(
    errors: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sorted finite errors and, for each, the share that is not larger (equation 14)."""
    ordered = np.sort(errors[np.isfinite(errors)])
    return ordered, np.arange(1, len(ordered) + 1) / max(len(ordered), 1)
