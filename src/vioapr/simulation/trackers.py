"""Simulated visual-inertial trackers: what a phone says of its motion, and how it errs.

A tracker's own world is y up, as gravity is measured, with a heading and an origin of its own.
Its errors grow with the way: the heading drifts, and the scale is a little off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import Sim3
from vioapr.scene.frames import Tracking
from vioapr.simulation.handheld import smooth_noise

LOST_S = 4.0
"""How long a tracker that loses track has no poses."""
LIMITED_S = 1.0
"""How long a tracker reports limited tracking before it relocalizes."""


@dataclass(frozen=True)
class TrackerErrors:
    """The sizes of a tracker's errors; the defaults are those of phones."""

    heading_drift_deg: float = 0.15
    """Random walk of the heading, deg per square root of a second."""
    scale_error: float = 0.01
    """Standard deviation of the scale's error, a share of 1."""
    step_noise_m: float = 0.005
    """Position noise, m per square root of a second."""
    tilt_error_deg: float = 0.0
    """Standard deviation of the slowly changing error of roll and pitch, deg."""


NO_TRACKER_ERRORS = TrackerErrors(0.0, 0.0, 0.0)


class TrackerEvents(NamedTuple):
    """What interrupts a tracker; times on the clock of the frames, s; None for never.

    Attributes:
        lost_s: It loses track for `LOST_S`, and starts again in another world.
        jump_s: It relocalizes: the poses that follow are turned and shifted.
    """

    lost_s: float | None = None
    jump_s: float | None = None


class TrackedFrames(NamedTuple):
    """What a tracker says of every frame.

    Attributes:
        tracking: Values of `Tracking`, shape (n,).
        vio_from_cam: Shape (n,); meaningless where lost.
    """

    tracking: NDArray[np.intp]
    vio_from_cam: Rigid3


def dead_reckon(
    world_from_cam: Rigid3,
    heading_rad: NDArray[np.float64],
    scale: float = 1.0,
    step_error_m: ArrayLike = 0.0,
) -> Rigid3:
    """Add up the camera's steps, each turned by the heading that the tracker has by then.

    Args:
        world_from_cam: Shape (n,), z-up world.
        heading_rad: Of the tracker's world, counterclockwise seen from above, shape (n,).
        scale: Tracker's metres per metre.
        step_error_m: Added to every step, shape (n, 3), z up.

    Returns:
        vio_from_cam, shape (n,): a y-up world whose origin is the first camera.
    """
    turn = quaternion.from_rotvec(np.outer(heading_rad, [0.0, 0.0, 1.0]))
    steps = np.diff(world_from_cam.translation_m, axis=0, prepend=world_from_cam.translation_m[:1])
    moved = quaternion.rotate(turn, scale * steps) + np.asarray(step_error_m)
    tracked = Rigid3(np.cumsum(moved, axis=0), quaternion.multiply(turn, world_from_cam.quat_xyzw))
    return y_up_from_z_up(tracked)


def track(
    rng: np.random.Generator,
    timestamp_s: NDArray[np.float64],
    world_from_cam: Rigid3,
    errors: TrackerErrors | None = None,
) -> Rigid3:
    """Track a walk as a phone does.

    Args:
        rng: Source of randomness.
        timestamp_s: Shape (n,).
        world_from_cam: Shape (n,), z-up world.
        errors: None for a phone's.

    Returns:
        vio_from_cam, shape (n,): a y-up world of arbitrary heading that starts at the camera.
    """
    errors = errors or TrackerErrors()
    intervals = np.diff(timestamp_s, prepend=timestamp_s[0])
    scale = 1 + errors.scale_error * rng.standard_normal()
    drift = rng.standard_normal(len(timestamp_s)) * np.sqrt(intervals)
    heading = rng.uniform(0, 2 * np.pi) + np.deg2rad(errors.heading_drift_deg) * np.cumsum(drift)
    noise = rng.standard_normal((len(timestamp_s), 3)) * np.sqrt(intervals)[:, None]
    vio = dead_reckon(world_from_cam, heading, scale, errors.step_noise_m * noise)
    if errors.tilt_error_deg == 0 or len(timestamp_s) < 2:
        return vio
    roll, pitch = (smooth_noise(rng, timestamp_s, 8.0) for _ in range(2))
    tilt = np.deg2rad(errors.tilt_error_deg) * np.stack([roll, 0 * roll, pitch], axis=-1)
    return vio._replace(quat_xyzw=quaternion.multiply(quaternion.from_rotvec(tilt), vio.quat_xyzw))


def track_frames(
    rng: np.random.Generator,
    timestamp_s: NDArray[np.float64],
    world_from_cam: Rigid3,
    errors: TrackerErrors | None = None,
    events: TrackerEvents | None = None,
) -> TrackedFrames:
    """Track a walk's frames with what interrupts the tracker; arguments as of `track`."""
    events = events or TrackerEvents()
    tracking = np.full(len(timestamp_s), Tracking.NORMAL, dtype=np.intp)
    if events.lost_s is None:
        vio = track(rng, timestamp_s, world_from_cam, errors)
    else:
        before, after = timestamp_s < events.lost_s, timestamp_s >= events.lost_s + LOST_S
        tracking[~before & ~after] = Tracking.LOST
        tracking[np.flatnonzero(after)[:1]] = Tracking.RESET
        vio = Rigid3.identity((len(timestamp_s),))
        for part in (before, after):
            if part.any():
                in_part = track(rng, timestamp_s[part], world_from_cam.at(part), errors)
                vio.translation_m[part], vio.quat_xyzw[part] = in_part
    if events.jump_s is not None:
        later = timestamp_s >= events.jump_s
        soon = (timestamp_s >= events.jump_s - LIMITED_S) & ~later
        tracking[soon & (tracking == Tracking.NORMAL)] = Tracking.LIMITED
        if later.any():
            vio = relocalize(rng, vio, later)
    return TrackedFrames(tracking, vio)


def relocalize(rng: np.random.Generator, vio_from_cam: Rigid3, later: NDArray[np.bool_]) -> Rigid3:
    """Poses of which the later ones are turned by some degrees and shifted by some decimetres.

    Args:
        rng: Source of randomness.
        vio_from_cam: Shape (n,).
        later: At least one of the last frames, shape (n,); the turn is about the first of them.
    """
    pivot = vio_from_cam.translation_m[np.argmax(later)]
    angle = np.deg2rad(rng.uniform(2.0, 4.0) * rng.choice([-1, 1]))
    turn = quaternion.from_rotvec(np.array([0.0, angle, 0.0]))
    direction = rng.uniform(0, 2 * np.pi)
    shift = rng.uniform(0.4, 0.8) * np.array([np.cos(direction), 0.0, np.sin(direction)])
    position, quat = vio_from_cam
    moved = quaternion.rotate(turn, position - pivot) + pivot + shift
    return Rigid3(
        np.where(later[:, None], moved, position),
        np.where(later[:, None], quaternion.multiply(turn, quat), quat),
    )


def tracking_world(heading_deg: float, scale: float = 1.0) -> Sim3:
    """vio_from_world between two y-up worlds: a tracker's own heading, scale and some origin."""
    turn = quaternion.from_rotvec(np.array([0.0, np.deg2rad(heading_deg), 0.0]))
    return Sim3(np.array(scale), Rigid3(np.array([heading_deg / 10, 2.0, -1.0]), turn))


def track_without_drift(
    rng: np.random.Generator, world_from_cam: Rigid3, vio_from_world: Sim3
) -> Rigid3:
    """vio_from_cam of a tracker that errs by white noise alone: 2 mm and 0.1 deg per axis.

    Args:
        rng: Source of randomness.
        world_from_cam: Shape (n,), z-up world.
        vio_from_world: From that world, turned to y up (`y_up_from_z_up`).
    """
    placed = vio_from_world.apply_to(y_up_from_z_up(world_from_cam))
    shape = placed.translation_m.shape
    noise = quaternion.from_rotvec(np.deg2rad(0.1) * rng.standard_normal(shape))
    return Rigid3(
        placed.translation_m + 0.002 * rng.standard_normal(shape),
        quaternion.multiply(placed.quat_xyzw, noise),
    )
