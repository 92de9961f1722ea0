"""The step of method `consensus`."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

from vioapr.fusion.consensus.anchor import Anchor, drifts_of, no_anchor, variances_of
from vioapr.fusion.consensus.columns import column, product, rotation_matrix, z_up_column
from vioapr.fusion.consensus.estimate import estimate
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.position import fit_position
from vioapr.fusion.consensus.robust import Ballot, newest, total, typical_of
from vioapr.fusion.consensus.rotation import fit_rotation
from vioapr.fusion.consensus.stated import Usual, nothing_usual
from vioapr.fusion.consensus.tracker import Tracker, new_tracker
from vioapr.fusion.consensus.trust import Trust, learn, no_trust_yet
from vioapr.fusion.consensus.views import VIEW_RAD, view_length_m, view_shares
from vioapr.fusion.consensus.votes import Votes, empty_votes, new_vote
from vioapr.fusion.types import Estimate, FrameInput, Method
from vioapr.geometry.arrays import Array, Mask, holds_everywhere, holds_nowhere, namespace, select

_NOVELTY = 0.8
"""Distance of views, in correlation lengths, from which an older vote is worth keeping."""


class ConsensusState(NamedTuple):
    """What the method remembers; its size does not depend on the walk's length.

    Attributes:
        votes: Past predictions.
        tracker: Its last pose, speed and odometer.
        trust: What has been learned of noise and drift.
        anchor: The latest estimate.
        usual: What the regressor usually states of its errors.
    """

    votes: Votes
    tracker: Tracker
    trust: Trust
    anchor: Anchor
    usual: Usual


def init(params: ConsensusParams, batch_shape: tuple[int, ...], like: Array) -> ConsensusState:
    """The state before the first frame."""
    return ConsensusState(
        empty_votes(batch_shape, int(params.votes), like),
        new_tracker(batch_shape, like),
        no_trust_yet(params, batch_shape, like),
        no_anchor(batch_shape, like),
        nothing_usual(batch_shape, like),
    )


def step(
    params: ConsensusParams, state: ConsensusState, frame: FrameInput
) -> tuple[ConsensusState, Estimate]:
    """One frame: its prediction becomes a vote; without one, VIO carries the last estimate on."""
    vio_from_cam = z_up_column(frame.vio_from_cam)
    state = _follow_tracker(state, frame, vio_from_cam)
    is_vote = frame.has_apr & frame.tracking_ok
    if not holds_nowhere(is_vote):
        voted = _add_vote(params, state, frame)
        state = _select_state(is_vote, voted, state)
    noise, odometer = state.trust.noise, state.tracker.odometer
    return state, estimate(state.anchor, noise, odometer, vio_from_cam, frame)


def _select_state(condition: Mask, if_true: Any, if_false: Any) -> Any:
    """Elementwise choice between states: nested tuples of arrays."""
    if holds_everywhere(condition):
        return if_true
    if not isinstance(if_true, tuple):
        return select(condition, if_true, if_false)
    parts = (_select_state(condition, a, b) for a, b in zip(if_true, if_false, strict=True))
    return type(if_true)(*parts)


def _follow_tracker(
    state: ConsensusState, frame: FrameInput, vio_from_cam: Array
) -> ConsensusState:
    """Read the odometer on; forget the votes of a tracking world that is no more."""
    tracker, same_world = state.tracker.follow(frame, vio_from_cam)
    valid = state.votes.is_valid
    kept = valid * namespace(valid).astype(same_world, valid.dtype)
    return state._replace(
        votes=state.votes._replace(is_valid=kept),
        tracker=tracker,
        anchor=state.anchor._replace(is_known=state.anchor.is_known & same_world),
    )


def _add_vote(params: ConsensusParams, state: ConsensusState, frame: FrameInput) -> ConsensusState:
    """Take a prediction in and estimate anew."""
    apr = column(frame.apr_world_from_cam)
    xp = namespace(apr)
    usual, stated = state.usual.weigh(frame, partial(_surprise, state, apr))
    trust, vio, odometer = state.trust, state.tracker.vio_from_cam, state.tracker.odometer
    length_m = view_length_m(trust.scatter[..., 1:, :])
    is_new_view = state.votes.is_novel(length_m, VIEW_RAD, _NOVELTY)
    vote = new_vote(apr, vio, odometer, stated)
    votes = state.votes.add(vote, is_new_view)
    ages = odometer - votes.odometer
    shares = view_shares(params, votes, length_m)
    ballots = _ballots(trust, votes, ages, shares, usual.belief)
    rotation, is_upright = fit_rotation(params, ballots[0])
    matrix, place_m = rotation_matrix(rotation.mean), vio[..., :3, :]
    position = fit_position(params, ballots[1], matrix, place_m, rotation)
    fits = (rotation, position)
    learned = learn(params, trust, votes, ages, fits, is_upright, is_new_view)
    anchor = Anchor(
        rotation.mean,
        matrix,
        position.mean,
        place_m,
        xp.ones_like(is_upright),
        variances_of(params, learned.noise, fits),
        drifts_of(trust.rates, learned.noise),
        odometer,
    )
    return ConsensusState(votes, state.tracker, learned, anchor, usual)


def _surprise(state: ConsensusState, apr: Array) -> Array:
    """Squared distances of a prediction from the carried estimate, over the noise, (..., 2, 1)."""
    xp = namespace(apr)
    anchor, vio = state.anchor, state.tracker.vio_from_cam
    expected = product(anchor.world_from_vio, vio[..., 3:, :])
    cosine = apr[..., 3:, :].mT @ expected
    moved = apr[..., :3, :] - anchor.carry(vio[..., :3, :])
    squares = xp.concat([4 * (1 - cosine * cosine), moved.mT @ moved], axis=-2)
    return xp.where(anchor.is_known, squares / (state.trust.noise * state.trust.noise), 0.0)


def _ballots(
    trust: Trust, votes: Votes, ages: Array, shares: Array, belief: Array
) -> tuple[Ballot, Ballot]:
    """What weighs the votes, for orientation and for position."""
    xp = namespace(shares)
    jumps = ages[..., 1:, :] / (trust.noise * trust.noise)
    fresh = votes.is_valid * xp.astype(jumps < 1, jumps.dtype)
    # Times the number of views: all votes from before a jump err together, and together they
    # must not outweigh one vote from after it.
    stated = 1 + belief * (votes.stated - 1)
    steps = stated + jumps * total(shares)
    turns = xp.concat([steps[..., :1, :], steps[..., :1, :]], axis=-2)
    drifts = trust.rates * ages[..., :1, :]
    judged, doubting = typical_of(fresh), typical_of(newest(votes.is_valid))
    bases = (turns + drifts[..., :2, :], steps[..., 1:, :] + drifts[..., 2:, :])

    def ballot(row: int) -> Ballot:
        own = (part[..., row : row + 1, :] for part in (trust.scatter, trust.noise))
        return Ballot(votes, shares, bases[row], judged.row(row), doubting, *own)

    return ballot(0), ballot(1)


METHOD = Method(
    name="consensus",
    summary="robust consensus of past predictions carried by VIO, which estimates VIO's drift",
    params_type=ConsensusParams,
    init=init,
    step=step,
    uses_apr_sigma=True,
)
