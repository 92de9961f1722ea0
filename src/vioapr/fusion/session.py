"""A session: one step of a fusion method, with what apps need around it.

A prediction may be of an earlier frame's picture, and content follows corrections without jumping.
Pure and batched like the methods themselves, so that `Localizer`, PyTorch and the exported graph
run the same source.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from vioapr.fusion.easing import EasingParams, EasingState, ease, no_easing
from vioapr.fusion.late import LONGEST_S
from vioapr.fusion.types import Estimate, FrameInput, Method
from vioapr.geometry.arrays import Array, Mask, namespace, zeros
from vioapr.geometry.rigid import Rigid3, between, choose

_NEVER_S = 1e9
"""Later than all times of a session."""


@dataclass(frozen=True)
class Session:
    """What stays the same from frame to frame.

    Attributes:
        method: Of fusion.
        params: Of the method.
        easing: How fast content follows corrections.
    """

    method: Method
    params: Any
    easing: EasingParams = field(default_factory=EasingParams)


class SessionState(NamedTuple):
    """What is remembered from frame to frame.

    Attributes:
        fusion: The method's state.
        easing: Where content was shown.
        world_since_s: Time of the first frame in the tracking world of now, shape (...).
    """

    fusion: Any
    easing: EasingState
    world_since_s: Array


class Picture(NamedTuple):
    """The picture that a prediction is of, if it is not this frame's.

    Attributes:
        timestamp_s: When it was taken, shape (...).
        vio_from_cam: The tracker's pose then; finite, whatever it is where it is not known.
        has_pose: Whether that is known, shape (...).
    """

    timestamp_s: Array
    vio_from_cam: Rigid3
    has_pose: Mask


def begin(session: Session, batch_shape: tuple[int, ...], like: Array) -> SessionState:
    """The state before the first frame.

    Args:
        session: What runs.
        batch_shape: Of the walks.
        like: An array that gives backend and dtype.
    """
    return SessionState(
        session.method.init(session.params, batch_shape, like),
        no_easing(batch_shape, like),
        zeros(batch_shape, like) + _NEVER_S,
    )


def step(
    session: Session, state: SessionState, frame: FrameInput, picture: Picture | None = None
) -> tuple[SessionState, Estimate]:
    """One frame.

    Args:
        session: What runs.
        state: Of the last frame.
        frame: The tracker's pose of now, and the prediction that is ready now.
        picture: That of the prediction; None for this frame's own.
    """
    state = _follow_world(state, frame)
    if picture is not None:
        frame = _as_of_now(state, frame, picture)
    fusion, estimate = session.method.step(session.params, state.fusion, frame)
    return _show(session, state._replace(fusion=fusion), frame, estimate)


def carry(
    session: Session, state: SessionState, frame: FrameInput
) -> tuple[SessionState, Estimate]:
    """One frame without prediction, in every walk: what `step` answers, for less work."""
    state = _follow_world(state, frame)
    method = session.method
    fusion, estimate = (method.carry or method.step)(session.params, state.fusion, frame)
    return _show(session, state._replace(fusion=fusion), frame, estimate)


def _follow_world(state: SessionState, frame: FrameInput) -> SessionState:
    xp = namespace(frame.timestamp_s)
    # After a loss, too: what was known of its poses may be of another world.
    is_new = frame.tracking_reset | (state.world_since_s > frame.timestamp_s)
    since_s = xp.where(is_new, frame.timestamp_s, state.world_since_s)
    return state._replace(world_since_s=xp.where(frame.tracking_ok, since_s, _NEVER_S))


def _as_of_now(state: SessionState, frame: FrameInput, picture: Picture) -> FrameInput:
    """A late prediction, moved on as VIO has moved since; dropped where that is not known."""
    age_s = frame.timestamp_s - picture.timestamp_s
    is_past = age_s > 0
    is_now = ~is_past & ~(age_s < 0)
    is_late = is_past & (age_s <= LONGEST_S) & picture.has_pose & frame.tracking_ok
    is_late = is_late & (picture.timestamp_s >= state.world_since_s)
    moved = frame.apr_world_from_cam @ between(picture.vio_from_cam, frame.vio_from_cam)
    return frame._replace(
        apr_world_from_cam=choose(is_now, frame.apr_world_from_cam, moved),
        has_apr=frame.has_apr & (is_now | is_late),
    )


def _show(
    session: Session, state: SessionState, frame: FrameInput, estimate: Estimate
) -> tuple[SessionState, Estimate]:
    """Let content follow the estimate."""
    easing, eased = ease(
        session.easing,
        state.easing,
        frame.timestamp_s,
        estimate.world_from_vio,
        frame.vio_from_cam,
        frame.tracking_reset,
    )
    return state._replace(easing=easing), estimate._replace(eased=eased)
