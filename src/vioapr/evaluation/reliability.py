"""Figures beside accuracy: whether content stays put, and whether stated sigmas can be believed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vioapr.evaluation.content_jumps import ContentSteps
from vioapr.evaluation.metrics import PoseErrors
from vioapr.evaluation.risk_coverage import COVERAGES, risk_coverage, wrong_and_sure
from vioapr.geometry.arrays import FloatArray


class Reliability(NamedTuple):
    """Figures of a walk, or over walks; NaN where a method states no sigmas.

    Attributes:
        jumps_per_min: Steps of content above 5 cm, a minute; see `content_jumps`.
        largest_jump_m: The largest step of content, m.
        wrong_and_sure: Share of the frames with a sigma whose error is above 5 sigmas, 0 to 1.
        mean_m: Mean position error of the frames with a pose, m.
        mean_deg: Mean orientation error, deg.
        risk_area_m: The mean over all coverages of the mean error of the surest frames, m.
        risk_area_deg: The same of the orientation, deg.
        risk_50_m: Mean error of the surest 50 % of all frames, m; NaN if fewer have a pose.
        risk_50_deg: The same of the orientation, deg.
        risk_80_m: Of the surest 80 %.
        risk_80_deg: Of the surest 80 %.
        risk_95_m: Of the surest 95 %.
        risk_95_deg: Of the surest 95 %.
    """

    jumps_per_min: float
    largest_jump_m: float
    wrong_and_sure: float
    mean_m: float
    mean_deg: float
    risk_area_m: float
    risk_area_deg: float
    risk_50_m: float
    risk_50_deg: float
    risk_80_m: float
    risk_80_deg: float
    risk_95_m: float
    risk_95_deg: float


def measure_reliability(
    errors: PoseErrors,
    sigma_position_m: FloatArray | None,
    sigma_orientation_deg: FloatArray | None,
    content: ContentSteps | None,
) -> Reliability:
    """Find the figures of one walk.

    Args:
        errors: Shape (n,), of the frames with ground truth; NaN without a pose.
        sigma_position_m: Shape (n,), per axis, or None if the method states none.
        sigma_orientation_deg: Shape (n,), or None.
        content: Of all the walk's frames, or None if it is not known where content was shown.
    """
    unknown = np.full(len(errors.position_m), np.nan)
    sigmas = [
        unknown if sigma is None else sigma for sigma in (sigma_position_m, sigma_orientation_deg)
    ]
    curves = [risk_coverage(*pair) for pair in zip(errors, sigmas, strict=True)]
    risks = [curve.risk_at(coverage) for coverage in COVERAGES for curve in curves]
    return Reliability(
        float("nan") if content is None else content.jumps_per_min,
        float("nan") if content is None else content.largest_m,
        wrong_and_sure(errors, sigmas[0], sigmas[1]),
        *(_mean_of_known(error) for error in errors),
        *(curve.area for curve in curves),
        *risks,
    )


def mean_reliability(walks: Sequence[Reliability]) -> Reliability:
    """Means over the walks that have a figure; of the largest jump, the largest."""
    figures = zip(*walks, strict=True)
    mean = Reliability(*(_mean_of_known(np.array(figure)) for figure in figures))
    largest = np.array([walk.largest_jump_m for walk in walks])
    known = largest[np.isfinite(largest)]
    return mean._replace(largest_jump_m=float(known.max()) if len(known) else float("nan"))


def _mean_of_known(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
