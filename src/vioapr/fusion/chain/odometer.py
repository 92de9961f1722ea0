"""How far the tracker has come since, as a measure of how much it may have drifted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.types import FrameInput
from vioapr.geometry.arrays import Array, Mask, constant, namespace, zeros

_TURN_RADIUS_M = 0.3
"""Metres of motion that a turn by one radian counts as: about a phone's distance from its
user's axis."""

_REST_M_PER_S, _LOST_M_PER_S = 0.01, 1.0
"""Metres of motion that a second counts as: trackers drift at rest too, and who walks on while
the tracker is lost may come back displaced by that."""

_PAUSE_S = 2.0
"""Between frames; a longer one is as if the tracker was lost."""

_SUDDEN_M_PER_S, _SUDDEN_FACTOR, _SUDDEN_M = 2.5, 3.0, 0.5
"""A step is a jump of the tracker if it is longer than this speed and this multiple of the
usual speed account for, by this length."""

_SUDDEN_RAD_PER_S, _SUDDEN_RAD, _MOST_RAD = 6.0, 0.2, 2.0
"""The same of a turn, and at most so much between two frames; people turn a phone as suddenly as
they like, but no faster."""

_DOUBT_RAD2, _DOUBT_M2 = 0.03, 1.0
"""Squared jump from which on the tracker's world may be another one: 10 degrees, 1 m."""

_SPEED_MEMORY = 0.9
"""Weight of the old usual speed at every step."""

_FIRST_SPEED_M_S = 1.0
"""Usual speed, until the tracker tells."""

_POSE_PARTS = np.kron(np.eye(2), np.ones((1, 4)))[:, 1:]
"""Sums over position and quaternion."""


class Odometer(NamedTuple):
    """What is remembered of the tracker, shape (..., 1, 1) unless said otherwise.

    Attributes:
        vio_from_cam: Of the last tracked frame: position, then quaternion, shape (..., 7, 1).
        timestamp_s: Of that frame.
        has_begun: Whether there was one in this tracking world.
        is_lost: Whether frames without tracking have come since.
        speed_m_s: The usual speed, in which a jump counts as a fast step only.
        readings: Shape (..., 3, 1): metres moved, turns and time included; the sums of squares
            of steps that no hand-held camera makes, of their turns in rad^2 and of their ways
            in m^2.
    """

    vio_from_cam: Array
    timestamp_s: Array
    has_begun: Mask
    is_lost: Mask
    speed_m_s: Array
    readings: Array

    def follow(self, frame: FrameInput, pose: Array) -> Odometer:
        """After a frame. The way over a loss counts when the tracker is back.

        Args:
            frame: The frame.
            pose: Its vio_from_cam as a column.
        """
        xp = namespace(pose)
        tracked, is_new = (
            flags[..., None, None] for flags in (frame.tracking_ok, frame.tracking_reset)
        )
        now = frame.timestamp_s[..., None, None]
        continues = self.has_begun & ~is_new
        moves = xp.astype(continues & tracked, pose.dtype)
        seconds = (now - self.timestamp_s) * moves
        distance, turn = _step_sizes(pose - self.vio_from_cam, moves)
        longest = (_SUDDEN_M_PER_S + _SUDDEN_FACTOR * self.speed_m_s) * seconds + _SUDDEN_M
        widest = xp.minimum(_SUDDEN_RAD_PER_S * seconds + _SUDDEN_RAD, _MOST_RAD)
        jumps = (distance > longest) | (turn > widest)
        # Nothing of a step that jumped can be trusted, neither its way nor its turn.
        jump = xp.astype(jumps, pose.dtype)
        is_unseen = self.is_lost | (seconds > _PAUSE_S)
        unseen = _REST_M_PER_S + _LOST_M_PER_S * xp.astype(is_unseen, pose.dtype)
        moved = distance + _TURN_RADIUS_M * turn + unseen * seconds
        step = xp.concat([moved, jump * turn**2, jump * distance**2], axis=-2)
        speed = _usual_speed(self.speed_m_s, seconds, xp.minimum(distance, longest))
        return Odometer(
            xp.where(tracked, pose, self.vio_from_cam),
            xp.where(tracked, now, self.timestamp_s),
            continues | tracked,
            ~tracked,
            speed,
            self.readings + step,
        )


def jumped(before: Odometer, after: Odometer) -> Mask:
    """Whether the last step may have led into another tracking world, shape (..., 1, 1)."""
    step = after.readings - before.readings
    return (step[..., 1:2, :] > _DOUBT_RAD2) | (step[..., 2:, :] > _DOUBT_M2)


def new_odometer(batch_shape: tuple[int, ...], like: Array) -> Odometer:
    """Before the first frame."""

    def nothing(rows: int = 1) -> Array:
        return zeros((*batch_shape, rows, 1), like)

    speed = nothing() + _FIRST_SPEED_M_S
    return Odometer(nothing(7), nothing(), nothing() > 0, nothing() > 0, speed, nothing(3))


def _step_sizes(difference: Array, moves: Array) -> tuple[Array, Array]:
    """Way in m and turn in rad of the difference of two poses' columns."""
    xp = namespace(difference)
    squares = constant(_POSE_PARTS, difference) @ (difference * difference) * moves
    # Of the two quaternions of a rotation, the nearer one: |p + q|^2 = 4 - |p - q|^2.
    chord2 = xp.minimum(squares[..., 1:, :], 4 - squares[..., 1:, :])
    chord2 = xp.maximum(chord2, 0.0)
    # Four times the arc sine of half the chord; not all of a phone's runtimes have that.
    return xp.sqrt(squares[..., :1, :]), 4 * xp.atan(xp.sqrt(chord2 / (4 - chord2)))


def _usual_speed(speed_m_s: Array, seconds: Array, way_m: Array) -> Array:
    xp = namespace(seconds)
    has_passed = seconds > 0
    speed = way_m / xp.where(has_passed, seconds, xp.ones_like(seconds))
    # Per step, not per second: walks differ in rate, but jumps are told by a few steps.
    mixed = _SPEED_MEMORY * speed_m_s + (1 - _SPEED_MEMORY) * speed
    return xp.where(has_passed, mixed, speed_m_s)
