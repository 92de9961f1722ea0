"""A simulated pose regressor: predictions with its typical errors, without images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

_WAVES = 128


@dataclass(frozen=True)
class RegressorErrors:
    """The sizes of a regressor's errors."""

    bias_m: float = 0.8
    """Position bias, which depends on place and view: standard deviation per axis, m."""
    bias_deg: float = 2.5
    """Orientation bias, which depends on place and view, deg."""
    noise_m: float = 0.25
    """Position noise from frame to frame, heavy-tailed: scale per axis, m."""
    noise_deg: float = 0.8
    """Orientation noise from frame to frame, heavy-tailed, deg."""
    lookalike_share: float = 0.06
    """Share of frames in which it takes the place for another one, 0 to 1."""


NO_REGRESSOR_ERRORS = RegressorErrors(0.0, 0.0, 0.0, 0.0, 0.0)


def regress(
    rng: np.random.Generator, world_from_cam: Rigid3, errors: RegressorErrors, extent_m: float
) -> Rigid3:
    """Predict poses: with a view-dependent bias, heavy-tailed noise, and look-alike places.

    Args:
        rng: Source of randomness.
        world_from_cam: The true poses, shape (n,), z-up world.
        errors: Their sizes.
        extent_m: Size of the place: views a twelfth of it apart have biases of their own.

    Returns:
        Predicted world_from_cam, shape (n,).
    """
    bias = view_bias(rng, world_from_cam, extent_m / 12)
    count = len(bias)
    tails = rng.standard_t(3.0, size=(count, 6))
    offset = errors.bias_m * bias[:, :3] + errors.noise_m * tails[:, :3]
    turn_deg = errors.bias_deg * bias[:, 3:] + errors.noise_deg * tails[:, 3:]
    is_lookalike = rng.random(count) < errors.lookalike_share
    elsewhere = rng.uniform(-0.5, 0.5, size=(count, 3)) * extent_m * [1.0, 0.7, 0.02]
    offset += np.where(is_lookalike[:, None], elsewhere, 0.0)
    turn_deg[:, 2] += np.where(is_lookalike, rng.uniform(-60, 60, size=count), 0.0)
    turn = quaternion.from_rotvec(np.deg2rad(turn_deg))
    return Rigid3(
        world_from_cam.translation_m + offset,
        quaternion.multiply(turn, world_from_cam.quat_xyzw),
    )


def view_bias(
    rng: np.random.Generator, world_from_cam: Rigid3, length_m: float
) -> NDArray[np.float64]:
    """Six smooth random functions of place and viewing direction, standard deviation 1.

    Random Fourier features of a Gaussian kernel (Rahimi and Recht 2007): views `length_m` or
    half a radian apart are hardly related.

    Returns:
        Shape (n, 6).
    """
    view = quaternion.rotate(world_from_cam.quat_xyzw, np.array([0.0, 0.0, 1.0]))
    features = np.concatenate(
        [world_from_cam.translation_m[:, :2] / length_m, view[:, :2] / 0.5], axis=1
    )
    phase = rng.standard_normal((4, _WAVES))
    waves = features @ phase + rng.uniform(0, 2 * np.pi, _WAVES)
    return np.sqrt(2 / _WAVES) * np.cos(waves) @ rng.standard_normal((_WAVES, 6))
