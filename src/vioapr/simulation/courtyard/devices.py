"""A phone's instruments along a walk: tracker, IMU, satellite positions and compass.

Their errors are those of phones in kind and size: slow drift and bias rather than white noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Tracking
from vioapr.scene.scene import GeodeticOrigin
from vioapr.scene.sensors import Gnss, Heading, Imu
from vioapr.simulation.courtyard.walks import IMU_RATE_HZ, Motion
from vioapr.simulation.walks import smooth_noise, track

HEADING_DRIFT_DEG = 0.15
"""Random walk of the tracker's heading, deg per square root of a second."""
SCALE_ERROR = 0.01
STEP_NOISE_M = 0.005
"""The tracker's position noise, m per square root of a second."""
TILT_ERROR_DEG = 0.1
ORIGIN = GeodeticOrigin(48.0, 11.0, 520.0)
"""Where the simulated place would be on the earth: nowhere in particular."""
_LOST_S, _LIMITED_S = 4.0, 1.0


class Mishaps(NamedTuple):
    """What happens to a tracker; times from the recording's start, s; None for never.

    Attributes:
        lost_s: It loses track for some seconds, and starts anew in another world.
        jump_s: It recognizes an earlier place, and jumps to where it then believes to be.
    """

    lost_s: float | None = None
    jump_s: float | None = None


class Track(NamedTuple):
    """What a tracker says of every frame.

    Attributes:
        tracking: Values of `Tracking`, shape (n,).
        vio_from_cam: Shape (n,); meaningless where lost.
    """

    tracking: NDArray[np.intp]
    vio_from_cam: Rigid3


def track_frames(
    rng: np.random.Generator, timestamp_s: NDArray, world_from_cam: Rigid3, mishaps: Mishaps
) -> Track:
    """Track a walk's frames, shape (n,)."""
    tracking = np.full(len(timestamp_s), Tracking.NORMAL, dtype=np.intp)
    if mishaps.lost_s is None:
        vio = _track_part(rng, timestamp_s, world_from_cam)
    else:
        lost = (timestamp_s >= mishaps.lost_s) & (timestamp_s < mishaps.lost_s + _LOST_S)
        before, after = timestamp_s < mishaps.lost_s, timestamp_s >= mishaps.lost_s + _LOST_S
        tracking[lost] = Tracking.LOST
        tracking[np.flatnonzero(after)[:1]] = Tracking.RESET
        vio = Rigid3(
            np.zeros((len(timestamp_s), 3)), np.tile([0.0, 0, 0, 1], (len(timestamp_s), 1))
        )
        for part in (before, after):
            if part.any():
                moved = _track_part(rng, timestamp_s[part], world_from_cam.at(part))
                for whole, piece in zip(vio, moved, strict=True):
                    whole[part] = piece
    if mishaps.jump_s is not None:
        doubts = (timestamp_s >= mishaps.jump_s - _LIMITED_S) & (timestamp_s < mishaps.jump_s)
        tracking[doubts & (tracking == Tracking.NORMAL)] = Tracking.LIMITED
        vio = _jump(rng, vio, timestamp_s >= mishaps.jump_s)
    return Track(tracking, vio)


def measure_imu(rng: np.random.Generator, motion: Motion, duration_s: float) -> Imu:
    """Accelerometer and gyroscope at 100 Hz in the axes of cam, with bias and noise."""
    times = np.arange(int(duration_s * IMU_RATE_HZ) + 1) / IMU_RATE_HZ
    shape = (len(times), 3)
    interval = np.sqrt(1 / IMU_RATE_HZ)
    accel_bias = rng.normal(0, 0.03, 3) + 3e-4 * interval * np.cumsum(rng.standard_normal(shape), 0)
    gyro_bias = rng.normal(0, 0.003, 3) + 3e-5 * interval * np.cumsum(rng.standard_normal(shape), 0)
    accel = motion.specific_force_m_s2(times) + accel_bias + rng.normal(0, 0.02, shape)
    gyro = motion.angular_velocity_rad_s(times) + gyro_bias + rng.normal(0, 0.0015, shape)
    return Imu(times, accel, gyro)


def measure_gnss(rng: np.random.Generator, motion: Motion, duration_s: float) -> Gnss:
    """Positions once a second, metres off, and seldom the same way for long."""
    times = np.arange(0.3, duration_s, 1.0)
    wander = np.stack([smooth_noise(rng, times, 12.0) for _ in range(3)], axis=-1)
    error = wander * [2.2, 2.2, 4.0] + rng.normal(0, 0.3, (len(times), 3))
    error += rng.normal(0, 1.2, 3)
    latitude, longitude, altitude = geodetic(motion.position_m(times) + error)
    horizontal = np.abs(rng.normal(4.0, 0.7, len(times)))
    return Gnss(times, latitude, longitude, altitude, horizontal, 1.6 * horizontal)


def measure_heading(rng: np.random.Generator, motion: Motion, duration_s: float) -> Heading:
    """The compass ten times a second, degrees off because of the iron around."""
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


def _track_part(rng: np.random.Generator, timestamp_s: NDArray, world_from_cam: Rigid3) -> Rigid3:
    """One tracking world: drift of heading and scale, steps' noise, and a slight tilt."""
    vio = track(
        rng, timestamp_s, world_from_cam, heading_drift_deg=HEADING_DRIFT_DEG,
        scale_error=SCALE_ERROR, step_noise_m=STEP_NOISE_M,
    )  # fmt: skip
    if len(timestamp_s) < 2:
        return vio
    lean = np.deg2rad(TILT_ERROR_DEG) * np.stack(
        [smooth_noise(rng, timestamp_s, 8.0), 0 * timestamp_s, smooth_noise(rng, timestamp_s, 8.0)],
        axis=-1,
    )
    return vio._replace(quat_xyzw=quaternion.multiply(quaternion.from_rotvec(lean), vio.quat_xyzw))


def _jump(rng: np.random.Generator, vio: Rigid3, later: NDArray) -> Rigid3:
    """Poses from a moment on turned about the place of the jump and shifted."""
    if not later.any():
        return vio
    pivot = vio.translation_m[np.argmax(later)]
    angle = np.deg2rad(rng.uniform(2.0, 4.0) * rng.choice([-1, 1]))
    turn = quaternion.from_rotvec(np.array([0.0, angle, 0.0]))
    direction = rng.uniform(0, 2 * np.pi)
    shift = rng.uniform(0.4, 0.8) * np.array([np.cos(direction), 0.0, np.sin(direction)])
    moved = quaternion.rotate(turn, vio.translation_m - pivot) + pivot + shift
    return Rigid3(
        np.where(later[:, None], moved, vio.translation_m),
        np.where(later[:, None], quaternion.multiply(turn, vio.quat_xyzw), vio.quat_xyzw),
    )
