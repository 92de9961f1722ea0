"""The memory of method `consensus`: past predictions that differ in view, of a fixed number.

The latest few predictions are all kept. Of older ones only those are kept whose view differs
from that of the one kept before, so that neither standing still nor many predictions a second
push the memory's variety out: predictions from one view share their bias and say little more
than one of them.

Shapes in this package: votes lie along the last axis, n of them, and what belongs to a walk has
two last axes of its own, so that all of it broadcasts: (..., 1, 1) for a number, (..., 3, 1) for
a vector. What is the same sum for orientation and position is worked out for both at once,
shape (..., 2, ...), orientation first.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.columns import compare
from vioapr.geometry.arrays import Array, Mask, constant, namespace, zeros

RECENT = 3
"""The newest votes, which are kept whatever their view."""

_ROTATION, _GAZE, _PLACE = slice(0, 4), slice(4, 7), slice(13, 16)
_VIO_GAZE, _VIO_PLACE, _VIO_VIEW = slice(7, 10), slice(10, 13), slice(7, 13)
_ODOMETER, _STATED = slice(16, 19), slice(19, 21)
_ROWS = 21


class Votes(NamedTuple):
    """Past predictions, newest first, n of them.

    Attributes:
        rows: Shape (..., 21, n), what is known of each: see the properties.
        is_valid: Shape (..., 1, n), 1 where there is a vote, else 0.
    """

    rows: Array
    is_valid: Array

    @property
    def rotation(self) -> Array:
        """world_from_vio by each vote, quaternions xyzw, shape (..., 4, n)."""
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
    def odometer(self) -> Array:
        """Its readings then, shape (..., 3, n); see `tracker.Tracker`."""
        return self.rows[..., _ODOMETER, :]

    @property
    def stated(self) -> Array:
        """The variances that the regressor states, over the usual ones, shape (..., 2, n)."""
        return self.rows[..., _STATED, :]

    def add(self, vote: Array, is_novel: Mask) -> Votes:
        """Put a vote in front.

        Args:
            vote: See `new_vote`.
            is_novel: Shape (..., 1, 1), whether the oldest of the recent votes goes on to the
                older ones, or is dropped.
        """
        xp = namespace(vote)
        moves = is_novel | (constant(_is_recent(self.is_valid.shape[-1]), vote) > 0)
        pushed = xp.concat([vote, self.rows[..., :-1]], axis=-1)
        first = xp.ones_like(self.is_valid[..., :1])
        valid = xp.concat([first, self.is_valid[..., :-1]], axis=-1)
        return Votes(xp.where(moves, pushed, self.rows), xp.where(moves, valid, self.is_valid))

    def is_novel(self, length_m: Array, length_rad: float, distance: float) -> Mask:
        """Whether the oldest recent vote's view is new beside the newest older one's, (..., 1, 1).

        Args:
            length_m: Motion after which a view is another one, shape (..., 1, 1).
            length_rad: Turn after which it is.
            distance: In these lengths, from which on it is worth keeping.
        """
        leaving, kept = self.rows[..., RECENT - 1 : RECENT], self.rows[..., RECENT : RECENT + 1]
        moved = leaving[..., _VIO_VIEW, :] - kept[..., _VIO_VIEW, :]
        parts = constant(_VIEW_PARTS, moved) @ (moved * moved)
        gap2 = parts[..., :1, :] / length_rad**2 + parts[..., 1:, :] / length_m**2
        is_valid = self.is_valid > 0
        is_first = ~is_valid[..., RECENT : RECENT + 1]
        return (is_first | (gap2 > distance**2)) & is_valid[..., RECENT - 1 : RECENT]


@cache
def _is_recent(count: int) -> np.ndarray:
    return (np.arange(count) < RECENT) * 1.0


_VIEW_PARTS = np.kron(np.eye(2), np.ones((1, 3)))
"""Sums over viewing direction and position."""


def new_vote(
    apr_world_from_cam: Array, vio_from_cam: Array, odometer: Array, stated: Array
) -> Array:
    """One vote, a column of `Votes.rows`, shape (..., 21, 1).

    Args:
        apr_world_from_cam: The prediction, as a column.
        vio_from_cam: The tracker's pose, z up, as a column.
        odometer: Its readings, shape (..., 3, 1).
        stated: See `Votes`, shape (..., 2, 1).
    """
    derived = compare(apr_world_from_cam, vio_from_cam)
    places = [vio_from_cam[..., :3, :], apr_world_from_cam[..., :3, :]]
    return namespace(derived).concat([derived, *places, odometer, stated], axis=-2)


def empty_votes(batch_shape: tuple[int, ...], count: int, like: Array) -> Votes:
    """A memory without votes."""
    is_stated = np.zeros((_ROWS, 1))
    is_stated[_STATED] = 1.0
    rows = zeros((*batch_shape, _ROWS, count), like) + constant(is_stated, like)
    return Votes(rows, zeros((*batch_shape, 1, count), like))
