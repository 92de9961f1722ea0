"""Which of two tracks is a regressor's and which a tracker's, and whether they are one."""

from __future__ import annotations

import numpy as np

from vioapr.formats.common_motion import CommonFrames
from vioapr.formats.readings import up_of
from vioapr.trajectory import Trajectory

_SAME_SHARE, _SAME_M = 0.95, 1e-6
_CLEARLY_NOISIER, _NOISIER_WITH_A_CLUE, _LEAST_JITTER_M = 3.0, 1.4, 0.01
_CLEAR_UP = 0.9
_LEAST_JITTER_SHARE = 1e-3
_ORIGIN_M = 1e-3


def are_same(common: CommonFrames) -> bool:
    """Whether two tracks hold the same poses, as of one file given twice."""
    left, right = common.left, common.right
    gap_m = np.abs(left.position_m - right.position_m).max(axis=1)
    cosine = np.abs((left.quat_xyzw * right.quat_xyzw).sum(axis=1))
    is_same = (gap_m <= _SAME_M) & (cosine >= 1 - _SAME_M)
    moves = bool(np.ptp(left.position_m, axis=0).max() > 0)
    return moves and float(is_same.mean()) >= _SAME_SHARE


def are_swapped(common: CommonFrames) -> bool:
    """Whether the left track is a tracker's and the right one a regressor's.

    A regressor's positions jump about from frame to frame, a tracker's do not. Where the left
    world begins at its first pose, or is y up beside one that is z up, less of it tells.
    """
    right_m = jitter_m(common.right)
    # Beside how far each goes: units may differ.
    left_share, right_share = (
        jitter_m(track) / max(spread_m(track), 1e-12) for track in (common.left, common.right)
    )
    if right_m < _LEAST_JITTER_M or right_share < _LEAST_JITTER_SHARE:
        return False
    left_up, right_up = (_up_axis(track) for track in (common.left, common.right))
    left_begins, right_begins = (_begins_at_origin(t) for t in (common.left, common.right))
    has_clue = (left_up == 1 and right_up == 2) or (left_begins and not right_begins)
    return right_share > left_share * (_NOISIER_WITH_A_CLUE if has_clue else _CLEARLY_NOISIER)


def jitter_m(track: Trajectory) -> float:
    """How far positions lie from the middle of their neighbours: the median, twice over."""
    positions = track.position_m
    if len(positions) < 3:
        return 0.0
    second = positions[:-2] - 2 * positions[1:-1] + positions[2:]
    return float(np.median(np.linalg.norm(second, axis=1)))


def spread_m(track: Trajectory) -> float:
    """How far the positions lie from their middle: the median distance."""
    return float(
        np.median(np.linalg.norm(track.position_m - np.median(track.position_m, axis=0), axis=1))
    )


def _begins_at_origin(track: Trajectory) -> bool:
    return float(np.linalg.norm(track.position_m[0])) < _ORIGIN_M


def _up_axis(track: Trajectory) -> int | None:
    """0 to 2 for x to z, where the camera's up-vector stays near it."""
    up, _, _ = up_of(track.quat_xyzw)
    axis = int(np.argmax(up))
    return axis if up[axis] > _CLEAR_UP else None
