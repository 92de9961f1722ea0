"""Timed poses of one device, and their interpolation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.errors import ParameterError
from vioapr.geometry import rigid
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3

UNIT_TOLERANCE = 0.01
"""How far from 1 a quaternion's norm may be: text files round to 3 digits and more."""


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
        """Make a trajectory of anything that NumPy can read as arrays; see the attributes."""
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
    def target_from_source(self) -> Rigid3[FloatArray]:
        """The poses as one batch of transforms, shape (n,)."""
        return Rigid3(self.position_m, self.quat_xyzw)

    def with_transforms(self, target_from_source: Rigid3[FloatArray]) -> Trajectory:
        """Keep times and names, and replace the poses."""
        return replace(
            self,
            position_m=target_from_source.translation_m,
            quat_xyzw=target_from_source.quat_xyzw,
        )

    def at_rows(self, rows: NDArray[np.integer[Any]] | slice) -> Trajectory:
        """Pick the poses of the given rows, which must be in increasing order."""
        names = self.names
        if names is not None:
            kept: list[int] = np.arange(len(self))[rows].tolist()  # pyright: ignore[reportUnknownMemberType]
            names = tuple(names[row] for row in kept)
        return replace(
            self,
            timestamp_s=self.timestamp_s[rows],
            position_m=self.position_m[rows],
            quat_xyzw=self.quat_xyzw[rows],
            names=names,
        )

    def interpolate(self, timestamp_s: ArrayLike) -> Trajectory:
        """Interpolate poses at other times: positions linearly, rotations along the shorter arc.

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
        before, after = bracket(times, self.timestamp_s)
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
    """Find what keeps rows from being a trajectory; see the attributes of `Trajectory`.

    Returns:
        The first 0-based row that is wrong (None if the whole is) and the problem, so that
        readers can name the line of a file; or None.
    """
    count = len(timestamp_s)
    shapes = (timestamp_s.shape, position_m.shape, quat_xyzw.shape)
    if shapes != ((count,), (count, 3), (count, 4)):
        return None, f"expected shapes (n,), (n, 3), (n, 4), got {shapes}"
    if count == 0:
        return None, "expected at least one pose, got none"
    if names is not None and len(names) != count:
        return None, f"expected {count} names, one a pose, got {len(names)}"
    values = np.column_stack([position_m, quat_xyzw])
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


def bracket(
    timestamp_s: NDArray[np.float64], among_s: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find, for every time, the two neighbouring rows that it lies between, or is nearest to.

    Args:
        timestamp_s: Any times, shape (n,).
        among_s: Increasing times, shape (m,), at least one.

    Returns:
        The earlier and the later row, shapes (n,); the same one where there is just one.
    """
    last = len(among_s) - 1
    after = np.minimum(np.maximum(np.searchsorted(among_s, timestamp_s), 1), last)
    return np.maximum(after - 1, 0), after
