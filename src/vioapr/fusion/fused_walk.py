"""What a method made of one walk, and the CSV file that holds it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.paths import AnyPath
from vioapr.files.tables import Rows, read_headed_csv
from vioapr.files.text import read_text, write_text
from vioapr.fusion.types import Labelled, LocalizationState, Status
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory

POSE_COLUMNS = ("timestamp_s", "status", "x", "y", "z", "qx", "qy", "qz", "qw")
SIGMA_COLUMNS = ("sigma_position_m", "sigma_orientation_deg")
STATE_COLUMNS = ("localization_state", "confidence")


@dataclass(frozen=True, eq=False)
class FusedWalk:
    """A method's estimates over one walk, n frames.

    Attributes:
        timestamp_s: Shape (n,), seconds.
        world_from_cam: Poses, shape (n,); NaN where unlocalized.
        status: Shape (n,), integers of `Status`.
        sigma_position_m: Shape (n,), per axis, or None where the method has none.
        sigma_orientation_deg: Shape (n,), or None.
        world_from_vio: Where the tracking world lies in the map, as known when each frame
            arrived, in any view; shape (n,), NaN while unknown. None where that is not known, as
            after smoothing or of a file.
        localization_state: Shape (n,), integers of `LocalizationState`, or None where the
            method has none.
        confidence: Shape (n,), probability that the pose is the right one, or None.
        sigma_position_axes_m: Along each axis of the world, shape (n, 3), or None.
        sigma_orientation_axes_deg: About each axis of the world, shape (n, 3), or None.
    """

    timestamp_s: NDArray[np.float64]
    world_from_cam: Rigid3
    status: NDArray[np.integer]
    sigma_position_m: NDArray[np.float64] | None = None
    sigma_orientation_deg: NDArray[np.float64] | None = None
    world_from_vio: Rigid3 | None = None
    localization_state: NDArray[np.integer] | None = None
    confidence: NDArray[np.float64] | None = None
    sigma_position_axes_m: NDArray[np.float64] | None = None
    sigma_orientation_axes_deg: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.timestamp_s)

    @property
    def is_localized(self) -> NDArray[np.bool_]:
        """Shape (n,), the frames that have a pose."""
        return self.status != Status.UNLOCALIZED

    def to_trajectory(self) -> Trajectory:
        """The localized frames, of which there must be at least one."""
        rows = self.is_localized
        poses = self.world_from_cam.at(rows)
        return Trajectory(self.timestamp_s[rows], poses.translation_m, poses.quat_xyzw)


def write_fused_csv(path: AnyPath, fused: FusedWalk, *, overwrite: bool = True) -> None:
    """Write a row a frame, with all digits; reading it gives the same numbers.

    The columns are `POSE_COLUMNS`, followed by `SIGMA_COLUMNS` and `STATE_COLUMNS` where the
    method has them. Status and state are labels; unlocalized frames have nan.

    Raises:
        AlreadyExistsError: The file exists, without `overwrite`.
        UnwritableError: The file cannot be written.
    """
    path = Path(path)
    header, columns = POSE_COLUMNS, [*fused.world_from_cam]
    if fused.sigma_position_m is not None and fused.sigma_orientation_deg is not None:
        header += SIGMA_COLUMNS
        columns += [fused.sigma_position_m[:, None], fused.sigma_orientation_deg[:, None]]
    ends = [""] * len(fused)
    if fused.localization_state is not None and fused.confidence is not None:
        header += STATE_COLUMNS
        pairs = zip(fused.localization_state.tolist(), fused.confidence.tolist(), strict=True)
        ends = [f",{LocalizationState(state).label},{sure!r}" for state, sure in pairs]
    lines = [",".join(header)]
    times, statuses = fused.timestamp_s.tolist(), fused.status.tolist()
    numbers = np.concatenate(columns, axis=1).tolist()
    for time_s, status, row, end in zip(times, statuses, numbers, ends, strict=True):
        lines.append(",".join([repr(time_s), Status(status).label, *map(repr, row)]) + end)
    write_text(path, "\n".join(lines) + "\n", overwrite=overwrite)


def read_fused_csv(path: AnyPath) -> FusedWalk:
    """Read what `write_fused_csv` has written.

    Raises:
        FileMissingError: There is no such file.
        UnreadableError: The file cannot be read.
        FormatError: A column is missing, a field is not a number, or a status is unknown.
    """
    path = Path(path)
    there = set(read_text(path).partition("\n")[0].split(","))
    has_sigmas, has_states = (set(more) <= there for more in (SIGMA_COLUMNS, STATE_COLUMNS))
    columns = POSE_COLUMNS + has_sigmas * SIGMA_COLUMNS + has_states * STATE_COLUMNS
    rows = read_headed_csv(path, columns)
    status_column, state_column = 1, len(columns) - 2
    labels = (status_column, state_column) if has_states else (status_column,)
    numbers = rows.numbers([k for k in range(len(columns)) if k not in labels])
    timestamp_s, position_m, quat_xyzw, sigmas, confidence = np.split(
        numbers, [1, 4, 8, 8 + 2 * has_sigmas], axis=1
    )
    return FusedWalk(
        timestamp_s[:, 0],
        Rigid3(position_m, quat_xyzw),
        _read_labels(path, rows, status_column, Status),
        *(sigmas.T if has_sigmas else (None, None)),
        localization_state=(
            _read_labels(path, rows, state_column, LocalizationState) if has_states else None
        ),
        confidence=confidence[:, 0] if has_states else None,
    )


def _read_labels(path: Path, rows: Rows, column: int, kind: type[Labelled]) -> NDArray[np.integer]:
    numbers = {member.label: int(member) for member in kind}
    for label, line in zip(rows.column(column), rows.lines, strict=True):
        if label not in numbers:
            raise FormatError(path, f"expected one of {', '.join(numbers)}, got {label!r}", line)
    return np.array([numbers[label] for label in rows.column(column)])
