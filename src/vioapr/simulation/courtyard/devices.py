"""A phone's instruments along a walk: IMU, satellite positions and compass.

Their errors are those of phones in kind and size: slow drift and bias rather than white noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.scene.sensors import Gnss, Heading, Imu
from vioapr.schemas.scene import GeodeticOrigin
from vioapr.simulation.courtyard.walks import IMU_RATE_HZ, Motion
from vioapr.simulation.handheld import smooth_noise

ORIGIN = GeodeticOrigin(48.0, 11.0, 520.0)
"""Where the simulated place would be on the earth: nowhere in particular."""


def measure_imu(rng: np.random.Generator, motion: Motion, duration_s: float) -> Imu:
    """Measure specific force and angular velocity at 100 Hz in cam, with bias and noise."""
    times = np.arange(int(duration_s * IMU_RATE_HZ) + 1) / IMU_RATE_HZ
    shape = (len(times), 3)
    interval = np.sqrt(1 / IMU_RATE_HZ)
    accel_bias = rng.normal(0, 0.03, 3) + 3e-4 * interval * np.cumsum(rng.standard_normal(shape), 0)
    gyro_bias = rng.normal(0, 0.003, 3) + 3e-5 * interval * np.cumsum(rng.standard_normal(shape), 0)
    accel = motion.specific_force_m_s2(times) + accel_bias + rng.normal(0, 0.02, shape)
    gyro = motion.angular_velocity_rad_s(times) + gyro_bias + rng.normal(0, 0.0015, shape)
    return Imu(times, accel, gyro)


def measure_gnss(rng: np.random.Generator, motion: Motion, duration_s: float) -> Gnss:
    """Measure positions once a second: metres off, by errors that change within some seconds."""
    times = np.arange(0.3, duration_s, 1.0)
    wander = np.stack([smooth_noise(rng, times, 12.0) for _ in range(3)], axis=-1)
    error = wander * [2.2, 2.2, 4.0] + rng.normal(0, 0.3, (len(times), 3))
    error += rng.normal(0, 1.2, 3)
    latitude, longitude, altitude = geodetic(motion.position_m(times) + error)
    horizontal = np.abs(rng.normal(4.0, 0.7, len(times)))
    return Gnss(times, latitude, longitude, altitude, horizontal, 1.6 * horizontal)


def measure_heading(rng: np.random.Generator, motion: Motion, duration_s: float) -> Heading:
    """Measure headings ten times a second: degrees off because of the iron around."""
    times = np.arange(0.05, duration_s, 0.1)
    view = quaternion.rotate(motion.world_from_cam(times).quat_xyzw, np.array([0.0, 0.0, 1.0]))
    error = rng.normal(0, 4) + 4 * smooth_noise(rng, times, 8.0) + rng.normal(0, 0.4, len(times))
    heading = np.rad2deg(np.arctan2(view[:, 0], view[:, 1])) + error
    return Heading(times, heading % 360.0, np.abs(rng.normal(10.0, 1.5, len(times))))


def geodetic(world_m: NDArray, origin: GeodeticOrigin = ORIGIN) -> NDArray[np.float64]:
    """Latitude, longitude and altitude of points of a world whose x is east and y is north.

    By the ellipsoid's radii of curvature at the origin: exact to millimetres within 100 m.

    Returns:
        Shape (3, n): degrees, degrees, metres.
    """
    axis_m, flatness = 6378137.0, 6.69437999014e-3
    latitude = np.deg2rad(origin.latitude_deg)
    root = np.sqrt(1 - flatness * np.sin(latitude) ** 2)
    north_m, east_m = axis_m * (1 - flatness) / root**3, axis_m / root * np.cos(latitude)
    return np.stack(
        [
            origin.latitude_deg + np.rad2deg(world_m[..., 1] / north_m),
            origin.longitude_deg + np.rad2deg(world_m[..., 0] / east_m),
            origin.altitude_m + world_m[..., 2],
        ]
    )
