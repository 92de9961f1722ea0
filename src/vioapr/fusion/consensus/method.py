"""The step of method `consensus`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vioapr.fusion.alignment import hide_unless
from vioapr.fusion.consensus.fit import Fit, fit_position, fit_rotation, view_shares
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.trust import (
    Rates,
    Trust,
    drift_rates,
    learn,
    no_trust_yet,
    notice_scatter,
)
from vioapr.fusion.consensus.votes import (
    RECENT,
    Odometer,
    Votes,
    empty_votes,
    usual_speed,
    view_gaps,
    view_gaps_within,
    viewing_direction,
)
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry import frames, quaternion
from vioapr.geometry.arrays import (
    Array,
    constant,
    holds_everywhere,
    holds_nowhere,
    namespace,
    norm,
    select,
    zeros,
)
from vioapr.geometry.rigid import Rigid3, between, choose

_NOVELTY = 0.8
"""Distance of views, in correlation lengths, from which an older vote is worth keeping."""

_VIEW_RAD = 0.26
"""Turn of the viewing direction after which the regressor's bias is another one."""

_COMMON_BIAS_M, _COMMON_BIAS_RAD = 0.5, 0.2
"""Share of the errors' variance that all views of a place have in common, and that no
comparison of votes can show."""

_SCALE_M, _SCALE_RAD = 0.75, 0.65
"""From the standard deviations to the scales of the heavy-tailed distribution that is stated:
Student's t with two degrees of freedom (docs/accuracy.md, Calibration)."""

_FIRST_SPEED_M_S = 1.0
"""Usual speed, until the tracker tells."""

_GRAVITY_RAD = 0.004
"""Error of a tracker's gravity, rad."""


class Anchor(NamedTuple):
    """The latest estimate at a prediction, from which VIO carries on.

    Attributes:
        world_from_cam: The estimate.
        vio_from_cam: The tracker's pose then, z up.
        is_known: Whether there is one.
        variance_m2: Of the position, per axis of the world, shape (..., 3).
        variance_rad2: Of the orientation, about each axis of the world.
        drift_m2: Variance that a metre of motion adds to each axis.
        drift_rad2: Likewise to the heading.
        odometer: Its readings then.
    """

    world_from_cam: Rigid3
    vio_from_cam: Rigid3
    is_known: Array
    variance_m2: Array
    variance_rad2: Array
    drift_m2: Array
    drift_rad2: Array
    odometer: Odometer


class ConsensusState(NamedTuple):
    """What the method remembers; its size does not depend on the walk's length.

    Attributes:
        votes: Past predictions.
        odometer: Its readings now.
        speed_m_s: Usual speed of the tracker.
        vio_from_cam: The tracker's pose of the last tracked frame, z up.
        timestamp_s: Of that frame.
        was_tracked: Whether the last frame was tracked.
        trust: What has been learned of noise and drift.
        anchor: The latest estimate.
    """

    votes: Votes
    odometer: Odometer
    speed_m_s: Array
    vio_from_cam: Rigid3
    timestamp_s: Array
    was_tracked: Array
    trust: Trust
    anchor: Anchor


def init(params: ConsensusParams, batch_shape: tuple[int, ...], like: Array) -> ConsensusState:
    """The state before the first frame."""

    def nothing(*axes: int) -> Array:
        return zeros((*batch_shape, *axes), like)

    def identity() -> Rigid3:
        return Rigid3.identity(batch_shape, like=like)

    def at_start() -> Odometer:
        return Odometer(nothing(), nothing(), nothing())

    return ConsensusState(
        empty_votes(batch_shape, int(params.votes), like),
        at_start(),
        nothing() + _FIRST_SPEED_M_S,
        identity(),
        nothing(),
        nothing() > 0,
        no_trust_yet(batch_shape, like),
        Anchor(
            identity(),
            identity(),
            nothing() > 0,
            nothing(3),
            nothing(3),
            nothing(),
            nothing(),
            at_start(),
        ),
    )


def step(
    params: ConsensusParams, state: ConsensusState, frame: FrameInput
) -> tuple[ConsensusState, Estimate]:
    """One frame: its prediction becomes a vote; without one, VIO carries the last estimate on."""
    upright = frame._replace(vio_from_cam=frames.z_up_from_y_up(frame.vio_from_cam))
    state = _follow_tracker(state, upright)
    is_vote = frame.has_apr & frame.tracking_ok
    if not holds_nowhere(is_vote):
        state = _select_state(is_vote, _add_vote(params, state, upright), state)
    return state, _estimate(state, upright, frame.vio_from_cam, is_vote)


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
    xp = namespace(frame.timestamp_s)
    moves = frame.keeps_world & state.was_tracked
    seconds = frame.timestamp_s - state.timestamp_s
    seconds = select(moves, seconds, xp.zeros_like(seconds))
    motion = between(state.vio_from_cam, frame.vio_from_cam)
    still = Rigid3.identity(frame.timestamp_s.shape, like=state.timestamp_s)
    motion = choose(moves, motion, still)
    valid = state.votes.is_valid
    return state._replace(
        votes=state.votes._replace(is_valid=select(moves, valid, xp.zeros_like(valid))),
        odometer=state.odometer.advance(seconds, motion, state.speed_m_s),
        speed_m_s=usual_speed(state.speed_m_s, seconds, motion),
        vio_from_cam=frame.vio_from_cam,
        timestamp_s=frame.timestamp_s,
        was_tracked=frame.tracking_ok,
        anchor=state.anchor._replace(is_known=state.anchor.is_known & moves),
    )


def _add_vote(params: ConsensusParams, state: ConsensusState, frame: FrameInput) -> ConsensusState:
    """Take a prediction in and estimate anew."""
    trust = state.trust
    length_m = _view_length_m(trust)
    votes, is_new_view = _remember(state, frame, length_m)
    ages = votes.ages(state.odometer)
    directions = viewing_direction(votes.vio_from_cam)
    gaps = view_gaps_within(votes.vio_from_cam.translation_m, directions)
    shares = view_shares(params, votes.is_valid, gaps, length_m, _VIEW_RAD)
    rates = drift_rates(params, trust)
    tilts = (rates.tilt, rates.heading)
    rotation = fit_rotation(params, votes, ages, shares, tilts, trust.scatter_rad, trust.noise_rad)
    position = fit_position(
        params,
        votes,
        directions,
        frame.vio_from_cam,
        ages,
        shares,
        rates.position,
        rotation,
        trust.scatter_m,
        trust.noise_m,
    )
    trust = notice_scatter(trust, rotation, position)
    trust = learn(params, trust, votes, gaps, ages, rotation, position, is_new_view)
    anchor = _anchor(params, state, frame, trust, rates, rotation, position)
    return state._replace(votes=votes, trust=trust, anchor=anchor)


def _view_length_m(trust: Trust) -> Array:
    """Motion after which the regressor's bias is another one.

    Regressors err in proportion to the place's size, and their bias varies with it too.
    """
    return 0.3 + 3.0 * trust.scatter_m


def _remember(state: ConsensusState, frame: FrameInput, length_m: Array) -> tuple[Votes, Array]:
    """Add the frame's vote; the oldest recent one stays if its view is a new one."""
    votes = state.votes
    leaving, kept = (votes.vio_from_cam.at((..., row, slice(None))) for row in (RECENT - 1, RECENT))
    novelty = view_gaps(leaving, kept).normalized(length_m, _VIEW_RAD)
    is_novel = (votes.is_valid[..., RECENT] == 0) | (novelty > _NOVELTY**2)
    is_novel = is_novel & (votes.is_valid[..., RECENT - 1] > 0)
    return votes.add(frame, state.odometer, is_novel), is_novel


def _anchor(
    params: ConsensusParams,
    state: ConsensusState,
    frame: FrameInput,
    trust: Trust,
    rates: Rates,
    rotation: Fit,
    position: Fit,
) -> Anchor:
    pose = Rigid3(position.mean, quaternion.multiply(rotation.mean, frame.vio_from_cam.quat_xyzw))
    variances = [
        (noise**2)[..., None] * (common + (1 - common) / fit.independent) + fit.doubt[..., None]
        for noise, common, fit in (
            (trust.noise_m, _COMMON_BIAS_M, position),
            (trust.noise_rad, _COMMON_BIAS_RAD, rotation),
        )
    ]
    if params.gravity == "known":
        keeps = constant(np.array([0.0, 0.0, 1.0]), trust.noise_rad)
        variances[1] = variances[1] * keeps + (1 - keeps) * _GRAVITY_RAD**2
    drift_rad2, drift_m2 = rates.variances(trust)
    return Anchor(
        pose,
        frame.vio_from_cam,
        frame.tracking_ok,
        variances[0],
        variances[1],
        drift_m2,
        drift_rad2,
        state.odometer,
    )


def _estimate(
    state: ConsensusState, frame: FrameInput, vio_from_cam: Rigid3, is_vote: Array
) -> Estimate:
    """The anchor, carried on by VIO; without tracking, the raw prediction."""
    xp = namespace(frame.timestamp_s)
    anchor = state.anchor
    is_placed = frame.tracking_ok & anchor.is_known
    is_raw = frame.has_apr & ~frame.tracking_ok
    placed = anchor.world_from_cam @ between(anchor.vio_from_cam, frame.vio_from_cam)
    status = xp.astype(is_raw, xp.int32) * int(Status.PREDICTED)
    status = xp.where(is_placed, status * 0 + int(Status.TRACKED), status)
    status = xp.where(is_vote, status * 0 + int(Status.OPTIMIZED), status)
    sigma_m, sigma_rad = _sigmas(state, frame, is_placed, is_placed | is_raw)
    degrees = 180 / np.pi
    return Estimate(
        hide_unless(is_placed | is_raw, choose(is_raw, frame.apr_world_from_cam, placed)),
        hide_unless(is_placed, placed @ vio_from_cam.inverse()),
        status,
        status * 0,
        _root_mean_square(sigma_m),
        _root_mean_square(sigma_rad) * degrees,
        sigma_m,
        sigma_rad * degrees,
    )


def _root_mean_square(sigmas: Array) -> Array:
    xp = namespace(sigmas)
    return xp.sqrt(xp.mean(sigmas * sigmas, axis=-1))


def _sigmas(
    state: ConsensusState, frame: FrameInput, is_placed: Array, is_known: Array
) -> tuple[Array, Array]:
    """Per axis, in m and rad: the anchor's, and what VIO may have drifted since."""
    xp = namespace(frame.timestamp_s)
    anchor, trust = state.anchor, state.trust
    since = state.odometer.since(anchor.odometer)
    rad2 = anchor.drift_rad2 * since.motion_m + since.jumps_rad2
    variance_rad2 = anchor.variance_rad2 + rad2[..., None]
    lever_m = norm(frame.vio_from_cam.translation_m - anchor.vio_from_cam.translation_m)
    m2 = anchor.drift_m2 * since.motion_m + since.jumps_m2
    m2 = m2 + xp.max(variance_rad2, axis=-1) * lever_m**2
    variance_m2 = anchor.variance_m2 + m2[..., None]
    nan = constant(float("nan"), trust.noise_m)

    def sigma(variance: Array, noise: Array, scale: float) -> Array:
        alone = (noise**2)[..., None] * xp.ones_like(variance)
        value = scale * xp.sqrt(select(is_placed, variance, alone))
        return select(is_known, value, xp.zeros_like(value) + nan)

    return (
        sigma(variance_m2, trust.noise_m, _SCALE_M),
        sigma(variance_rad2, trust.noise_rad, _SCALE_RAD),
    )


METHOD = Method(
    name="consensus",
    summary="robust consensus of past predictions carried by VIO, which estimates VIO's drift",
    params_type=ConsensusParams,
    init=init,
    step=step,
)
