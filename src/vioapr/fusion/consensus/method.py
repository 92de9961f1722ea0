"""The step of method `consensus`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vioapr.fusion.consensus.anchor import (
    Anchor,
    no_anchor,
    stated_scales,
    variances_of,
)
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.position import fit_position
from vioapr.fusion.consensus.robust import NEWEST, Ballot, total, typical_of
from vioapr.fusion.consensus.rotation import fit_rotation
from vioapr.fusion.consensus.tracker import Tracker, new_tracker
from vioapr.fusion.consensus.trust import Trust, learn, no_trust_yet
from vioapr.fusion.consensus.views import VIEW_RAD, view_length_m, view_shares
from vioapr.fusion.consensus.votes import Votes, empty_votes, new_vote
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry import frames, quaternion
from vioapr.geometry.arrays import (
    Array,
    constant,
    holds_everywhere,
    holds_nowhere,
    namespace,
    select,
)
from vioapr.geometry.rigid import Rigid3

_NOVELTY = 0.8
"""Distance of views, in correlation lengths, from which an older vote is worth keeping."""


class ConsensusState(NamedTuple):
    """What the method remembers; its size does not depend on the walk's length.

    Attributes:
        votes: Past predictions.
        tracker: Its last pose, speed and odometer.
        trust: What has been learned of noise and drift.
        anchor: The latest estimate.
    """

    votes: Votes
    tracker: Tracker
    trust: Trust
    anchor: Anchor


def init(params: ConsensusParams, batch_shape: tuple[int, ...], like: Array) -> ConsensusState:
    """The state before the first frame."""
    return ConsensusState(
        empty_votes(batch_shape, int(params.votes), like),
        new_tracker(batch_shape, like),
        no_trust_yet(params, batch_shape, like),
        no_anchor(batch_shape, like),
    )


def step(
    params: ConsensusParams, state: ConsensusState, frame: FrameInput
) -> tuple[ConsensusState, Estimate]:
    """One frame: its prediction becomes a vote; without one, VIO carries the last estimate on."""
    frame = frame._replace(vio_from_cam=frames.z_up_from_y_up(frame.vio_from_cam))
    state = _follow_tracker(state, frame)
    is_vote = frame.has_apr & frame.tracking_ok
    if not holds_nowhere(is_vote):
        state = _select_state(is_vote, _add_vote(params, state, frame), state)
    return state, _estimate(state, frame, is_vote)


def _select_state(condition: Array, if_true: Any, if_false: Any) -> Any:
    """Elementwise choice between states: nested tuples of arrays."""
    if holds_everywhere(condition):
        return if_true
    if not isinstance(if_true, tuple):
        return select(condition, if_true, if_false)
    parts = (_select_state(condition, a, b) for a, b in zip(if_true, if_false, strict=True))
    return type(if_true)(*parts)


def _follow_tracker(state: ConsensusState, frame: FrameInput) -> ConsensusState:
    """Read the odometer on; forget the votes of a tracking world that is no more."""
    tracker, same_world = state.tracker.follow(frame)
    valid = state.votes.is_valid
    kept = valid * namespace(valid).astype(same_world, valid.dtype)
    return state._replace(
        votes=state.votes._replace(is_valid=kept),
        tracker=tracker,
        anchor=state.anchor._replace(is_known=state.anchor.is_known & same_world),
    )


def _add_vote(params: ConsensusParams, state: ConsensusState, frame: FrameInput) -> ConsensusState:
    """Take a prediction in and estimate anew."""
    xp = namespace(frame.timestamp_s)
    trust, odometer = state.trust, state.tracker.odometer
    length_m = view_length_m(trust.scatter[..., 1:, :])
    is_new_view = state.votes.is_novel(length_m, VIEW_RAD, _NOVELTY)
    votes = state.votes.add(_vote_of(frame, odometer), is_new_view)
    ages = odometer - votes.odometer
    ballots = _ballots(trust, votes, ages, view_shares(params, votes, length_m))
    rotation, is_upright = fit_rotation(params, ballots[0])
    vio_place_m = frame.vio_from_cam.translation_m[..., None]
    matrix = quaternion.to_matrix(rotation.mean[..., 0])
    position = fit_position(params, ballots[1], matrix, vio_place_m, rotation)
    fits = (rotation, position)
    learned = learn(params, trust, votes, ages, fits, is_upright, is_new_view)
    anchor = Anchor(
        rotation.mean,
        position.mean,
        vio_place_m,
        xp.ones_like(is_upright),
        variances_of(params, learned, fits),
        learned._replace(rates=trust.rates).drifts,
        odometer,
    )
    return state._replace(votes=votes, trust=learned, anchor=anchor)


def _vote_of(frame: FrameInput, odometer: Array) -> Array:
    apr, vio = frame.apr_world_from_cam, frame.vio_from_cam
    xp = namespace(odometer)
    world_from_vio = quaternion.multiply(apr.quat_xyzw, quaternion.inverse(vio.quat_xyzw))
    return new_vote(
        world_from_vio[..., None],
        apr.translation_m[..., None],
        _gaze(apr),
        vio.translation_m[..., None],
        _gaze(vio),
        odometer,
        xp.ones_like(odometer[..., :2, :]),
    )


def _gaze(target_from_cam: Rigid3) -> Array:
    """The viewing direction, the camera's z axis, shape (..., 3, 1)."""
    return quaternion.to_matrix(target_from_cam.quat_xyzw)[..., 2:]


def _ballots(trust: Trust, votes: Votes, ages: Array, shares: Array) -> tuple[Ballot, Ballot]:
    """What weighs the votes, for orientation and for position."""
    xp = namespace(shares)
    jumps = ages[..., 1:, :] / (trust.noise * trust.noise)
    fresh = votes.is_valid * xp.astype(jumps < 1, jumps.dtype)
    # Times the number of views: all votes from before a jump err together, and together they
    # must not outweigh one vote from after it.
    steps = votes.stated + jumps * total(shares)
    turns = xp.concat([steps[..., :1, :], steps[..., :1, :]], axis=-2)
    drifts = trust.rates * ages[..., :1, :]
    judged, newest = typical_of(fresh), typical_of(votes.is_valid[..., :NEWEST])
    bases = (turns + drifts[..., :2, :], steps[..., 1:, :] + drifts[..., 2:, :])
    return tuple(
        Ballot(
            votes,
            shares,
            bases[i],
            judged.row(i),
            newest,
            trust.scatter[..., i : i + 1, :],
            trust.noise[..., i : i + 1, :],
        )
        for i in range(2)
    )


def _estimate(state: ConsensusState, frame: FrameInput, is_vote: Array) -> Estimate:
    """The anchor, carried on by VIO; without tracking, the raw prediction."""
    xp = namespace(frame.timestamp_s)
    anchor, apr, vio = state.anchor, frame.apr_world_from_cam, frame.vio_from_cam
    is_placed = (frame.tracking_ok[..., None, None] & anchor.is_known)[..., 0]
    is_raw = (frame.has_apr & ~frame.tracking_ok)[..., None]
    rotation = anchor.world_from_vio[..., 0]
    matrix = quaternion.to_matrix(rotation)
    vio_place_m = vio.translation_m[..., None]
    origin = (anchor.position_m - matrix @ anchor.vio_place_m)[..., 0]
    moved = matrix @ (vio_place_m - anchor.vio_place_m)
    position = (anchor.position_m + moved)[..., 0]
    turned = quaternion.multiply(rotation, vio.quat_xyzw)
    nan = constant(float("nan"), position)
    y_up = quaternion.multiply(rotation, constant(_Z_UP_FROM_Y_UP, rotation))

    def shown(placed: Array, raw: Array) -> Array:
        return xp.where(is_placed, placed, xp.where(is_raw, raw, nan))

    deviations = anchor.sigmas(vio_place_m, state.tracker.odometer)
    raw_or_none = xp.where(is_raw[..., None], state.trust.noise, nan)
    sigmas = stated_scales(xp.where(is_placed[..., None], deviations, raw_or_none))
    sigmas = sigmas * constant(_RADIANS_TO_DEGREES, sigmas)
    means = xp.sqrt((sigmas * sigmas) @ constant(np.full((3, 1), 1 / 3), sigmas))
    status = _status(is_placed[..., 0], is_raw[..., 0], is_vote)
    return Estimate(
        Rigid3(shown(position, apr.translation_m), shown(turned, apr.quat_xyzw)),
        Rigid3(xp.where(is_placed, origin, nan), xp.where(is_placed, y_up, nan)),
        status,
        status * 0,
        means[..., 1, 0],
        means[..., 0, 0],
        sigmas[..., 1, :],
        sigmas[..., 0, :],
    )


_Z_UP_FROM_Y_UP = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
_RADIANS_TO_DEGREES = np.array([[180 / np.pi], [1.0]])


def _status(is_placed: Array, is_raw: Array, is_vote: Array) -> Array:
    """Of these three only the first and the last may hold together."""
    xp = namespace(is_vote)
    placed, raw, vote = (xp.astype(one, xp.int32) for one in (is_placed, is_raw, is_vote))
    further = int(Status.OPTIMIZED) - int(Status.TRACKED)
    return placed * int(Status.TRACKED) + vote * further + raw * int(Status.PREDICTED)


METHOD = Method(
    name="consensus",
    summary="robust consensus of past predictions carried by VIO, which estimates VIO's drift",
    params_type=ConsensusParams,
    init=init,
    step=step,
)
