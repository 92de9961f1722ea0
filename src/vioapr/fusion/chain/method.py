"""The step of method `chain`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vioapr.fusion.chain import agreement as agreement_of
from vioapr.fusion.chain.agreement import Agreement, no_agreement
from vioapr.fusion.chain.columns import column, turns_from, z_up_column
from vioapr.fusion.chain.estimate import answer, variances_of
from vioapr.fusion.chain.hypotheses import (
    EVIDENCE_AFTER_LOSS,
    Hypotheses,
    begun,
    no_hypotheses,
)
from vioapr.fusion.chain.learning import Lesson, Trust, learn, no_trust_yet
from vioapr.fusion.chain.odometer import Odometer, new_odometer
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.smoothing import (
    Drift,
    knows_up,
    levelled,
    look_at_depth,
    residuals_of,
    smoothed,
    step_variances,
    weights_of,
)
from vioapr.fusion.chain.stated import Usual, nothing_usual
from vioapr.fusion.chain.sums import (
    largest,
    largest_of_three,
    row_sum,
    squared_lengths,
    total,
    typical_of,
)
from vioapr.fusion.chain.views import VIEW_RAD, view_kernel, view_length_m, view_shares
from vioapr.fusion.chain.window import RECENT, Window, empty_window, new_prediction
from vioapr.fusion.types import Estimate, FrameInput, Method
from vioapr.geometry.arrays import (
    Array,
    Mask,
    constant,
    holds_everywhere,
    holds_nowhere,
    namespace,
    select,
    zeros,
)

_NOVELTY = 0.8
"""Distance of views, in correlation lengths, from which an older prediction is worth keeping."""

_RATE_FACTOR = 0.1
"""From the likeliest rates in units of the noise to the drift that smoothing does best with."""

_GATE = 3.0
"""Standard deviations within which a prediction fits a hypothesis."""

_LEAST_GATE = np.array([[np.deg2rad(10.0)], [1.0]])
"""And at least so far, rad and m: what is nearer hurts nobody."""

_SCATTER_LIMITS2 = np.array([[0.0035, 0.26], [0.005, 4.0]]) ** 2
"""Within which regressors err per axis, rad^2 and m^2."""

_MEDIAN_CHI2 = 2.366
"""Median of the chi-squared distribution with three degrees of freedom."""

_SURPRISE_MEMORY = 0.1
"""Weight of a new prediction in the running mean of squared surprises."""

_CHALLENGES = np.array([0.0, 1.0])[:, None, None]


class ChainState(NamedTuple):
    """What the method remembers; its size does not depend on the walk's length.

    Attributes:
        window: Past predictions.
        odometer: The tracker's last pose, and how far it has come.
        trust: What has been learned of noise and drift.
        hypotheses: The leading one, and its challenger.
        agreement: Whether predictions and motion belong together.
        usual: What the regressor usually states of its errors.
        is_known: Whether there is an estimate, shape (..., 1, 1).
        vio_place_m: Where the tracker was at the last prediction, shape (..., 3, 1).
        readings: The odometer's then, shape (..., 3, 1).
    """

    window: Window
    odometer: Odometer
    trust: Trust
    hypotheses: Hypotheses
    agreement: Agreement
    usual: Usual
    is_known: Mask
    vio_place_m: Array
    readings: Array


def init(params: ChainParams, batch_shape: tuple[int, ...], like: Array) -> ChainState:
    """The state before the first frame."""
    count = int(params.window)

    def nothing(rows: int) -> Array:
        return zeros((*batch_shape, rows, 1), like)

    return ChainState(
        empty_window(batch_shape, count, like),
        new_odometer(batch_shape, like),
        no_trust_yet(params, batch_shape, like),
        no_hypotheses(batch_shape, count, like),
        no_agreement(batch_shape, like),
        nothing_usual(batch_shape, like),
        nothing(1) > 0,
        nothing(3),
        nothing(3),
    )


def step(params: ChainParams, state: ChainState, frame: FrameInput) -> tuple[ChainState, Estimate]:
    """One frame: its prediction is weighed; without one, VIO carries the last estimate on."""
    vio_from_cam = z_up_column(frame.vio_from_cam)
    state = _follow_tracker(state, frame, vio_from_cam)
    has_apr = frame.has_apr & frame.tracking_ok
    is_used = has_apr
    if not holds_nowhere(has_apr):
        weighed, is_accepted = _weigh_prediction(params, state, frame)
        is_used = has_apr & is_accepted
        state = state._replace(usual=_select_state(has_apr, weighed.usual, state.usual))
        state = _select_state(is_used, weighed, state)
    is_placed = frame.tracking_ok & state.is_known[..., 0, 0]
    if params.not_here:
        is_placed = is_placed & (state.agreement.is_here[..., 0, 0] > 0)
    variances = variances_of(
        state.hypotheses,
        state.agreement,
        state.trust.noise,
        _drift(params, state.trust, state.trust.expected_rates),
        state.odometer.readings - state.readings,
        vio_from_cam[..., :3, :] - state.vio_place_m,
    )
    estimate = answer(
        params,
        state.hypotheses,
        variances,
        state.trust.noise,
        is_placed,
        is_used,
        vio_from_cam,
        state.vio_place_m,
        frame,
    )
    return state, estimate


def _select_state(condition: Mask, if_true: Any, if_false: Any) -> Any:
    """Elementwise choice between states: nested tuples of arrays."""
    if if_true is if_false or holds_everywhere(condition):
        return if_true
    if holds_nowhere(condition):
        return if_false
    if not isinstance(if_true, tuple):
        return select(condition, if_true, if_false)
    parts = (_select_state(condition, a, b) for a, b in zip(if_true, if_false, strict=True))
    return type(if_true)(*parts)


def _follow_tracker(state: ChainState, frame: FrameInput, vio_from_cam: Array) -> ChainState:
    """Read the odometer on; forget a tracking world that is no more, doubt one that was lost."""
    odometer = state.odometer.follow(frame, vio_from_cam)
    if holds_nowhere(frame.tracking_reset | state.odometer.is_lost[..., 0, 0]):
        return state._replace(odometer=odometer)
    xp = namespace(vio_from_cam)
    keeps = ~frame.tracking_reset[..., None, None]
    valid = state.window.is_valid
    is_back = (frame.tracking_ok[..., None, None] & state.odometer.is_lost)[..., None, :, :]
    evidence = state.hypotheses.evidence
    doubted = xp.where(is_back, xp.minimum(evidence, EVIDENCE_AFTER_LOSS), evidence)
    return state._replace(
        window=state.window._replace(is_valid=valid * xp.astype(keeps, valid.dtype)),
        odometer=odometer,
        hypotheses=state.hypotheses._replace(evidence=doubted),
        is_known=state.is_known & keeps,
    )


def _drift(params: ChainParams, trust: Trust, rates: Array) -> Drift:
    """In rad^2 and m^2 a metre: as a calibration has found it, or as learned."""
    noise2 = _RATE_FACTOR * trust.noise * trust.noise
    given = (
        params.tilt_drift_rad2_per_m,
        params.heading_drift_rad2_per_m,
        params.position_drift_m2_per_m,
    )
    units = (noise2[..., :1, :], noise2[..., :1, :], noise2[..., 1:, :])
    learned = (rates[..., row : row + 1, :] * unit for row, unit in enumerate(units))
    return Drift(
        *(
            drift if value < 0 else 0 * drift + value
            for value, drift in zip(given, learned, strict=True)
        )
    )


def _weigh_prediction(
    params: ChainParams, state: ChainState, frame: FrameInput
) -> tuple[ChainState, Mask]:
    """Take a prediction in and estimate again; and whether it has a say at all, shape (...)."""
    apr, vio = column(frame.apr_world_from_cam), state.odometer.vio_from_cam
    xp = namespace(apr)
    trust, odometer = state.trust, state.odometer.readings
    drift = _drift(params, trust, trust.rates)
    vio_place_m, place_m = vio[..., :3, :], apr[..., :3, :]
    prediction = new_prediction(apr, vio, odometer)
    rotation = prediction[..., :4, :]
    hypotheses = begun(state.hypotheses, state.is_known, rotation, place_m)
    arrived_m = xp.where(
        state.is_known[..., None, :, :],
        hypotheses.carry(vio_place_m - state.vio_place_m),
        hypotheses.place_m,
    )
    surprises = _surprises(hypotheses, arrived_m, rotation, place_m)
    squares = surprises[..., 0, :, :] * xp.astype(state.is_known, apr.dtype)
    usual, stated, is_veto = state.usual.weigh(frame, squares / (trust.noise * trust.noise))
    is_news = xp.any(place_m != state.window.place_m[..., :1], axis=-2, keepdims=True)
    is_news = is_news | (state.window.is_valid[..., :1] < 0.5)

    # The window, with the new prediction in front.
    length_m = view_length_m(trust.scatter[..., 1:, :])
    moves = state.window.moving(length_m, VIEW_RAD, _NOVELTY)
    window = state.window.push(prediction, stated, moves)
    hypotheses = hypotheses.push(arrived_m, moves)
    ages = odometer - window.odometer
    kernel = view_kernel(window, length_m)
    relative = drift.position / (trust.scatter[..., 1:, :] * trust.scatter[..., 1:, :])
    shares = view_shares(window, kernel, relative) if params.view_weights else window.is_valid
    newness = 1 / total(kernel[..., :1, : RECENT + 2])

    # How well it fits what both hypotheses expect here.
    since = odometer - state.readings
    gates = _gates(trust, hypotheses, drift, since)
    distance2 = largest(surprises / gates)
    hypotheses = hypotheses.weigh(1 / (1 + distance2 * distance2), newness)

    # Both, smoothed.
    residuals = residuals_of(window, hypotheses)
    hypotheses = agreement_of.compare_motion(
        hypotheses, window, residuals.ways_m, trust.scatter[..., 1:, :], newness
    )
    places = residuals.values[..., 3:, :]
    swings = hypotheses.depth_m * residuals.swings if params.look_at else 0 * residuals.swings
    values = xp.concat([residuals.values[..., :3, :], places + swings], axis=-2)
    errors2 = squared_lengths(values - hypotheses.path)
    scatter2, beyond = _scatter(trust, window, ages, errors2[..., 0, :, :])
    is_near = largest(errors2 / gates) < 1
    counts = shares[..., None, :, :] * xp.astype(
        is_near | (constant(_CHALLENGES, apr) > 0), apr.dtype
    )
    weights = weights_of(params, counts, window.stated, errors2, scatter2)
    offset = places - hypotheses.path[..., 3:, :]
    depth_m = look_at_depth(weights, offset, residuals.swings)
    if params.look_at:
        places = places + depth_m * residuals.swings
    is_upright, tilt = knows_up(params, hypotheses.world_from_vio)
    turns, precisions = levelled(
        params, residuals.values[..., :3, :], weights.turn, is_upright, tilt
    )
    values = xp.concat([turns, places], axis=-2)
    precisions = xp.concat([precisions, *([weights.place] * 3)], axis=-2)
    variances = step_variances(params, window, residuals.legs_m, drift, is_upright)
    path, precision = smoothed(values, precisions, variances, window.is_valid)
    hypotheses = hypotheses.corrected(path, precision, depth_m)

    # Which of them leads, and what begins.
    if params.hypotheses:
        hypotheses = hypotheses.challenge(distance2 < 1, gates, rotation, place_m)
        hypotheses, swaps = hypotheses.overtake()
        fits_new = xp.astype(is_near[..., 1, :, :] | ~swaps, apr.dtype)
        window = window._replace(is_valid=window.is_valid * fits_new)

    # What this says of noise, drift and the place.
    drifts = xp.concat([drift.heading, drift.position], axis=-2)
    upright, is_new_view = is_upright[..., 0, :, :], moves[..., -1:]
    scatter, leading = xp.sqrt(scatter2), values[..., 0, :, :]
    lesson = Lesson(window, ages, leading, shares, scatter, drifts, upright, is_new_view)
    trust = learn(params, trust, lesson)
    surprise = state.agreement.surprise
    surprise = surprise + _SURPRISE_MEMORY * newness * (surprises[..., 0, :, :] - surprise)
    noted = state.agreement._replace(beyond=beyond, surprise=surprise)
    rolls = agreement_of.compare_rolls(window)
    agreement = agreement_of.judge(noted, hypotheses, rolls, newness)
    weighed = ChainState(
        window,
        state.odometer,
        trust,
        hypotheses,
        agreement,
        usual,
        state.is_known | ~state.is_known,
        vio_place_m,
        odometer,
    )
    return weighed, (is_news & ~is_veto)[..., 0, 0]


def _surprises(hypotheses: Hypotheses, arrived_m: Array, rotation: Array, place_m: Array) -> Array:
    """Squared distances of a prediction from both hypotheses, rad^2 and m^2, (..., 2, 2, 1)."""
    xp = namespace(place_m)
    turns = turns_from(rotation[..., None, :, :], hypotheses.world_from_vio)
    return squared_lengths(xp.concat([turns, place_m[..., None, :, :] - arrived_m], axis=-2))


def _gates(trust: Trust, hypotheses: Hypotheses, drift: Drift, since: Array) -> Array:
    """Squared distances within which predictions fit, rad^2 and m^2, shape (..., 2, 2, 1)."""
    xp = namespace(since)
    rates = xp.concat([drift.heading, drift.position], axis=-2)
    growth = rates * since[..., :1, :] + since[..., 1:, :]
    own = 1 / hypotheses.precision
    own = xp.concat([largest_of_three(own[..., :3, :]), largest_of_three(own[..., 3:, :])], axis=-2)
    usual = (trust.scatter * trust.scatter + growth)[..., None, :, :]
    return xp.maximum(3 * _GATE**2 * (usual + own), constant(_LEAST_GATE**2, own))


def _scatter(trust: Trust, window: Window, ages: Array, errors2: Array) -> tuple[Array, Array]:
    """The typical squared residual per axis, and what of it is beyond its limit, (..., 2, 1).

    Args:
        trust: The last one.
        window: Past predictions.
        ages: What the odometer has read since each prediction, shape (..., 3, n).
        errors2: Squared residuals about the leading path, shape (..., 2, n).
    """
    xp = namespace(ages)
    noise2 = trust.noise * trust.noise
    jumps = row_sum(ages[..., 1:, :] / noise2)
    typical = typical_of(window.is_valid * xp.astype(jumps < 1, ages.dtype))
    median = typical.median(errors2) / _MEDIAN_CHI2
    median = xp.where(typical.is_few, trust.scatter * trust.scatter, median)
    least, most = (constant(_SCATTER_LIMITS2[:, k : k + 1], median) for k in range(2))
    return xp.minimum(xp.maximum(median, least), most), xp.maximum(median - most, 0.0)


METHOD = Method(
    name="chain",
    summary="random walk of the tracking world, smoothed robustly; two hypotheses; says 'not here'",
    params_type=ChainParams,
    init=init,
    step=step,
)
