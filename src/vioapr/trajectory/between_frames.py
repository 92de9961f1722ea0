"""A tracker's poses between two of its frames, where nothing speaks against interpolating."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import rigid
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3, choose
from vioapr.trajectory.trajectory import Trajectory, bracket

_SHORT_GAP_S, _LONGEST_GAP_S, _GAP_STEPS = 0.1, 0.6, 1.5
"""Frames that are further apart than the track's usual step have others missing between them."""

_MOST_SPEED_M_S, _MOST_TIMES_USUAL_SPEED = 10.0, 10.0
_MOST_TURN_DEG, _MOST_TURN_RATE_DEG_S, _LEAST_TURN_DEG = 90.0, 720.0, 10.0
"""A tracker that moves or turns faster has begun another world."""


def interpolate_between_frames(
    track: Trajectory, timestamp_s: NDArray[np.float64]
) -> tuple[Rigid3[FloatArray], NDArray[np.bool_]]:
    """Interpolate a track at some times, where its neighbouring frames belong together.

    They do if they follow each other as frames of this track usually do, or within 0.1 s; if no
    more than 0.6 s pass, in which a person's motion is not known to be even; and if the track does
    not jump from one to the other, as where the tracker was reset.

    Args:
        track: With a clock.
        timestamp_s: On the same clock, shape (n,), in any order.

    Returns:
        The poses, the identity where there is none, and whether there is one, shapes (n,).
        Nothing is extrapolated.
    """
    before, after = bracket(timestamp_s, track.timestamp_s)
    gap_s = track.timestamp_s[after] - track.timestamp_s[before]
    is_inside = (timestamp_s >= track.timestamp_s[before]) & (
        timestamp_s <= track.timestamp_s[after]
    )
    is_known = is_inside & _belong_together(track, before, after)
    fraction = (timestamp_s - track.timestamp_s[before]) / np.where(gap_s > 0, gap_s, 1.0)
    poses = track.target_from_source
    between = rigid.interpolate(poses.at(before), poses.at(after), np.where(is_known, fraction, 0))
    return choose(is_known, between, Rigid3.identity(is_known.shape)), is_known


def _belong_together(
    track: Trajectory, before: NDArray[np.intp], after: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Whether the tracker went from one frame to the next without losing itself, shape (n,)."""
    if len(track) < 2:
        return np.zeros(len(before), dtype=bool)
    steps_s = np.diff(track.timestamp_s)
    moves_m = np.linalg.norm(np.diff(track.position_m, axis=0), axis=1)
    with np.errstate(over="ignore"):  # times may differ by less than any clock can tell
        usual_m_s = float(np.median(moves_m / steps_s))
    gap_s = track.timestamp_s[after] - track.timestamp_s[before]
    longest_s = min(max(_SHORT_GAP_S, _GAP_STEPS * float(np.median(steps_s))), _LONGEST_GAP_S)
    poses = track.target_from_source
    most_m = max(_MOST_SPEED_M_S, _MOST_TIMES_USUAL_SPEED * usual_m_s) * gap_s
    most_deg = np.clip(_MOST_TURN_RATE_DEG_S * gap_s, _LEAST_TURN_DEG, _MOST_TURN_DEG)
    # A nanosecond of slack: a gap of exactly the longest must not hang on rounding.
    return (
        (gap_s <= longest_s + 1e-9)
        & (rigid.distance_m(poses.at(before), poses.at(after)) <= most_m)
        & (rigid.angle_deg(poses.at(before), poses.at(after)) <= most_deg)
    )
