import numpy as np

from vioapr.trajectory import Trajectory


def make(times, names=None, is_timed=True):
    count = len(times)
    quats = np.tile([0.0, 0, 0, 1], (count, 1))
    positions = np.outer(times, [1.0, 0, 0])
    return Trajectory.from_arrays(times, positions, quats, names, is_timed=is_timed)
