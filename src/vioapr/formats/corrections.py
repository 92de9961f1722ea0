"""Corrections of files that were written in another convention, unit or clock."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vioapr.errors import ParameterError
from vioapr.formats.readings import READINGS
from vioapr.trajectory import Trajectory


@dataclass(frozen=True)
class Corrections:
    """What to change of a trajectory as it was read.

    Attributes:
        reading: Name of the convention that the file is really in; see `readings.READINGS`.
        scale: Factor of all positions, e.g. 0.01 for a file in centimetres.
        shift_s: Added to all timestamps, s.
    """

    reading: str | None = None
    scale: float = 1.0
    shift_s: float = 0.0

    def __post_init__(self) -> None:
        names = [reading.name for reading in READINGS]
        if self.reading is not None and self.reading not in names:
            raise ParameterError(
                f"reading: expected one of {', '.join(names)}, got {self.reading!r}"
            )
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise ParameterError(f"scale: expected a number above 0, got {self.scale}")
        if not np.isfinite(self.shift_s):
            raise ParameterError(f"shift_s: expected a number, got {self.shift_s}")

    def apply(self, trajectory: Trajectory) -> Trajectory:
        """Correct a trajectory.

        Raises:
            ParameterError: A clock is to be shifted, and the trajectory has none.
        """
        if self.shift_s and not trajectory.is_timed:
            raise ParameterError("shift_s: the file has no timestamps to shift")
        poses = trajectory.target_from_source
        if self.reading is not None:
            poses = next(r for r in READINGS if r.name == self.reading).change(poses)
        poses = poses._replace(translation_m=poses.translation_m * self.scale)
        return replace(
            trajectory.with_transforms(poses), timestamp_s=trajectory.timestamp_s + self.shift_s
        )
