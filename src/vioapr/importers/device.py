"""A phone's accelerometer and gyroscope, from its own axes and units to those of recordings.

iOS and Android measure in the device's axes: held upright before one's face, x to the right,
y up, z towards the person. The camera lies on its side in it: its OpenCV x is the device's -y,
its y is -x and its z is -z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.importers.base import Walk
from vioapr.scene.sensors import Imu

GRAVITY_M_S2 = 9.80665
_CAM_FROM_DEVICE = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def imu_of_device(
    walk: Walk,
    timestamp_s: NDArray[np.float64],
    accel: NDArray[np.float64],
    gyro_rad_s: NDArray[np.float64],
) -> Imu:
    """Measurements of an iPhone in the axes and units of recordings; says what the units were.

    Args:
        walk: Where findings go.
        timestamp_s: Shape (n,), s.
        accel: Device axes, shape (n, 3). By Core Motion in g, of the reaction's opposite sign: at
            rest it points down. Some apps write m/s^2; the length tells.
        gyro_rad_s: Device axes, shape (n, 3), rad/s.
    """
    length = float(np.median(np.linalg.norm(accel, axis=1)))
    if 0.7 < length < 1.5:
        unit, scale = "g", GRAVITY_M_S2
    elif 7 < length < 15:
        unit, scale = "m/s^2", 1.0
    else:
        walk.warn(
            f"accelerometer: its median is {length:.2f}, neither 1 g nor 9.81 m/s^2: without "
            "gravity? It is left out"
        )
        unit, scale = "", np.nan
    if unit:
        walk.note(f"accelerometer: in {unit} (median {length:.2f}), turned to camera axes")
    return Imu(timestamp_s, -scale * accel @ _CAM_FROM_DEVICE.T, gyro_rad_s @ _CAM_FROM_DEVICE.T)
