"""Which frames of two trajectories are the same: by time, or by the names of their images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, ParameterError
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory.trajectory import Trajectory, bracket

DEFAULT_TOLERANCE_S = 0.01
"""Frames of two trajectories whose timestamps differ by more are different frames."""


@dataclass(frozen=True)
class Association:
    """Pairs of rows of two trajectories: left_rows[k] belongs to right_rows[k]."""

    left_rows: NDArray[np.intp]
    right_rows: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.left_rows)


def associate(
    left: Trajectory, right: Trajectory, tolerance_s: float = DEFAULT_TOLERANCE_S
) -> Association:
    """Pair the frames of two trajectories one to one; see `associate_frames`.

    Args:
        left: A trajectory.
        right: Another, of the same walk and on the same clock.
        tolerance_s: Largest difference of timestamps within a pair, s.

    Returns:
        The pairs, in order of time; possibly none.

    Raises:
        AssociationError: One has no clock, and not both have names.
        ParameterError: The tolerance is negative or not a number.
    """
    timestamp_s = left.timestamp_s if left.is_timed else None
    return associate_frames(timestamp_s, left.names, right, tolerance_s)


def associate_frames(
    timestamp_s: NDArray[np.float64] | None,
    names: Sequence[str] | None,
    right: Trajectory,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> Association:
    """Pair frames, of which the poses need not be known, with those of a trajectory.

    By image name where one of them has no clock, otherwise by timestamp: two frames are a
    pair if each is the other's nearest in time and they are within the tolerance.

    Args:
        timestamp_s: Of n frames, increasing, on the same clock; None where they have no clock.
        names: Of the frames' images, needed where one has no clock.
        right: The trajectory.
        tolerance_s: Largest difference of timestamps within a pair, s.

    Returns:
        The pairs, in order of time; possibly none.

    Raises:
        AssociationError: One has no clock, and not both have names.
        ParameterError: The tolerance is negative or not a number.
    """
    if not tolerance_s >= 0:
        raise ParameterError(
            f"`tolerance_s`: expected a time tolerance of at least 0 s, got {tolerance_s}"
        )
    if timestamp_s is None or not right.is_timed:
        if names is None or right.names is None:
            raise AssociationError(
                "cannot pair the trajectories: "
                "one has no timestamps and not both have image names to go by"
            )
        row_of = {name: row for row, name in enumerate(right.names)}
        pairs = [(row, row_of[name]) for row, name in enumerate(names) if name in row_of]
        rows = np.array(pairs, dtype=np.intp).reshape(-1, 2)
        return Association(rows[:, 0], rows[:, 1])
    left_rows = np.arange(len(timestamp_s))
    if not len(left_rows):
        return Association(left_rows, left_rows)
    nearest_right = nearest_rows(timestamp_s, right.timestamp_s)
    nearest_left = nearest_rows(right.timestamp_s, timestamp_s)
    is_mutual = nearest_left[nearest_right] == left_rows
    # A nanosecond of slack: a difference of exactly the tolerance must not hang on rounding.
    gap_s = np.abs(timestamp_s - right.timestamp_s[nearest_right])
    chosen = is_mutual & (gap_s <= tolerance_s + 1e-9)
    return Association(left_rows[chosen], nearest_right[chosen])


def poses_of_frames(
    known: Trajectory,
    timestamp_s: NDArray[np.float64] | None,
    names: Sequence[str] | None = None,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> Rigid3[FloatArray]:
    """Look up the poses of frames, e.g. their ground truth, paired by `associate_frames`.

    Args:
        known: The poses, target_from_source.
        timestamp_s: Of n frames, increasing, on the same clock; None where they have no clock.
        names: Of the frames' images, needed where one has no clock.
        tolerance_s: Largest difference of timestamps, s.

    Returns:
        Shape (n,), NaN for frames without.

    Raises:
        AssociationError: There is no clock, and not both have names.
        ParameterError: The tolerance is negative or not a number.
    """
    pairs = associate_frames(timestamp_s, names, known, tolerance_s)
    count = len(names or ()) if timestamp_s is None else len(timestamp_s)
    position_m, quat_xyzw = np.full((count, 3), np.nan), np.full((count, 4), np.nan)
    position_m[pairs.left_rows] = known.position_m[pairs.right_rows]
    quat_xyzw[pairs.left_rows] = known.quat_xyzw[pairs.right_rows]
    return Rigid3(position_m, quat_xyzw)


def nearest_rows(
    timestamp_s: NDArray[np.float64], among_s: NDArray[np.float64]
) -> NDArray[np.intp]:
    """Find, for every time of shape (n,), the row of the nearest of some increasing times."""
    before, after = bracket(timestamp_s, among_s)
    before_is_nearer = timestamp_s - among_s[before] <= among_s[after] - timestamp_s
    return np.where(before_is_nearer, before, after)
