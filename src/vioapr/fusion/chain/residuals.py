"""Predictions in the window of method `chain`, carried to now by VIO."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.columns import cross, turns_from
from vioapr.fusion.chain.solver import older_by
from vioapr.fusion.chain.window import Window
from vioapr.geometry.arrays import Array, constant, namespace


class Residuals(NamedTuple):
    """Predictions about the newest frame of both hypotheses, carried to now, n of them.

    Attributes:
        values: Turns about and positions along the world's axes, rad and m, (..., 2, 6, n).
        ways_m: The way that VIO has come since, in the world, shape (..., 2, 3, n).
        legs_m: The ways from prediction to prediction in the tracking world, shape (..., 3, n).
        swings: Predicted viewing directions less the expected ones, shape (..., 2, 3, n).
    """

    values: Array
    ways_m: Array
    legs_m: Array
    swings: Array


def residuals_of(
    window: Window, world_from_vio: Array, matrices: Array, place_m: Array, path: Array
) -> Residuals:
    """Of all predictions, the newest first.

    Args:
        window: Past predictions.
        world_from_vio: By both hypotheses, shape (..., 2, 4, 1).
        matrices: The same rotations, shape (..., 2, 3, 3).
        place_m: Where they expect the camera, shape (..., 2, 3, 1).
        path: See `Hypotheses`.
    """
    xp = namespace(window.rows)
    turns = turns_from(window.rotation[..., None, :, :], world_from_vio)
    known = window.is_valid * _next(window.is_valid)
    legs_m = (window.vio_place_m - _next(window.vio_place_m)) * known
    # Both kinds of vectors are turned into the world as the path has it at their time.
    vectors = xp.concat([legs_m, window.vio_gaze], axis=-1)[..., None, :, :]
    drifted = path[..., :3, :]
    drifted = xp.concat([_next(drifted), drifted], axis=-1)
    level = matrices @ vectors
    level = level + cross(drifted, level)
    count = window.is_valid.shape[-1]
    ways_m = level[..., :count] @ constant(_since(count), level)
    places = window.place_m[..., None, :, :] + ways_m - place_m
    swings = window.gaze[..., None, :, :] - level[..., count:]
    return Residuals(xp.concat([turns, places], axis=-2), ways_m, legs_m, swings)


def _next(values: Array) -> Array:
    """The next older prediction's values, 0 for the oldest, shape (..., k, n)."""
    return older_by(values, 1)


@cache
def _since(count: int) -> np.ndarray:
    """Sums of the legs since each prediction."""
    return np.triu(np.ones((count, count)), 1)
