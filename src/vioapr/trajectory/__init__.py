"""Trajectories: timed poses of one device, their association and their interpolation."""

from vioapr.trajectory.trajectory import (
    DEFAULT_TOLERANCE_S,
    UNIT_TOLERANCE,
    Association,
    Trajectory,
    associate,
    find_problem,
    nearest_rows,
    poses_of_frames,
)

__all__ = [
    "DEFAULT_TOLERANCE_S",
    "UNIT_TOLERANCE",
    "Association",
    "Trajectory",
    "associate",
    "find_problem",
    "nearest_rows",
    "poses_of_frames",
]
