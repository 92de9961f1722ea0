"""What a method made of one walk, and the CSV file that holds it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.paths import AnyPath
from vioapr.files.tables import read_headed_csv
from vioapr.files.text import read_text, write_text
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory

POSE_COLUMNS = ("timestamp_s", "status", "x", "y", "z", "qx", "qy", "qz", "qw")
SIGMA_COLUMNS = ("sigma_position_m", "sigma_orientation_deg")


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
    """

    timestamp_s: NDArray[np.float64]
    world_from_cam: Rigid3
    status: NDArray[np.integer]
    sigma_position_m: NDArray[np.float64] | None = None
    sigma_orientation_deg: NDArray[np.float64] | None = None
    world_from_vio: Rigid3 | None = None

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

    The columns are `POSE_COLUMNS`, followed by `SIGMA_COLUMNS` where the method has them. The
    status is a label; unlocalized frames have nan.

    Raises:
        AlreadyExistsError: The file exists, without `overwrite`.
        UnwritableError: The file cannot be written.
    """
    path = Path(path)
    header, columns = POSE_COLUMNS, [*fused.world_from_cam]
    if fused.sigma_position_m is not None and fused.sigma_orientation_deg is not None:
        header += SIGMA_COLUMNS
        columns += [fused.sigma_position_m[:, None], fused.sigma_orientation_deg[:, None]]
    lines = [",".join(header)]
    times, statuses = fused.timestamp_s.tolist(), fused.status.tolist()
    numbers = np.concatenate(columns, axis=1).tolist()
    for time_s, status, row in zip(times, statuses, numbers, strict=True):
        lines.append(",".join([repr(time_s), Status(status).label, *map(repr, row)]))
    write_text(path, "\n".join(lines) + "\n", overwrite=overwrite)


def read_fused_csv(path: AnyPath) -> FusedWalk:
    """Read what `write_fused_csv` has written.

    Raises:
        FileMissingError: There is no such file.
        UnreadableError: The file cannot be read.
        FormatError: A column is missing, a field is not a number, or a status is unknown.
    """
    path = Path(path)
    has_sigmas = set(SIGMA_COLUMNS) <= set(read_text(path).partition("\n")[0].split(","))
    columns = POSE_COLUMNS + (SIGMA_COLUMNS if has_sigmas else ())
    rows = read_headed_csv(path, columns)
    statuses = {status.label: status for status in Status}
    for label, line in zip(rows.column(1), rows.lines, strict=True):
        if label not in statuses:
            raise FormatError(path, f"expected one of {', '.join(statuses)}, got {label!r}", line)
    numbers = rows.numbers([0, *range(2, len(columns))])
    timestamp_s, position_m, quat_xyzw, sigmas = np.split(numbers, [1, 4, 8], axis=1)
    return FusedWalk(
        timestamp_s[:, 0],
        Rigid3(position_m, quat_xyzw),
        np.array([int(statuses[label]) for label in rows.column(1)]),
        *(sigmas.T if has_sigmas else (None, None)),
    )
