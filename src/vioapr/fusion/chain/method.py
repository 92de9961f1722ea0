"""The step of method `chain`."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.agreement import (
    Agreement,
    compare_motion,
    compare_rolls,
    judge,
    no_agreement,
)
from vioapr.fusion.chain.columns import column, turned, turns_from, z_up_column
from vioapr.fusion.chain.estimate import Knowledge, answer
from vioapr.fusion.chain.hypotheses import (
    EVIDENCE_AFTER_LOSS,
    MOST_EVIDENCE,
    Hypotheses,
    assemble,
    beginning,
    no_hypotheses,
)
from vioapr.fusion.chain.learning import Lesson, Trust, learn, no_trust_yet
from vioapr.fusion.chain.odometer import Odometer, jumped, new_odometer
from vioapr.fusion.chain.params import ChainParams, in_a_column
from vioapr.fusion.chain.residuals import residuals_of
from vioapr.fusion.chain.smoothing import Problem, Solution, solve
from vioapr.fusion.chain.stated import VETO, Usual, nothing_usual
from vioapr.fusion.chain.sums import largest, largest_of_three, squared_lengths, to_axes, total
from vioapr.fusion.chain.views import VIEW_RAD, view_kernel, view_length_m, view_shares
from vioapr.fusion.chain.window import (
    RECENT,
    Window,
    empty_window,
    is_among_newest,
    new_prediction,
    pushed,
)
from vioapr.fusion.types import Estimate, FrameInput, Method
from vioapr.geometry.arrays import (
    Array,
    Mask,
    constant,
    holds_everywhere,
    holds_nowhere,
    namespace,
    select,
)
from vioapr.geometry.tree import Tree, tree_map

_NOVELTY = 0.8
"""Distance of views, in correlation lengths, from which an older prediction is worth keeping."""

_RATE_FACTOR = 0.1
"""From the likeliest rates in units of the noise to the drift that smoothing does best with."""

_GATE = 3.0
"""Standard deviations within which a prediction fits a hypothesis."""

_MOST_OWN = 8.0
"""Variance of a hypothesis over a prediction's, that widens its gate at most."""

_LEAST_GATE = np.array([[np.deg2rad(10.0)], [1.0]])
"""And at least so far, rad and m: what is nearer hurts nobody."""

_SURPRISE_MEMORY = 0.1
"""Weight of a new prediction in the running mean of squared surprises."""


class ChainState(NamedTuple):
    """What the method remembers; its size does not depend on the walk's length.

    Attributes:
        window: Past predictions.
        odometer: The tracker's last pose, and how far it has come.
        trust: What has been learned of noise and drift.
        hypotheses: The leading one, and its challenger.
        agreement: Whether predictions and motion belong together.
        usual: What the regressor usually states of its errors.
    """

    window: Window
    odometer: Odometer
    trust: Trust
    hypotheses: Hypotheses
    agreement: Agreement
    usual: Usual

    @property
    def is_known(self) -> Mask:
        """Whether there is an estimate, shape (..., 1, 1)."""
        return self.window.is_valid[..., :1] > 0

    @property
    def moved_m(self) -> Array:
        """The tracker's way since the last prediction, shape (..., 3, 1)."""
        return self.odometer.vio_from_cam[..., :3, :] - self.window.vio_place_m[..., :1]

    @property
    def since(self) -> Array:
        """What the odometer has read since the last prediction, shape (..., 3, 1)."""
        return self.odometer.readings - self.window.odometer[..., :1]


def init(params: ChainParams, batch_shape: tuple[int, ...], like: Array) -> ChainState:
    """The state before the first frame."""
    count = int(params.window)
    return ChainState(
        empty_window(batch_shape, count, like),
        new_odometer(batch_shape, like),
        no_trust_yet(params, batch_shape, like),
        no_hypotheses(batch_shape, count, like),
        no_agreement(batch_shape, like),
        nothing_usual(batch_shape, like),
    )


def step(params: ChainParams, state: ChainState, frame: FrameInput) -> tuple[ChainState, Estimate]:
    """One frame: its prediction is weighed; without one, VIO carries the last estimate on."""
    vio_from_cam = z_up_column(frame.vio_from_cam)
    state = _follow_tracker(state, frame, vio_from_cam)
    has_apr = frame.has_apr & frame.tracking_ok
    is_used = has_apr
    if not holds_nowhere(has_apr):
        arrival, usual, has_say = _receive(state, frame)
        state = state._replace(usual=_select_state(has_apr, usual, state.usual))
        is_used = has_apr & has_say
        if not holds_nowhere(is_used):
            state = _select_state(is_used, _weigh(params, state, arrival), state)
    return state, _answer(params, state, is_used, vio_from_cam, frame)


def carry(params: ChainParams, state: ChainState, frame: FrameInput) -> tuple[ChainState, Estimate]:
    """One frame without prediction."""
    vio_from_cam = z_up_column(frame.vio_from_cam)
    state = _follow_tracker(state, frame, vio_from_cam)
    return state, _answer(params, state, frame.has_apr, vio_from_cam, frame)


def _answer(
    params: ChainParams, state: ChainState, is_used: Mask, vio_from_cam: Array, frame: FrameInput
) -> Estimate:
    """What is known by now, as an estimate."""
    known = Knowledge(
        state.hypotheses,
        state.agreement,
        state.trust.noise,
        drift_of(params, state.trust.noise, state.trust.expected_rates)[..., 1:, :],
        state.since,
        state.moved_m,
        state.is_known,
    )
    return answer(params, known, is_used, vio_from_cam, frame)


def _select_state(condition: Mask, if_true: Tree, if_false: Tree) -> Tree:
    """Elementwise choice between states."""
    if if_true is if_false or holds_everywhere(condition):
        return if_true
    return tree_map(partial(select, condition), if_true, if_false)


def _follow_tracker(state: ChainState, frame: FrameInput, vio_from_cam: Array) -> ChainState:
    """Read the odometer on; forget a tracking world that is no more, doubt one that was lost."""
    odometer = state.odometer.follow(frame, vio_from_cam)
    is_new = frame.tracking_reset[..., None, None]
    # Who was lost, or has jumped, may be in another world without saying so.
    is_doubtful = state.odometer.is_lost & frame.tracking_ok[..., None, None]
    is_doubtful = is_doubtful | jumped(state.odometer, odometer)
    state = state._replace(odometer=odometer)
    if holds_nowhere(is_new | is_doubtful):
        return state
    valid = state.window.is_valid
    xp = namespace(valid)
    most = xp.where(is_doubtful, EVIDENCE_AFTER_LOSS, xp.zeros_like(valid[..., :1]) + MOST_EVIDENCE)
    most = xp.where(is_new, 0.0, most)
    kept = valid * xp.astype(~is_new, valid.dtype)
    return state._replace(
        window=state.window._replace(is_valid=kept),
        hypotheses=state.hypotheses.bounded(most),
        agreement=state.agreement.unsure(is_doubtful, is_new),
    )


class Arrival(NamedTuple):
    """A prediction, and where both hypotheses expect the camera.

    Attributes:
        row: See `window.new_prediction`.
        stated: See `Window`, of this prediction, shape (..., 2, 1).
        matrices: Rotations of world_from_vio by both hypotheses, shape (..., 2, 3, 3).
        expected_m: The places that they expect, shape (..., 2, 3, 1).
        surprises: Squared distances from them, rad^2 and m^2, shape (..., 2, 2, 1).
        is_veto: Whether it states not to be one, shape (..., 1, 1).
    """

    row: Array
    stated: Array
    matrices: Array
    expected_m: Array
    surprises: Array
    is_veto: Mask


def _receive(state: ChainState, frame: FrameInput) -> tuple[Arrival, Usual, Mask]:
    """A prediction; what is usually stated, with it; and whether it has a say, shape (...)."""
    apr = column(frame.apr_world_from_cam)
    xp = namespace(apr)
    place_m, noise = apr[..., :3, :], state.trust.noise
    row = new_prediction(apr, state.odometer.vio_from_cam, state.odometer.readings)
    matrices = state.hypotheses.matrices
    expected_m = state.hypotheses.place_m + matrices @ state.moved_m[..., None, :, :]
    turns = turns_from(row[..., None, :4, :], state.hypotheses.world_from_vio)
    gaps = xp.concat([turns, place_m[..., None, :, :] - expected_m], axis=-2)
    surprises = squared_lengths(gaps)
    leading = surprises[..., 0, :, :] * xp.astype(state.is_known, apr.dtype)
    usual, stated, is_veto = state.usual.weigh(frame, leading / (noise * noise))
    # The same numbers once more are a regressor that hangs, and say nothing new.
    is_news = xp.any(place_m != state.window.place_m[..., :1], axis=-2, keepdims=True)
    has_say = is_news | ~state.is_known
    return Arrival(row, stated, matrices, expected_m, surprises, is_veto), usual, has_say[..., 0, 0]


def _weigh(params: ChainParams, state: ChainState, arrival: Arrival) -> ChainState:
    """Take a prediction into the window, and smooth both hypotheses again."""
    trust, last = state.trust, state.hypotheses
    xp = namespace(arrival.row)
    drift = drift_of(params, trust.noise, trust.rates)
    length_m = view_length_m(trust.scatter[..., 1:, :])
    moves = state.window.moving(length_m, VIEW_RAD, _NOVELTY, VETO)
    window = state.window.push(arrival.row, arrival.stated, moves)
    kernel = view_kernel(window, length_m)
    newness = xp.where(arrival.is_veto, 0.0, 1 / total(kernel[..., :1, : RECENT + 2]))
    shares = window.is_valid
    if params.view_weights:
        per_noise = drift[..., 2:, :] / (trust.scatter[..., 1:, :] * trust.scatter[..., 1:, :])
        shares = view_shares(window, kernel, per_noise)
    start = xp.zeros_like(last.path[..., :1])
    last = last._replace(path=pushed(last.path, start, moves[..., None, :, :]))
    residuals = residuals_of(
        window, last.world_from_vio, arrival.matrices, arrival.expected_m, last.path
    )
    gates = _gates(trust, last.precision, drift, state.since)
    ages = state.odometer.readings - window.odometer
    problem = Problem(window, residuals, last, trust, ages, shares, drift, gates)
    solution = solve(params, problem)
    hypotheses, window = _weigh_hypotheses(params, state, arrival, problem, solution, newness)
    lesson = Lesson(
        window,
        ages,
        solution.values[..., 0, :, :],
        shares,
        xp.sqrt(solution.scatter2),
        drift[..., 1:, :],
        solution.is_upright[..., 0, :, :],
        moves[..., -1:],
    )
    surprise = state.agreement.surprise
    surprise = surprise + _SURPRISE_MEMORY * newness * (arrival.surprises[..., 0, :, :] - surprise)
    noted = state.agreement._replace(beyond=solution.beyond, surprise=surprise)
    return state._replace(
        window=window,
        trust=learn(params, trust, lesson),
        hypotheses=hypotheses,
        agreement=judge(noted, hypotheses, compare_rolls(window), newness),
    )


def _weigh_hypotheses(
    params: ChainParams,
    state: ChainState,
    arrival: Arrival,
    problem: Problem,
    solution: Solution,
    newness: Array,
) -> tuple[Hypotheses, Window]:
    """Both as corrected, in order of evidence; and the predictions that are still asked."""
    last, window, trust = problem.last, problem.window, problem.trust
    xp = namespace(newness)
    is_known = state.is_known[..., None, :, :]
    new = newness[..., None, :, :]
    distance2 = largest(arrival.surprises / problem.gates)
    fit = xp.astype(is_known, newness.dtype) / (1 + distance2 * distance2)
    scatter_m = trust.scatter[..., 1:, :]
    newest = solution.path[..., :1]
    rows = assemble(
        turned(last.world_from_vio, newest[..., :3, :]),
        arrival.expected_m + newest[..., 3:, :],
        solution.precision,
        solution.depth_m,
        *last.support(fit, new),
        # What a wild prediction says of the motion is as wild.
        *compare_motion(last, window, problem.residuals.ways_m, scatter_m, new * fit),
    )
    fits = (distance2 < 1) | arrival.is_veto[..., None, :, :] | (not params.hypotheses)
    own = to_axes(1 / (trust.scatter * trust.scatter))
    first = beginning(arrival.row[..., :4, :], window.place_m[..., :1], own)
    both = Hypotheses(rows, solution.path - newest)
    both = both.challenge(fits & is_known, problem.gates, first)
    both, swaps = both.overtake(is_known)
    # Predictions that speak for what was left are no longer asked.
    speaks = solution.is_near[..., 1, :, :] | ~swaps[..., 0, :, :]
    newest_only = constant(is_among_newest(window.is_valid.shape[-1], 1), newness) > 0
    kept = window.is_valid * xp.astype(speaks | newest_only, newness.dtype)
    return both, window._replace(is_valid=kept)


def _gates(trust: Trust, precision: Array, drift: Array, since: Array) -> Array:
    """Squared distances within which predictions fit, rad^2 and m^2, shape (..., 2, 2, 1)."""
    # Not by a jump: what lies beyond it is for the challenger to say.
    growth = drift[..., 1:, :] * since[..., :1, :]
    usual = (trust.scatter * trust.scatter + growth)[..., None, :, :]
    xp = namespace(since)
    # A hypothesis that hardly anything speaks for must not fit everything.
    own = xp.minimum(largest_of_three(1 / precision), _MOST_OWN * usual)
    gates = 3 * _GATE**2 * (usual + own)
    return xp.maximum(gates, constant(_LEAST_GATE**2, gates))


def drift_of(params: ChainParams, noise: Array, rates: Array) -> Array:
    """Of tilt, heading and position in a metre, rad^2 and m^2, shape (..., 3, 1).

    As a calibration has found it, or as learned.
    """
    learned = _RATE_FACTOR * rates * (constant(_UNITS, noise) @ (noise * noise))
    given: list[float | Array] = [
        params.tilt_drift_rad2_per_m,
        params.heading_drift_rad2_per_m,
        params.position_drift_m2_per_m,
    ]
    if all(isinstance(value, float | int) and value < 0 for value in given):
        return learned
    known = in_a_column(given, learned)
    return namespace(learned).where(known < 0, learned, known)


_UNITS = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""Of tilt, heading and position, from orientation and position."""


METHOD = Method(
    name="chain",
    summary="random walk of the tracking world, smoothed robustly; two hypotheses; says 'not here'",
    params_type=ChainParams,
    init=init,
    step=step,
    carry=carry,
    uses_apr_sigma=True,
)
