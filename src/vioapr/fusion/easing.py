"""Corrections that nobody sees: content follows `world_from_vio` without visible jumps.

What a localizer learns changes `world_from_vio` in steps, and content that is anchored in the map
would jump by them. `display_from_vio` follows at a limited speed, faster where it is far off. It
turns about the camera, so that what is seen from there moves no more than it must. A pure step on
explicit state, like those of the fusion methods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from vioapr.errors import ParameterError
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import Array, Mask, namespace, norm, select, zeros
from vioapr.geometry.rigid import Rigid3, choose

_DEGREES = 180 / math.pi


@dataclass(frozen=True)
class EasingParams:
    """How fast content may be corrected: a least speed, and more in proportion to what is left."""

    least_m_s: float = 0.1
    """Speed of corrections of position, m/s."""
    least_deg_s: float = 2.0
    """Speed of corrections of orientation, deg/s."""
    share_per_s: float = 0.6
    """Share of what is left to correct that is corrected in a second, beside that."""

    def __post_init__(self) -> None:
        for name in ("least_m_s", "least_deg_s", "share_per_s"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise ParameterError(f"{name}: expected a number above 0, got {value}")


class EasingState(NamedTuple):
    """What is remembered from frame to frame.

    Attributes:
        display_from_vio: Of the last frame, shape (...).
        timestamp_s: Of that frame, shape (...).
        is_known: Whether there is one, shape (...).
    """

    display_from_vio: Rigid3
    timestamp_s: Array
    is_known: Mask


class Eased(NamedTuple):
    """Where content is to be shown.

    Attributes:
        display_from_vio: Takes the place of `world_from_vio` for content; NaN until that is known.
        left_m: How far content at the camera is from where it should be, shape (...).
        left_deg: By which angle it is turned.
        is_placed_anew: Whether it has been put in place without easing: at first, and in a new
            tracking world, shape (...).
    """

    display_from_vio: Rigid3
    left_m: Array
    left_deg: Array
    is_placed_anew: Mask


def no_easing(batch_shape: tuple[int, ...], like: Array) -> EasingState:
    """Before the first frame."""
    number = zeros(batch_shape, like)
    return EasingState(Rigid3.identity(batch_shape, like=like), number, number > 0)


def ease(
    params: EasingParams,
    state: EasingState,
    timestamp_s: Array,
    world_from_vio: Rigid3,
    vio_from_cam: Rigid3,
    tracking_reset: Mask,
) -> tuple[EasingState, Eased]:
    """Follow `world_from_vio` by one frame.

    Args:
        params: Speeds.
        state: Of the last frame.
        timestamp_s: Of this frame, shape (...).
        world_from_vio: What the fusion method says; NaN while unknown, which keeps content where
            it is.
        vio_from_cam: The tracker's pose; finite, whatever it is while the tracker is lost.
        tracking_reset: Whether the tracker's world is a new one, shape (...).
    """
    # Not `is_known`: infinities do not come here, and ONNX's IsInf is not everywhere.
    has_target = ~namespace(timestamp_s).isnan(world_from_vio.translation_m[..., 0])
    target = choose(has_target, world_from_vio, state.display_from_vio)
    was_known = state.is_known & ~tracking_reset
    is_placed_anew = has_target & ~was_known
    seconds = timestamp_s - state.timestamp_s
    moved, left_m, left_rad = _move(params, state.display_from_vio, target, vio_from_cam, seconds)
    display = choose(was_known, moved, target)
    is_known = was_known | has_target
    nothing = 0 * left_m
    shown = choose(is_known, display, _nan_like(display))
    eased = Eased(
        shown,
        select(was_known, left_m, nothing),
        select(was_known, left_rad * _DEGREES, nothing),
        is_placed_anew,
    )
    return EasingState(display, timestamp_s, is_known), eased


def _move(
    params: EasingParams, display: Rigid3, target: Rigid3, vio_from_cam: Rigid3, seconds: Array
) -> tuple[Rigid3, Array, Array]:
    """The display, moved towards the target; and what is left, m and rad."""
    camera_m = vio_from_cam.translation_m
    shown_m, wanted_m = display.apply(camera_m), target.apply(camera_m)
    gap_m = wanted_m - shown_m
    turn = quaternion.to_rotvec(
        quaternion.multiply(target.quat_xyzw, quaternion.inverse(display.quat_xyzw))
    )
    distance_m, angle_rad = norm(gap_m), norm(turn)
    step_m = seconds * (params.least_m_s + params.share_per_s * distance_m)
    least_rad_s = params.least_deg_s / _DEGREES
    step_rad = seconds * (least_rad_s + params.share_per_s * angle_rad)
    along, about = _share(step_m, distance_m), _share(step_rad, angle_rad)
    quat = quaternion.multiply(quaternion.from_rotvec(turn * about[..., None]), display.quat_xyzw)
    place_m = shown_m + gap_m * along[..., None]
    # The new rotation about the camera: the camera's own place is what was moved.
    moved = Rigid3(place_m - quaternion.rotate(quat, camera_m), quat)
    return moved, (1 - along) * distance_m, (1 - about) * angle_rad


def _share(step: Array, whole: Array) -> Array:
    """Of the whole that a step makes, at most all of it."""
    is_all = step >= whole
    return select(is_all, 0 * whole + 1, step / (whole + 1e-12))


def _nan_like(pose: Rigid3) -> Rigid3:
    nan = float("nan")
    return Rigid3(pose.translation_m * nan, pose.quat_xyzw * nan)
