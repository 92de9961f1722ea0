"""The memory of method `chain`: past predictions that differ in view, of a fixed number.

The latest few predictions are all kept. Of older ones only those are kept whose view differs
from that of the one kept before, so that neither standing still nor many predictions a second
push the memory's variety out: predictions from one view share their bias and say little more
than one of them.

Shapes in this package: predictions lie along the last axis, n of them, newest first, and what
belongs to a walk has two last axes of its own, so that all of it broadcasts: (..., 1, 1) for a
number, (..., 3, 1) for a vector. The two hypotheses lie along one more axis before these,
(..., 2, k, n), the leading one first. Orientation goes before position: two rows of one number
each, (..., 2, 1), or six of axes, (..., 6, n).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.columns import compare
from vioapr.fusion.chain.sums import largest
from vioapr.geometry.arrays import Array, Mask, constant, namespace, zeros

RECENT = 3
"""The newest predictions, which are kept whatever their view."""

_ROTATION, _GAZE, _VIO_GAZE = slice(0, 4), slice(4, 7), slice(7, 10)
_VIO_PLACE, _PLACE, _VIO_VIEW = slice(10, 13), slice(13, 16), slice(7, 13)
_TURNS, _ODOMETER, _STATED = slice(16, 24), slice(24, 27), slice(27, 29)
_ROWS = 29


class Window(NamedTuple):
    """Past predictions, newest first, n of them.

    Attributes:
        rows: Shape (..., 29, n), what is known of each: see the properties.
        is_valid: Shape (..., 1, n), 1 where there is a prediction, else 0.
    """

    rows: Array
    is_valid: Array

    @property
    def rotation(self) -> Array:
        """world_from_vio by each prediction, quaternions xyzw, shape (..., 4, n)."""
        return self.rows[..., _ROTATION, :]

    @property
    def place_m(self) -> Array:
        """The predicted positions in the world, shape (..., 3, n)."""
        return self.rows[..., _PLACE, :]

    @property
    def gaze(self) -> Array:
        """The predicted viewing directions in the world, shape (..., 3, n)."""
        return self.rows[..., _GAZE, :]

    @property
    def vio_place_m(self) -> Array:
        """Where the tracker was, shape (..., 3, n)."""
        return self.rows[..., _VIO_PLACE, :]

    @property
    def vio_gaze(self) -> Array:
        """The viewing directions in the tracking world, shape (..., 3, n)."""
        return self.rows[..., _VIO_GAZE, :]

    @property
    def turns(self) -> Array:
        """The predicted and the tracker's orientations, quaternions xyzw, shape (..., 2, 4, n)."""
        both = self.rows[..., _TURNS, :]
        return namespace(both).reshape(both, (*both.shape[:-2], 2, 4, both.shape[-1]))

    @property
    def odometer(self) -> Array:
        """Its readings then, shape (..., 3, n); see `odometer.Odometer`."""
        return self.rows[..., _ODOMETER, :]

    @property
    def stated(self) -> Array:
        """The variances that the regressor states, over the usual ones, shape (..., 2, n)."""
        return self.rows[..., _STATED, :]

    def push(self, prediction: Array, stated: Array, moves: Mask) -> Window:
        """Put a prediction in front.

        Args:
            prediction: See `new_prediction`.
            stated: See `stated`, of the prediction, shape (..., 2, 1).
            moves: See `moving`.
        """
        xp = namespace(prediction)
        first = xp.ones_like(self.is_valid[..., :1])
        row = xp.concat([prediction, stated], axis=-2)
        return Window(pushed(self.rows, row, moves), pushed(self.is_valid, first, moves))

    def moving(self, length_m: Array, length_rad: float, distance: float, worst: float) -> Mask:
        """The places whose content moves on by one for a new prediction, shape (..., 1, n).

        The recent ones always do. The older ones do if the oldest recent one's view is new
        beside the newest older one's; else that recent one is dropped.

        Args:
            length_m: Motion after which a view is another one, shape (..., 1, 1).
            length_rad: Turn after which it is.
            distance: In these lengths, from which on it is worth keeping.
            worst: Stated variance over the usual one, from which on it is not.
        """
        leaving, kept = self.rows[..., RECENT - 1 : RECENT], self.rows[..., RECENT : RECENT + 1]
        moved = leaving[..., _VIO_VIEW, :] - kept[..., _VIO_VIEW, :]
        parts = constant(_VIEW_PARTS, moved) @ (moved * moved)
        gap2 = parts[..., :1, :] / length_rad**2 + parts[..., 1:, :] / length_m**2
        is_valid = self.is_valid > 0
        is_first = ~is_valid[..., RECENT : RECENT + 1]
        is_novel = (is_first | (gap2 > distance**2)) & is_valid[..., RECENT - 1 : RECENT]
        is_novel = is_novel & (largest(leaving[..., _STATED, :]) < worst)
        return is_novel | (constant(is_among_newest(is_valid.shape[-1], RECENT), moved) > 0)


def pushed(values: Array, first: Array, moves: Mask) -> Array:
    """Values of predictions, with a first one in front, moved on where `moves` says so."""
    xp = namespace(values)
    return xp.where(moves, xp.concat([first, values[..., :-1]], axis=-1), values)


@cache
def is_among_newest(count: int, newest: int) -> np.ndarray:
    """1 for the newest few of `count` predictions, else 0, shape (count,)."""
    return (np.arange(count) < newest) * 1.0


_VIEW_PARTS = np.kron(np.eye(2), np.ones((1, 3)))
"""Sums over viewing direction and position."""


def new_prediction(apr_world_from_cam: Array, vio_from_cam: Array, odometer: Array) -> Array:
    """A column of `Window.rows` but for what is stated, shape (..., 27, 1).

    Args:
        apr_world_from_cam: The prediction, as a column.
        vio_from_cam: The tracker's pose, z up, as a column.
        odometer: Its readings, shape (..., 3, 1).
    """
    (place, turn), (vio_place, vio_turn) = (
        (pose[..., :3, :], pose[..., 3:, :]) for pose in (apr_world_from_cam, vio_from_cam)
    )
    derived = compare(apr_world_from_cam, vio_from_cam)
    parts = [derived, vio_place, place, turn, vio_turn, odometer]
    return namespace(derived).concat(parts, axis=-2)


def empty_window(batch_shape: tuple[int, ...], count: int, like: Array) -> Window:
    """A memory without predictions."""
    is_stated = np.zeros((_ROWS, 1))
    is_stated[_STATED] = 1.0
    rows = zeros((*batch_shape, _ROWS, count), like) + constant(is_stated, like)
    return Window(rows, zeros((*batch_shape, 1, count), like))
