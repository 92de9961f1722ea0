"""Rotations, rigid transforms, averages and alignment: pure functions on arrays."""

from vioapr.geometry.averaging import geometric_median, mean_quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import Sim3, align_umeyama

__all__ = ["Rigid3", "Sim3", "align_umeyama", "geometric_median", "mean_quaternion"]
