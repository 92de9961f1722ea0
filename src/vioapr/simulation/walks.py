"""A simulated walk: hand-held motion, phone-grade VIO and a regressor's typical errors.

For a first look without data, for tests and for speed benchmarks. The errors have the shapes
that real ones have: VIO drifts slowly in heading and scale; a regressor's error is mostly a
bias that depends on place and view, with heavy tails, and now and then it takes one place for
another. Accuracy on it says little about real walks; docs/accuracy.md has those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from vioapr.errors import ParameterError
from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory


@dataclass(frozen=True)
class WalkParams:
    """How the walk and its errors are drawn."""

    duration_s: float = 180.0
    """Length of the walk, s."""
    rate_hz: float = 2.0
    """Frames per second, each with an image."""
    extent_m: float = 40.0
    """Size of the place, m: the longer side of the round that is walked."""
    speed_m_s: float = 1.1
    """Mean walking speed, m/s."""
    heading_drift_deg: float = 0.15
    """Random walk of VIO's heading, deg per square root of a second."""
    scale_error: float = 0.01
    """Standard deviation of VIO's scale error, a share of 1."""
    step_noise_m: float = 0.005
    """VIO's position noise, m per square root of a second."""
    bias_m: float = 0.8
    """The regressor's position bias, which depends on place and view: standard deviation per
    axis, m."""
    bias_deg: float = 2.5
    """Its orientation bias, likewise, deg."""
    noise_m: float = 0.25
    """Its position noise from frame to frame, heavy-tailed: scale per axis, m."""
    noise_deg: float = 0.8
    """Its orientation noise, likewise, deg."""
    lookalike_share: float = 0.06
    """Share of frames in which it takes the place for another one, 0 to 1."""

    def __post_init__(self) -> None:
        for name in ("duration_s", "rate_hz", "extent_m", "speed_m_s"):
            if not 0 < getattr(self, name) < float("inf"):
                raise ParameterError(
                    f"{name}: expected a number above 0, got {getattr(self, name)}"
                )
        if self.duration_s * self.rate_hz < 2:
            raise ParameterError(
                f"expected at least 2 frames, got {self.duration_s} s at {self.rate_hz} Hz"
            )


@dataclass(frozen=True)
class SimulatedWalk:
    """The three trajectories of a walk, on one clock.

    Attributes:
        gt: world_from_cam, exact; z-up world.
        apr: world_from_cam, as a regressor would predict it.
        vio: vio_from_cam, as a phone would track it; y-up world of its own heading and origin.
    """

    gt: Trajectory
    apr: Trajectory
    vio: Trajectory


def simulate_walk(params: WalkParams | None = None, seed: int = 0) -> SimulatedWalk:
    """Draw a walk; the same parameters and seed give the same walk."""
    params = params or WalkParams()
    rng = np.random.default_rng(seed)
    times = np.arange(1, round(params.duration_s * params.rate_hz) + 1) / params.rate_hz
    world_from_cam = _walk(rng, times, params)
    timed = Trajectory(times, world_from_cam.translation_m, world_from_cam.quat_xyzw)
    tracked = track(
        rng,
        times,
        world_from_cam,
        heading_drift_deg=params.heading_drift_deg,
        scale_error=params.scale_error,
        step_noise_m=params.step_noise_m,
    )
    vio = timed.with_transforms(tracked)
    return SimulatedWalk(
        gt=timed,
        apr=timed.with_transforms(_regress(rng, world_from_cam, params)),
        vio=Trajectory(times, vio.position_m, vio.quat_xyzw, target="vio"),
    )


def smooth_noise(rng: np.random.Generator, times: NDArray, seconds: float) -> NDArray:
    """Noise of standard deviation about 1 that changes over some seconds, shape (n,)."""
    interval = times[1] - times[0]
    width = max(seconds / interval, 0.5)
    padding = int(4 * width) + 1
    white = rng.standard_normal(len(times) + 2 * padding)
    smooth = gaussian_filter1d(white, width)[padding:-padding]
    return smooth * np.sqrt(2 * width * np.sqrt(np.pi))


def _walk(rng: np.random.Generator, times: NDArray, params: WalkParams) -> Rigid3:
    """A round of the place with the phone held up, looking about."""
    radius = params.extent_m / 2 * (0.85 + 0.1 * smooth_noise(rng, times, 20.0))
    speed = params.speed_m_s * np.clip(1 + 0.3 * smooth_noise(rng, times, 5.0), 0.0, None)
    course = rng.uniform(0, 2 * np.pi) + np.cumsum(speed) * (times[1] - times[0]) / radius.mean()
    height = 1.5 + 0.03 * smooth_noise(rng, times, 1.0)
    position = np.stack([radius * np.cos(course), 0.7 * radius * np.sin(course), height], axis=-1)
    heading = course + np.pi / 2 + np.deg2rad(40) * smooth_noise(rng, times, 4.0)
    pitch = np.deg2rad(6) * smooth_noise(rng, times, 3.0)
    roll = np.deg2rad(3) * smooth_noise(rng, times, 2.0)
    # From a camera that looks along the world's x axis with z up, turned step by step.
    level = np.array([-0.5, 0.5, -0.5, 0.5])
    turns = [np.stack([roll, pitch, 0 * roll], axis=-1), np.outer(heading, [0.0, 0.0, 1.0])]
    quat = quaternion.multiply(quaternion.from_rotvec(turns[0]), level)
    return Rigid3(position, quaternion.multiply(quaternion.from_rotvec(turns[1]), quat))


def track(
    rng: np.random.Generator,
    times: NDArray,
    world_from_cam: Rigid3,
    *,
    heading_drift_deg: float,
    scale_error: float,
    step_noise_m: float,
) -> Rigid3:
    """Track a walk as a phone does: add up the camera's motion with its errors.

    Args:
        rng: Source of randomness.
        times: Shape (n,), s.
        world_from_cam: Shape (n,), z-up world.
        heading_drift_deg: Random walk of the heading, deg per square root of a second.
        scale_error: Standard deviation of the scale's error, a share of 1.
        step_noise_m: Position noise, m per square root of a second.

    Returns:
        vio_from_cam, shape (n,): a y-up world of arbitrary heading that starts at the camera.
    """
    intervals = np.diff(times, prepend=times[0])
    scale = 1 + scale_error * rng.standard_normal()
    drift = rng.standard_normal(len(times)) * np.sqrt(intervals)
    heading = rng.uniform(0, 2 * np.pi) + np.deg2rad(heading_drift_deg) * np.cumsum(drift)
    turn = quaternion.from_rotvec(np.outer(heading, [0.0, 0.0, 1.0]))
    steps = np.diff(world_from_cam.translation_m, axis=0, prepend=world_from_cam.translation_m[:1])
    noise = rng.standard_normal(steps.shape) * np.sqrt(intervals)[:, None]
    moved = quaternion.rotate(turn, scale * steps) + step_noise_m * noise
    tracked = Rigid3(np.cumsum(moved, axis=0), quaternion.multiply(turn, world_from_cam.quat_xyzw))
    return y_up_from_z_up(tracked)


def _regress(rng: np.random.Generator, world_from_cam: Rigid3, params: WalkParams) -> Rigid3:
    """Predictions: view-dependent bias, heavy-tailed noise, and look-alike places."""
    bias = _view_bias(rng, world_from_cam, params.extent_m)
    count = len(bias)
    tails = rng.standard_t(3.0, size=(count, 6))
    offset = params.bias_m * bias[:, :3] + params.noise_m * tails[:, :3]
    turn_deg = params.bias_deg * bias[:, 3:] + params.noise_deg * tails[:, 3:]
    is_lookalike = rng.random(count) < params.lookalike_share
    elsewhere = rng.uniform(-0.5, 0.5, size=(count, 3)) * params.extent_m * [1.0, 0.7, 0.02]
    offset += np.where(is_lookalike[:, None], elsewhere, 0.0)
    turn_deg[:, 2] += np.where(is_lookalike, rng.uniform(-60, 60, size=count), 0.0)
    error = Rigid3(offset, quaternion.from_rotvec(np.deg2rad(turn_deg)))
    return Rigid3(
        world_from_cam.translation_m + error.translation_m,
        quaternion.multiply(error.quat_xyzw, world_from_cam.quat_xyzw),
    )


def _view_bias(rng: np.random.Generator, world_from_cam: Rigid3, extent_m: float) -> NDArray:
    """Six smooth random functions of place and viewing direction, shape (n, 6), deviation 1.

    Random Fourier features of a Gaussian kernel: views a twelfth of the place or half a
    radian apart are hardly related.
    """
    view = quaternion.rotate(world_from_cam.quat_xyzw, np.array([0.0, 0.0, 1.0]))
    features = np.concatenate(
        [world_from_cam.translation_m[:, :2] / (extent_m / 12), view[:, :2] / 0.5], axis=1
    )
    waves = features @ rng.standard_normal((4, 128)) + rng.uniform(0, 2 * np.pi, 128)
    return np.sqrt(2 / 128) * np.cos(waves) @ rng.standard_normal((128, 6))
