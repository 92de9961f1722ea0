"""Trackers that ran away: their poses are of no use, and must not be used in silence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.formats.anomalies import MAX_SPEED_M_S

WINDOW_S = 5.0
"""A tracker that is too fast for half of so long is diverging."""


def find_divergence(
    timestamp_s: NDArray[np.float64], position_m: NDArray[np.float64]
) -> float | None:
    """When a tracker ran away: faster than any person for most of some seconds.

    A jump, as of a relocalization, is over in one step and does not count.

    Args:
        timestamp_s: Shape (n,), increasing, s.
        position_m: In the tracker's world, shape (n, 3), m.

    Returns:
        The time at which it begins, or None.
    """
    if len(timestamp_s) < 2:
        return None
    steps_s = np.diff(timestamp_s)
    is_fast = np.linalg.norm(np.diff(position_m, axis=0), axis=1) > MAX_SPEED_M_S * steps_s
    # Time spent too fast in the window that begins at each frame.
    fast_s = np.concatenate([[0.0], np.cumsum(np.where(is_fast, steps_s, 0.0))])
    ends = np.searchsorted(timestamp_s, timestamp_s + WINDOW_S, side="right") - 1
    is_whole = timestamp_s + WINDOW_S <= timestamp_s[-1]
    is_diverging = is_whole & (fast_s[ends] - fast_s > WINDOW_S / 2)
    return float(timestamp_s[np.argmax(is_diverging)]) if is_diverging.any() else None
