"""Trajectories of a source, and what becomes of rows that give no pose: their frames stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.files.text import natural_key
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import LeftOutRow, ReadingNote, ReadingNotes
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import ImportOptions, Walk
from vioapr.trajectory import Trajectory


class Reading(NamedTuple):
    """A trajectory as it was read.

    Attributes:
        trajectory: The poses of sound rows.
        left_out: The other rows.
        notes: What its reader says of the file.
    """

    trajectory: Trajectory
    left_out: tuple[LeftOutRow, ...]
    notes: tuple[ReadingNote, ...]

    def say(self, walk: Walk) -> None:
        """Add what the reader says to a walk's findings."""
        for note in self.notes:
            (walk.warn if note.is_warning else walk.note)(note.text)

    @property
    def names(self) -> list[str]:
        """The image names of all rows, sound or not, in natural order."""
        names = [*(self.trajectory.names or ())]
        known = set(names)
        names += [row.name for row in self.left_out if row.name and row.name not in known]
        return sorted(names, key=natural_key)


def read_noted(
    read: Callable[[Path, ReadOptions], Trajectory],
    path: Path,
    options: ImportOptions,
    *,
    rate_hz: float | None = None,
) -> Reading:
    """Read a trajectory with a format's reader, and keep what it says.

    Args:
        read: Of the format.
        path: The file.
        options: Whether to be strict.
        rate_hz: Of frames without timestamps.

    Raises:
        FileError: It cannot be read, is malformed, or, under `strict`, a row gives no pose.
    """
    notes = ReadingNotes()
    trajectory = read(path, ReadOptions(rate_hz=rate_hz, strict=options.strict, notes=notes))
    return Reading(trajectory, tuple(notes.left_out), tuple(notes.notes))


class FramesOfRows(NamedTuple):
    """The frames of a file's rows, of which some give no pose.

    Attributes:
        rows: Which of the file's rows each frame is of, shape (n,).
        timestamp_s: Shape (n,), increasing, s.
        vio_from_cam: Shape (n,), NaN where the row gives no pose.
    """

    rows: NDArray[np.intp]
    timestamp_s: NDArray[np.float64]
    vio_from_cam: Rigid3


def frames_of_rows(reading: Reading, lines: Sequence[int]) -> FramesOfRows:
    """Put the rows without a pose back among the others, as frames whose tracking was lost.

    Rows whose time is missing, or does not lie between those of their neighbours, stay out.

    Args:
        reading: A timed trajectory in the order of the file.
        lines: The line, or entry, of each row of the file.
    """
    left_out = {row.line: row for row in reading.left_out}
    is_sound = np.array([line not in left_out for line in lines], dtype=bool)
    times = np.full(len(lines), np.nan)
    times[is_sound] = reading.trajectory.timestamp_s
    following = np.where(is_sound, times, np.inf)
    next_s = np.minimum.accumulate(following[::-1])[::-1]
    rows: list[int] = []
    latest_s = -np.inf
    for row, line in enumerate(lines):
        if not is_sound[row]:
            time_s = left_out[line].timestamp_s
            if time_s is None or not latest_s < time_s < next_s[row]:
                continue
            times[row] = time_s
        rows.append(row)
        latest_s = float(times[row])
    kept = np.array(rows, dtype=np.intp)
    poses = Rigid3.unknown((len(lines),))
    poses.translation_m[is_sound] = reading.trajectory.position_m
    poses.quat_xyzw[is_sound] = reading.trajectory.quat_xyzw
    return FramesOfRows(kept, times[kept], poses.at(kept))
