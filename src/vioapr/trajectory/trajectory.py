"""Trajectories: timed poses of one device, their association and their interpolation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.errors import AssociationError, ParameterError
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3

UNIT_TOLERANCE = 0.01
"""How far from 1 a quaternion's norm may be: text files round to 3 digits and more."""

DEFAULT_TOLERANCE_S = 0.01
"""Frames of two trajectories whose timestamps differ by more are different frames."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses target_from_source over time; by default world_from_cam, cam in OpenCV axes.

    Attributes:
        timestamp_s: Shape (n,), strictly increasing, seconds. Where the source has no clock
            (`is_timed` false), the row's index.
        position_m: Origin of the source frame in the target frame, shape (n, 3), metres.
        quat_xyzw: Rotation target_from_source, shape (n, 4), Hamilton, unit.
        names: Image names, one a pose, or None.
        is_timed: Whether the timestamps are seconds of a clock.
        target: Name of the target frame, e.g. "world" or "vio".
        source: Name of the source frame, e.g. "cam".
    """

    timestamp_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    names: tuple[str, ...] | None = None
    is_timed: bool = True
    target: str = "world"
    source: str = "cam"

    def __post_init__(self) -> None:
        problem = find_problem(self.timestamp_s, self.position_m, self.quat_xyzw, names=self.names)
        if problem is not None:
            row, what = problem
            place = "" if row is None else f"pose {row + 1}: "
            raise ParameterError(f"not a trajectory: {place}{what}")
        norms = np.linalg.norm(self.quat_xyzw, axis=1, keepdims=True)
        object.__setattr__(self, "quat_xyzw", self.quat_xyzw / norms)

    @staticmethod
    def from_arrays(
        timestamp_s: ArrayLike,
        position_m: ArrayLike,
        quat_xyzw: ArrayLike,
        names: Sequence[str] | None = None,
        *,
        is_timed: bool = True,
        target: str = "world",
        source: str = "cam",
    ) -> Trajectory:
        """From anything that NumPy can read as arrays; see the attributes."""
        return Trajectory(
            np.asarray(timestamp_s, dtype=np.float64),
            np.asarray(position_m, dtype=np.float64),
            np.asarray(quat_xyzw, dtype=np.float64),
            None if names is None else tuple(names),
            is_timed,
            target,
            source,
        )

    def __len__(self) -> int:
        return len(self.timestamp_s)

    @property
    def target_from_source(self) -> Rigid3:
        """The poses as one batch of transforms, shape (n,)."""
        return Rigid3(self.position_m, self.quat_xyzw)

    def with_transforms(self, target_from_source: Rigid3) -> Trajectory:
        """The same times and names with other poses."""
        return replace(
            self,
            position_m=target_from_source.translation_m,
            quat_xyzw=target_from_source.quat_xyzw,
        )

    def at_rows(self, rows: NDArray[np.integer] | slice) -> Trajectory:
        """The poses of the given rows, which must be in increasing order."""
        names = self.names
        if names is not None:
            names = tuple(names[rows]) if isinstance(rows, slice) else tuple(names[i] for i in rows)
        return replace(
            self,
            timestamp_s=self.timestamp_s[rows],
            position_m=self.position_m[rows],
            quat_xyzw=self.quat_xyzw[rows],
            names=names,
        )

    def interpolate(self, timestamp_s: ArrayLike) -> Trajectory:
        """Poses at other times: positions linearly, rotations along the shorter arc.

        Args:
            timestamp_s: Strictly increasing, within the first and last timestamp.

        Raises:
            ParameterError: A time outside; nothing is extrapolated.
        """
        times = np.asarray(timestamp_s, dtype=np.float64)
        first, last = self.timestamp_s[0], self.timestamp_s[-1]
        outside = (times < first) | (times > last)
        if outside.any():
            raise ParameterError(
                f"cannot interpolate at {times[outside][0]:.6f} s: the trajectory covers "
                f"{first:.6f} s to {last:.6f} s"
            )
        before, after = _bracket(times, self.timestamp_s)
        duration = self.timestamp_s[after] - self.timestamp_s[before]
        fraction = (times - self.timestamp_s[before]) / np.where(duration > 0, duration, 1.0)
        poses = self.target_from_source
        between = rigid.interpolate(poses.at(before), poses.at(after), fraction)
        return replace(
            self,
            timestamp_s=times,
            position_m=between.translation_m,
            quat_xyzw=between.quat_xyzw,
            names=None,
        )


def find_problem(
    timestamp_s: NDArray[np.float64],
    position_m: NDArray[np.float64],
    quat_xyzw: NDArray[np.float64],
    *,
    names: Sequence[str] | None = None,
) -> tuple[int | None, str] | None:
    """What keeps rows from being a trajectory: (0-based row or None, problem), or None.

    Readers use it to name the line of a file; see the attributes of `Trajectory`.
    """
    count = len(timestamp_s)
    shapes = (timestamp_s.shape, position_m.shape, quat_xyzw.shape)
    if shapes != ((count,), (count, 3), (count, 4)):
        return None, f"expected shapes (n,), (n, 3), (n, 4), got {shapes}"
    if count == 0:
        return None, "expected at least one pose, got none"
    if names is not None and len(names) != count:
        return None, f"expected {count} names, one a pose, got {len(names)}"
    return _find_bad_row(timestamp_s, np.column_stack([position_m, quat_xyzw]))


def _find_bad_row(
    timestamp_s: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[int, str] | None:
    """The first row with a value that is not finite, not unit, or not later than the last."""
    finite = np.isfinite(values).all(axis=1) & np.isfinite(timestamp_s)
    with np.errstate(invalid="ignore", over="ignore"):
        norms = np.sqrt((values[:, 3:] ** 2).sum(axis=1))
        is_unit = np.abs(norms - 1) <= UNIT_TOLERANCE
        is_later = np.concatenate([[True], np.diff(timestamp_s) > 0])
    bad = ~(finite & is_unit & is_later)
    if not bad.any():
        return None
    row = int(np.argmax(bad))
    if not finite[row]:
        return row, "expected finite numbers, got NaN or inf"
    if not is_unit[row]:
        return row, f"expected a unit quaternion, got one of norm {norms[row]:.6g}"
    now, before = timestamp_s[row], timestamp_s[row - 1]
    relation = "a duplicate of" if now == before else "earlier than"
    return row, (
        f"expected increasing timestamps, got {now:.6f} s, {relation} the one before "
        f"({before:.6f} s)"
    )


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
    """Pair the frames of two trajectories one to one.

    By image name where one of them has no clock, otherwise by timestamp: two frames are a
    pair if each is the other's nearest in time and they are within the tolerance.

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
    return _associate(timestamp_s, left.names, right, tolerance_s)


def poses_of_frames(
    known: Trajectory,
    timestamp_s: NDArray[np.float64] | None,
    names: Sequence[str] | None = None,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> Rigid3:
    """The poses of frames, e.g. their ground truth, found as by `associate`.

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
    pairs = _associate(timestamp_s, names, known, tolerance_s)
    count = len(names or ()) if timestamp_s is None else len(timestamp_s)
    poses = Rigid3(np.full((count, 3), np.nan), np.full((count, 4), np.nan))
    for all_, found in zip(poses, known.target_from_source, strict=True):
        all_[pairs.left_rows] = found[pairs.right_rows]
    return poses


def _associate(
    timestamp_s: NDArray[np.float64] | None,
    names: Sequence[str] | None,
    right: Trajectory,
    tolerance_s: float,
) -> Association:
    if not tolerance_s >= 0:
        raise ParameterError(f"expected a time tolerance of at least 0 s, got {tolerance_s}")
    if timestamp_s is not None and right.is_timed:
        return _associate_by_time(timestamp_s, right.timestamp_s, tolerance_s)
    if names is None or right.names is None:
        raise AssociationError(
            "cannot pair the trajectories: "
            "one has no timestamps and not both have image names to go by"
        )
    return _associate_by_name(names, right.names)


def _associate_by_name(left: Sequence[str], right: Sequence[str]) -> Association:
    row_of = {name: row for row, name in enumerate(right)}
    pairs = [(row, row_of[name]) for row, name in enumerate(left) if name in row_of]
    array = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return Association(array[:, 0], array[:, 1])


def _associate_by_time(
    left_s: NDArray[np.float64], right_s: NDArray[np.float64], tolerance_s: float
) -> Association:
    if not len(left_s):
        return Association(np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp))
    nearest_right = nearest_rows(left_s, right_s)
    nearest_left = nearest_rows(right_s, left_s)
    left_rows = np.arange(len(left_s))
    is_mutual = nearest_left[nearest_right] == left_rows
    # A nanosecond of slack: a difference of exactly the tolerance must not hang on rounding.
    is_close = np.abs(left_s - right_s[nearest_right]) <= tolerance_s + 1e-9
    chosen = is_mutual & is_close
    return Association(left_rows[chosen], nearest_right[chosen])


def nearest_rows(
    timestamp_s: NDArray[np.float64], among_s: NDArray[np.float64]
) -> NDArray[np.intp]:
    """For every time, the row of the nearest of some increasing times."""
    before, after = _bracket(timestamp_s, among_s)
    before_is_nearer = timestamp_s - among_s[before] <= among_s[after] - timestamp_s
    return np.where(before_is_nearer, before, after)


def _bracket(
    timestamp_s: NDArray[np.float64], among_s: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For every time, the two neighbouring rows that it lies between, or is nearest to."""
    last = len(among_s) - 1
    after = np.minimum(np.maximum(np.searchsorted(among_s, timestamp_s), 1), last)
    return np.maximum(after - 1, 0), after
