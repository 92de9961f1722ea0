"""Tracks that stand still while another one of the walk moves, or that have hardly any poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError
from vioapr.formats.pair_checks import Track
from vioapr.formats.track_roles import jitter_m
from vioapr.formats.track_warnings import TrackWarning
from vioapr.geometry.vectors import step_lengths_m
from vioapr.plurals import count_of
from vioapr.trajectory import Trajectory, associate

LEAST_POSES = 5
"""Fewer are no walk, but a file that was cut off, or another one than was meant."""

_STILL_M, _STILL_SHARE = 1e-6, 5e-4
_LEAST_STILL, _LEAST_SEEN = 5, 8
_PARTS = 4
_LEAST_MOTION_M, _NOISE = 1.0, 3.0


def check_count(track: Track) -> TrackWarning | None:
    """Find out whether a track has hardly any poses."""
    count = len(track.poses)
    if count >= LEAST_POSES:
        return None
    return TrackWarning(
        "few",
        f"{track.name} has {count_of(count, 'pose')} only",
        f"is it the right file, and whole? A walk has at least {LEAST_POSES}",
    )


def check_frozen(track: Track, other: Track) -> TrackWarning | None:
    """Find out whether a track stays at one position while another track moves on.

    A tracker that is lost does so, and an app that writes the last pose it had; a regressor that
    always answers the same, too.

    Args:
        track: That may be frozen.
        other: Of the same walk.
    """
    positions = track.poses.position_m
    is_all = _motion_m(positions) < _STILL_SHARE * _motion_m(other.poses.position_m)
    first, last = (0, len(positions) - 1) if is_all else _longest_rest(positions)
    if last - first + 1 < _LEAST_STILL:
        return None
    seen = other.poses.position_m[_rows_within(track.poses, first, last, other.poses)]
    moved_m = _motion_m(seen)
    noise_m = jitter_m(other.poses) / np.sqrt(max(len(seen), 1) / _PARTS)
    if not moved_m > max(_LEAST_MOTION_M, _NOISE * noise_m):
        return None
    since = f" from {track.poses.timestamp_s[first]:.3f} s on" if track.poses.is_timed else ""
    return TrackWarning(
        "frozen",
        f"{track.name} stays at one position in {last - first + 1} of {len(track.poses)} poses"
        f"{since}, while {other.name} moves by {moved_m:.1f} m",
        "was tracking lost? Leave these rows out"
        if track.role == "vio"
        else "give poses that follow the camera",
    )


def _longest_rest(position_m: NDArray[np.float64]) -> tuple[int, int]:
    """The first and the last row of the longest run without a step."""
    moves = np.flatnonzero(step_lengths_m(position_m) > _STILL_M)
    starts = np.concatenate([[0], moves + 1])
    ends = np.concatenate([moves, [len(position_m) - 1]])
    longest = int(np.argmax(ends - starts))
    return int(starts[longest]), int(ends[longest])


def _rows_within(track: Trajectory, first: int, last: int, other: Trajectory) -> NDArray[np.intp]:
    """The rows of another track that are of the same time, or of the same images."""
    if track.is_timed and other.is_timed:
        start_s, end_s = track.timestamp_s[first], track.timestamp_s[last]
        return np.flatnonzero((other.timestamp_s >= start_s) & (other.timestamp_s <= end_s))
    try:
        pairs = associate(track, other)
    except AssociationError:
        return np.zeros(0, dtype=np.intp)
    return pairs.right_rows[(pairs.left_rows >= first) & (pairs.left_rows <= last)]


def _motion_m(position_m: NDArray[np.float64]) -> float:
    """How far the middles of the parts of a track are apart, which noise moves little."""
    if len(position_m) < _LEAST_SEEN:
        return 0.0
    middles = np.array([np.median(part, axis=0) for part in np.array_split(position_m, _PARTS)])
    return float(np.linalg.norm(middles[:, None] - middles[None], axis=-1).max())
