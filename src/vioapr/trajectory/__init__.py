"""Trajectories: timed poses of one device, their association and their interpolation."""

from vioapr.trajectory.association import (
    DEFAULT_TOLERANCE_S,
    Association,
    associate,
    associate_frames,
    nearest_rows,
    poses_of_frames,
)
from vioapr.trajectory.between_frames import interpolate_between_frames
from vioapr.trajectory.trajectory import UNIT_TOLERANCE, Trajectory, find_problem

__all__ = [
    "DEFAULT_TOLERANCE_S",
    "UNIT_TOLERANCE",
    "Association",
    "Trajectory",
    "associate",
    "associate_frames",
    "find_problem",
    "interpolate_between_frames",
    "nearest_rows",
    "poses_of_frames",
]
