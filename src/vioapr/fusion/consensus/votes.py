"""The memory of method `consensus`: past predictions that differ in view, of a fixed number.

The latest few predictions are all kept. Of older ones only those are kept whose view differs
from that of the one kept before, so that neither standing still nor many predictions a second
push the memory's variety out: predictions from one view share their bias and say little more
than one of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.alignment import push
from vioapr.fusion.types import FrameInput
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import Array, constant, namespace, norm, select, zeros
from vioapr.geometry.rigid import Rigid3, choose

RECENT = 3
"""The newest votes, which are kept whatever their view."""

_TURN_RADIUS_M = 0.3
"""Metres of motion that a turn by one radian counts as: about a phone's distance from its
user's axis."""

_REST_M_PER_S = 0.01
"""Metres of motion that a second counts as: trackers drift at rest too."""

_SUDDEN_M_PER_S, _SUDDEN_FACTOR, _SUDDEN_M = 2.5, 3.0, 0.5
"""A step is a jump of the tracker if it is longer than this speed and this multiple of the
usual speed account for, by this length."""

_SUDDEN_RAD_PER_S, _SUDDEN_RAD = 6.0, 0.2
"""Likewise a turn; people turn a phone as suddenly as they like, but no faster."""

_SPEED_MEMORY = 0.9
"""Weight of the old usual speed at every step."""


class Odometer(NamedTuple):
    """How far the tracker has come, as a measure of how much it may have drifted; shape (...).

    Attributes:
        motion_m: Metres moved, turns included.
        jumps_m2: Sum of squares of steps that no hand-held camera makes, m^2.
        jumps_rad2: Likewise of their turns, rad^2.
    """

    motion_m: Array
    jumps_m2: Array
    jumps_rad2: Array

    def since(self, earlier: Odometer) -> Odometer:
        """What was added since earlier readings."""
        return Odometer(*(now - then for now, then in zip(self, earlier, strict=True)))

    def advance(self, seconds: Array, step: Rigid3, speed_m_s: Array) -> Odometer:
        """After a step of the tracker, cam_from_cam, that took some seconds.

        Args:
            seconds: Shape (...).
            step: Of the tracker.
            speed_m_s: The usual speed: see `usual_speed`.
        """
        xp = namespace(seconds)
        nothing = xp.zeros_like(seconds)
        distance, turn = norm(step.translation_m), quaternion.angle_rad(step.quat_xyzw)
        jumps = distance > _longest_step_m(seconds, speed_m_s)
        jumps = jumps | (turn > _SUDDEN_RAD_PER_S * seconds + _SUDDEN_RAD)
        # Nothing of a step that jumped can be trusted, neither its way nor its turn.
        jump_m, jump_rad = (xp.where(jumps, size, nothing) for size in (distance, turn))
        moved = distance + _TURN_RADIUS_M * turn + _REST_M_PER_S * seconds
        return Odometer(
            self.motion_m + moved, self.jumps_m2 + jump_m**2, self.jumps_rad2 + jump_rad**2
        )


def _longest_step_m(seconds: Array, speed_m_s: Array) -> Array:
    return (_SUDDEN_M_PER_S + _SUDDEN_FACTOR * speed_m_s) * seconds + _SUDDEN_M


def usual_speed(speed_m_s: Array, seconds: Array, step: Rigid3) -> Array:
    """The running average of the speed, m/s, in which a jump counts as a fast step only."""
    xp = namespace(seconds)
    way = xp.minimum(norm(step.translation_m), _longest_step_m(seconds, speed_m_s))
    has_passed = seconds > 0
    speed = way / xp.where(has_passed, seconds, xp.ones_like(seconds))
    # Per step, not per second: walks differ in rate, but jumps are told by a few steps.
    mixed = _SPEED_MEMORY * speed_m_s + (1 - _SPEED_MEMORY) * speed
    return xp.where(has_passed, mixed, speed_m_s)


class Votes(NamedTuple):
    """Past predictions, newest first, shape (..., n).

    Attributes:
        apr_world_from_cam: The predictions.
        vio_from_cam: The tracker's poses of the same frames, in a z-up tracking world.
        odometer: Its readings then.
        is_valid: 1 where there is a vote, else 0.
    """

    apr_world_from_cam: Rigid3
    vio_from_cam: Rigid3
    odometer: Odometer
    is_valid: Array

    def ages(self, now: Odometer) -> Odometer:
        """What the odometer has read since each vote, shape (..., n)."""
        return Odometer(*(reading[..., None] for reading in now)).since(self.odometer)

    def add(self, frame: FrameInput, odometer: Odometer, keeps_oldest_recent: Array) -> Votes:
        """Put a frame in front.

        Args:
            frame: With prediction and tracking.
            odometer: Its readings.
            keeps_oldest_recent: Shape (...), whether the oldest of the recent votes goes on to
                the older ones, or is dropped.
        """
        one = namespace(self.is_valid).ones_like(self.is_valid[..., 0])
        readings = zip(self.odometer, odometer, strict=True)
        return Votes(
            _push(self.apr_world_from_cam, frame.apr_world_from_cam, keeps_oldest_recent),
            _push(self.vio_from_cam, frame.vio_from_cam, keeps_oldest_recent),
            Odometer(*(_push_scalar(old, new, keeps_oldest_recent) for old, new in readings)),
            _push_scalar(self.is_valid, one, keeps_oldest_recent),
        )


def _push(buffer: Rigid3, pose: Rigid3, keeps: Array) -> Rigid3:
    recent = buffer.at((..., slice(0, RECENT), slice(None)))
    older = buffer.at((..., slice(RECENT, None), slice(None)))
    leaving = buffer.at((..., RECENT - 1, slice(None)))
    older = choose(keeps[..., None], push(older, leaving), older)
    xp = namespace(keeps)
    return Rigid3(*(xp.concat(p, axis=-2) for p in zip(push(recent, pose), older, strict=True)))


def _push_scalar(buffer: Array, value: Array, keeps: Array) -> Array:
    xp = namespace(buffer)
    recent, older = buffer[..., :RECENT], buffer[..., RECENT:]
    moved = xp.concat([recent[..., -1:], older[..., :-1]], axis=-1)
    return xp.concat([value[..., None], recent[..., :-1], select(keeps, moved, older)], axis=-1)


def empty_votes(batch_shape: tuple[int, ...], count: int, like: Array) -> Votes:
    """A memory without votes."""
    shape = (*batch_shape, count)
    return Votes(
        Rigid3.identity(shape, like=like),
        Rigid3.identity(shape, like=like),
        Odometer(*(zeros(shape, like) for _ in range(3))),
        zeros(shape, like),
    )


class ViewGaps(NamedTuple):
    """How much views differ, shape (...).

    Attributes:
        distance_m2: Squared distance, m^2.
        chord2: Squared distance of the viewing directions on the unit sphere: about the squared
            angle in rad. Turns about the viewing direction do not count.
    """

    distance_m2: Array
    chord2: Array

    def normalized(self, length_m: Array | float, length_rad: float) -> Array:
        """Squared distance in correlation lengths."""
        return self.distance_m2 / length_m**2 + self.chord2 / length_rad**2


def view_gaps(left: Rigid3, right: Rigid3) -> ViewGaps:
    """Between cameras in one tracking world; the shapes are broadcast."""
    moved = left.translation_m - right.translation_m
    turned = viewing_direction(left) - viewing_direction(right)
    xp = namespace(moved)
    return ViewGaps(xp.sum(moved * moved, axis=-1), xp.sum(turned * turned, axis=-1))


def view_gaps_within(places_m: Array, directions: Array) -> ViewGaps:
    """Between all pairs of n cameras, shapes (..., n, 3) to (..., n, n)."""
    places_m = places_m - places_m[..., :1, :]
    return ViewGaps(squared_distances(places_m), squared_distances(directions))


def squared_distances(points: Array) -> Array:
    """Between all pairs, shape (..., n, 3) to (..., n, n); best for points near the origin."""
    xp = namespace(points)
    if points.dtype != xp.float64:  # the product below would cancel half of the few digits
        gaps = points[..., :, None, :] - points[..., None, :, :]
        return xp.sum(gaps * gaps, axis=-1)
    squares = xp.sum(points * points, axis=-1, keepdims=True)
    ones = xp.ones_like(squares)
    # |a|^2 + |b|^2 - 2 a b as one product: a pass over the pairs instead of four.
    left = xp.concat([squares, ones, -2 * points], axis=-1)
    right = xp.concat([ones, squares, points], axis=-1)
    distances = xp.matmul(left, xp.matrix_transpose(right))
    return xp.maximum(distances, xp.zeros_like(distances))


def viewing_direction(target_from_cam: Rigid3) -> Array:
    """The camera's z axis, shape (..., 3)."""
    forward = constant(np.array([0.0, 0.0, 1.0]), target_from_cam.translation_m)
    return quaternion.rotate(target_from_cam.quat_xyzw, forward)
