"""Whether stated sigmas tell good poses from bad ones: selective risk, and errors far beyond.

Keep the surest frames only: the share that is kept is the coverage, their mean error the risk
(Geifman and El-Yaniv 2017). Where sigmas order frames well, risk rises with coverage; where they
say nothing, it is the mean error throughout.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.metrics import PoseErrors

COVERAGES = (0.5, 0.8, 0.95)
"""Those that tables state the risk at."""

WRONG_SIGMAS = 5.0
"""An error of more stated sigmas is called wrong and sure."""


class RiskCoverage(NamedTuple):
    """The risk at each coverage that a method can have, m of them.

    Attributes:
        coverage: Shape (m,), share of all frames, increasing.
        risk: Shape (m,), the mean error of the frames that are covered.
    """

    coverage: NDArray[np.float64]
    risk: NDArray[np.float64]

    @property
    def area(self) -> float:
        """The mean risk over all coverages: the area below the curve, per coverage; NaN if none."""
        return float(self.risk.mean()) if len(self.risk) else float("nan")

    def risk_at(self, coverage: float) -> float:
        """The risk at the least coverage that is not below this one; NaN if there is none."""
        at = int(np.searchsorted(self.coverage, coverage - 1e-9))
        return float(self.risk[at]) if at < len(self.risk) else float("nan")


def risk_coverage(error: NDArray[np.float64], sigma: NDArray[np.float64]) -> RiskCoverage:
    """Find the mean error of the surest frames, for every number of them.

    Frames without error or sigma are never covered, but count as frames. Frames of one sigma are
    covered in no order: each counts with their mean error.

    Args:
        error: Shape (n,), NaN where there is no pose.
        sigma: Shape (n,), what orders them, smallest first; NaN where nothing is stated.
    """
    answered = np.isfinite(error) & np.isfinite(sigma)
    _, group, size = np.unique(sigma[answered], return_inverse=True, return_counts=True)
    mean_of_group = np.bincount(group, weights=error[answered]) / size
    count = np.arange(1, int(answered.sum()) + 1)
    risk = np.cumsum(np.repeat(mean_of_group, size)) / count
    return RiskCoverage(count / max(len(error), 1), risk)


def wrong_and_sure(
    errors: PoseErrors, sigma_position_m: NDArray[np.float64], sigma_deg: NDArray[np.float64]
) -> float:
    """The share of the frames whose error is above 5 stated sigmas, 0 to 1; NaN if none states.

    In position or in orientation. Sigmas are per axis and errors are lengths: for Gaussian errors
    of these sigmas, 2 in 100,000 frames are.

    Args:
        errors: Shape (n,).
        sigma_position_m: Shape (n,), per axis.
        sigma_deg: Shape (n,), about each axis.
    """
    is_stated = np.isfinite(sigma_position_m) & np.isfinite(sigma_deg)
    is_stated &= np.isfinite(errors.position_m)
    is_wrong = errors.position_m > WRONG_SIGMAS * sigma_position_m
    is_wrong |= errors.orientation_deg > WRONG_SIGMAS * sigma_deg
    return float(is_wrong[is_stated].mean()) if is_stated.any() else math.nan
