"""A simulated walk: hand-held motion, phone-grade VIO and a regressor's typical errors.

For a first look without data, for tests and for speed benchmarks. The errors have the shapes
that real ones have: VIO drifts slowly in heading and scale; a regressor's error is mostly a
bias that depends on place and view, with heavy tails, and now and then it takes one place for
another. Accuracy on it says little about real walks; docs/results/accuracy.md has those.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.handheld import looking, smooth_noise
from vioapr.simulation.regressors import RegressorErrors, regress
from vioapr.simulation.trackers import TrackerErrors, track
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
    tracker: TrackerErrors = field(default_factory=TrackerErrors)
    """How the phone's tracker errs."""
    regressor: RegressorErrors = field(default_factory=RegressorErrors)
    """How the regressor errs."""

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
    world_from_cam = walk_round(rng, times, params.extent_m, params.speed_m_s)
    tracked = track(rng, times, world_from_cam, params.tracker)
    predicted = regress(rng, world_from_cam, params.regressor, params.extent_m)
    gt = Trajectory(times, world_from_cam.translation_m, world_from_cam.quat_xyzw)
    vio = replace(gt.with_transforms(tracked), target="vio")
    return SimulatedWalk(gt, gt.with_transforms(predicted), vio)


def walk_round(
    rng: np.random.Generator, timestamp_s: NDArray[np.float64], extent_m: float, speed_m_s: float
) -> Rigid3:
    """Walk round a place with the phone held up, looking about.

    Args:
        rng: Source of randomness.
        timestamp_s: Evenly spaced, shape (n,).
        extent_m: The longer side of the round, along x; the shorter one is 0.7 of it.
        speed_m_s: Mean walking speed.

    Returns:
        world_from_cam, shape (n,): z-up world, its origin on the ground in the middle.
    """
    radius = extent_m / 2 * (0.85 + 0.1 * smooth_noise(rng, timestamp_s, 20.0))
    speed = speed_m_s * np.clip(1 + 0.3 * smooth_noise(rng, timestamp_s, 5.0), 0.0, None)
    interval_s = timestamp_s[1] - timestamp_s[0]
    course = rng.uniform(0, 2 * np.pi) + np.cumsum(speed) * interval_s / radius.mean()
    height = 1.5 + 0.03 * smooth_noise(rng, timestamp_s, 1.0)
    position = np.stack([radius * np.cos(course), 0.7 * radius * np.sin(course), height], axis=-1)
    heading = course + np.pi / 2 + np.deg2rad(40) * smooth_noise(rng, timestamp_s, 4.0)
    pitch = np.deg2rad(6) * smooth_noise(rng, timestamp_s, 3.0)
    roll = np.deg2rad(3) * smooth_noise(rng, timestamp_s, 2.0)
    return Rigid3(position, looking(heading, np.stack([roll, pitch, 0 * roll], axis=-1)))
