"""By which factor stated sigmas become true."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vioapr.schemas.calibration import Coverage

SIGMAS = (1.0, 2.0, 3.0)

_SQUARES = np.array(SIGMAS) ** 2
PROMISED: NDArray[np.float64] = (_SQUARES / (_SQUARES + 2)) ** 1.5
"""Shares of frames within 1, 2 and 3 sigmas per axis: 19, 54, 74 %.

Errors are heavy-tailed: their three axes are Student's t with two degrees of freedom, the
distribution of whose radius this is.
"""

_FACTORS: NDArray[np.float64] = np.geomspace(0.05, 20, 301)
_LEAST = 0.05
"""Smallest factor: from few walks, none is sure of a smaller one."""


def fit_factor(in_sigmas: Sequence[NDArray[np.float64]]) -> float:
    """The factor by which most of what `PROMISED` says comes true, every walk counting the same.

    Args:
        in_sigmas: Of each walk, errors over the stated sigmas; NaN where there is no answer.
    """
    shares = np.array([coverage_of([e / f for e in in_sigmas]) for f in _FACTORS])
    worst = np.max(np.abs(shares - PROMISED), axis=-1)
    if not np.isfinite(worst).any():
        return 1.0
    # Of factors that do equally well, the middle one.
    best = _FACTORS[worst <= np.nanmin(worst) + 1e-9]
    return max(float(best[len(best) // 2]), _LEAST)


def coverage_of(in_sigmas: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Shares of frames within 1, 2 and 3 sigmas, means over walks, shape (3,)."""
    known = [e[np.isfinite(e)] for e in in_sigmas]
    shares = [[float(np.mean(e < k)) for k in SIGMAS] for e in known if len(e)]
    return np.mean(shares, axis=0) if shares else np.full(3, np.nan)


def to_coverage(shares: NDArray[np.float64]) -> Coverage:
    """Shares as a record; 0 where nothing was answered."""
    one, two, three = np.nan_to_num(shares).tolist()
    return Coverage(one, two, three)
