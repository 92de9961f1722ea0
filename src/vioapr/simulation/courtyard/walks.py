"""Walks through the courtyard: routes, and how a person with a phone follows them.

A walk is smooth enough to be differentiated twice, so that an IMU can be derived from it
exactly: positions and quaternions are splines of the fifth degree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.vectors import STANDARD_GRAVITY_M_S2, distance_along_m
from vioapr.simulation.handheld import looking, smooth_noise

ROUTES_M = {
    "around": (
        (-11.5, -9.5), (-13.6, -6.2), (-13.8, 0), (-13.7, 4), (-12.4, 8.2), (-8, 9.0),
        (-2.5, 8.9), (2.5, 9.4), (8, 9.6), (12.4, 8.6), (13.65, 4), (13.65, 0), (13.6, -4),
        (12.6, -8.2), (7, -9.8), (0, -9.6), (-7, -9.6),
    ),
    "figure eight": (
        (-4.4, -3), (-4.5, 1.5), (-4.9, 7.2), (-8.5, 8.2), (-13.3, 8.0), (-13.9, 2), (-13.7, -6),
        (-9.5, -8.0), (-4.6, -7.8), (-1.8, -4.4), (2.2, -4.2), (4.5, -1), (4.6, 4), (5.0, 7.8),
        (9, 8.3), (13.2, 8.0), (13.6, 1), (13.4, -6.5), (9.5, -8.2), (4.6, -7.6), (4.0, -2.6),
        (0.4, -4.6),
    ),
    "through the middle": (
        (-12.8, -10.4), (-5.4, -9.0), (-4.6, -2), (-3.4, 3.2), (0.6, 4.8), (4.6, 2.4), (4.8, -4),
        (5.6, -9.0), (11, -9.4), (13.6, -5), (13.6, 3), (12.4, 8.9), (5.2, 9.3), (3.6, 4.4),
        (-0.5, 4.7), (-4.6, 5.6), (-6.2, 8.9), (-12.6, 8.6), (-13.9, 1), (-13.9, -6),
    ),
    "along the arcade": (
        (-10, -10.7), (0, -10.9), (10, -10.5), (13.4, -7.2), (9, -8.3), (3.4, -7.6), (4.6, -1.4),
        (2.6, 4.0), (-2.4, 4.2), (-4.7, 0), (-3.2, -4.2), (-3.6, -8.2), (-9.0, -8.4), (-13.4, -7.8),
    ),
    "past the shops": (
        (4.6, -6.2), (9, -8.6), (13.1, -7.6), (13.6, -1), (13.5, 6.5), (9.4, 8.9), (3.0, 9.7),
        (-1.6, 8.9), (-4.8, 7.2), (-4.6, 2), (-3.9, -3.0), (0.5, -4.7),
    ),
    "back and forth": (
        (-12.2, 9.6), (-5.2, 8.6), (-4.4, 3.6), (-4.6, -3.2), (-5.2, -8.6), (-12.6, -8.4),
        (-13.9, -1.5), (-13.8, 4.5), (-12.9, 8.2), (-8.2, 8.0), (0.0, 9.1), (6.2, 8.4), (4.7, 3),
        (4.4, -3.4), (1.2, -5.2), (-3.8, -4.2), (-4.5, 2.6), (-5.2, 7.6),
    ),
}  # fmt: skip
"""Closed routes by name, as points on the ground that a spline goes through, m.

Who follows one keeps within `SWAY_M` of it.
"""
SWAY_M = 0.22

ENTRANCE_M = (-13.9, 0.0)
"""Before the passage from the street: every walk begins near it."""
EYE_HEIGHT_M = 1.52
"""Of a phone that is held up."""
IMU_RATE_HZ = 100.0
_KNOT_RATE_HZ = 50.0


@dataclass(frozen=True)
class Motion:
    """A camera's continuous motion.

    Attributes:
        position_m: Spline of its place in the world, (3,).
        quat_xyzw: Spline of a multiple of world_from_cam's quaternion, (4,).
    """

    position_m: BSpline
    quat_xyzw: BSpline

    def world_from_cam(self, timestamp_s: ArrayLike) -> Rigid3:
        """Poses at times, shape (n,)."""
        return Rigid3(
            self.position_m(timestamp_s), quaternion.normalize(self.quat_xyzw(timestamp_s))
        )

    def angular_velocity_rad_s(self, timestamp_s: ArrayLike) -> NDArray[np.float64]:
        """In the axes of cam, shape (n, 3): twice the vector part of q^-1 dq/dt."""
        quat, rate = self.quat_xyzw(timestamp_s), self.quat_xyzw(timestamp_s, 1)
        product = quaternion.multiply(quaternion.inverse(quat), rate)
        return 2 * product[..., :3] / (quat**2).sum(axis=-1, keepdims=True)

    def specific_force_m_s2(self, timestamp_s: ArrayLike) -> NDArray[np.float64]:
        """What an accelerometer feels, in the axes of cam, shape (n, 3): up when at rest."""
        felt = self.position_m(timestamp_s, 2) + np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])
        cam_from_world = quaternion.inverse(self.world_from_cam(timestamp_s).quat_xyzw)
        return quaternion.rotate(cam_from_world, felt)


def closed_route(points_m: ArrayLike) -> tuple[CubicSpline, float]:
    """The smooth closed line through points, by the distance along it, and its length, m."""
    points = np.asarray(points_m, dtype=np.float64)
    points = np.concatenate([points, points[:1]])
    chord = distance_along_m(points)
    by_chord = CubicSpline(chord, points, bc_type="periodic")
    fine = np.linspace(0, chord[-1], 2000)
    places = by_chord(fine)
    distance = distance_along_m(places)
    places[-1] = places[0]
    return CubicSpline(distance, places, bc_type="periodic"), float(distance[-1])


def walk(
    rng: np.random.Generator,
    route: str,
    duration_s: float,
    *,
    backwards: bool = False,
    speed_m_s: float = 1.15,
) -> Motion:
    """Walk along a route with a phone held up, looking about.

    Args:
        rng: Source of randomness.
        route: A key of `ROUTES_M`.
        duration_s: How long, s.
        backwards: Whether to go the other way round.
        speed_m_s: Mean speed.
    """
    points = ROUTES_M[route][::-1] if backwards else ROUTES_M[route]
    line, length = closed_route(points)
    margin_s = 0.5  # splines are at their worst at their ends
    times = np.arange(-margin_s, duration_s + margin_s, 1 / _KNOT_RATE_HZ)
    speed = speed_m_s * np.clip(1 + 0.22 * smooth_noise(rng, times, 3.0), 0.1, 1.8)
    candidates = np.linspace(0, length, 1000)
    nearest = np.linalg.norm(line(candidates) - ENTRANCE_M, axis=1).argmin()
    start = float(candidates[nearest]) + rng.normal(0, 0.8)
    along = start + np.cumsum(speed) / _KNOT_RATE_HZ
    stride = np.cumsum(speed) / _KNOT_RATE_HZ * (2 * np.pi / 1.35)  # two steps are 1.35 m
    place, forward = line(along % length), line(along % length, 1)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    # The phone sways with every second and bobs with every step.
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
    aside = 0.18 * np.tanh(smooth_noise(rng, times, 6.0)) + 0.016 * np.sin(stride)
    aside = aside + 0.006 * smooth_noise(rng, times, 0.25)
    height = EYE_HEIGHT_M + 0.02 * np.cos(2 * stride) + 0.03 * smooth_noise(rng, times, 2.5)
    position = np.column_stack([place + aside[:, None] * left, height])
    course = np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))
    quat = look_about(rng, times, course, stride)
    return Motion(make_interp_spline(times, position, k=5), make_interp_spline(times, quat, k=5))


def look_about(
    rng: np.random.Generator, timestamp_s: NDArray, course_rad: NDArray, stride_rad: NDArray
) -> NDArray[np.float64]:
    """The orientations of a phone that is held up: the view wanders, the hand trembles.

    Args:
        rng: Source of randomness.
        timestamp_s: Evenly spaced, shape (n,).
        course_rad: Where the person walks to, without jumps, shape (n,).
        stride_rad: Phase of their stride, two steps a turn, shape (n,).

    Returns:
        world_from_cam as quaternions xyzw without jumps of sign, shape (n, 4).
    """
    heading = course_rad + np.deg2rad(
        34 * smooth_noise(rng, timestamp_s, 7.0) + 20 * smooth_noise(rng, timestamp_s, 1.6)
        + 0.6 * np.sin(stride_rad) + 0.10 * smooth_noise(rng, timestamp_s, 0.06)
    )  # fmt: skip
    pitch = np.deg2rad(
        4 + 5 * smooth_noise(rng, timestamp_s, 2.5) + 0.5 * np.sin(2 * stride_rad + 0.7)
        + 0.10 * smooth_noise(rng, timestamp_s, 0.06)
    )  # fmt: skip
    roll = np.deg2rad(
        1.8 * smooth_noise(rng, timestamp_s, 2.0) + 0.5 * np.sin(stride_rad + 0.4)
        + 0.08 * smooth_noise(rng, timestamp_s, 0.06)
    )  # fmt: skip
    zero = np.zeros_like(roll)
    return looking(
        heading, np.stack([zero, -pitch, zero], axis=-1), np.stack([roll, zero, zero], axis=-1)
    )
