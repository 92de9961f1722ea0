"""What method `chain` has learned of the regressor's noise and of the tracker's drift so far."""

from __future__ import annotations

from functools import cache, partial
from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.drift import (
    ERROR_LENGTH_RAD,
    LOG10_RATES,
    Evidence,
    Samples,
    weigh_drifts,
)
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.sums import squared_lengths, to_axes, total
from vioapr.fusion.chain.views import view_exponents
from vioapr.fusion.chain.window import RECENT, Window
from vioapr.geometry.arrays import Array, Mask, compute_where, constant, namespace, zeros

_LEARNING = 0.12
"""Weight of a lesson's evidence in the running average."""

_JUDGED = 20
"""Newest predictions by which the drift is judged: what that costs grows with their third power."""

_VIEWS_PER_LESSON = 2
"""Consecutive memories differ little: they are judged at every second new view."""

_SCEPTICAL_PRIOR = -2.0
"""As `drift_prior`, for a tracker that does not know up: much drift is expected of it."""

_STEADY_STEPS = 2
"""The tilt is steady if its drift is one of this many smallest candidates."""

_ERROR_LENGTH_M, _ERROR_LENGTH_PER_M = 0.3, 1.2
"""Motion after which the errors of a regressor are other ones: indoors, where errors are small,
half a metre. Outdoors it is more; too small a length lets errors pass for drift, which costs
less than drift that passes for errors."""

_OUTLYING = 4.0
"""Squared errors, over the typical one, from which a prediction's variance counts as larger."""

_COUPLING = 1.0
"""Heading and position drift alike: a factor of ten between them costs this logarithm."""

_FIRST_NOISE = np.array([[0.08], [0.5]])
"""Typical errors of a regressor, rad and m, until the predictions tell."""


@cache
def _prior(slope: float) -> np.ndarray:
    prior = np.exp(-slope * (LOG10_RATES - LOG10_RATES[0]))
    return prior / prior.sum()


def _mixing() -> np.ndarray:
    """How likely each size of one drift is with each of the other's."""
    mixing = np.exp(-_COUPLING * np.abs(LOG10_RATES[:, None] - LOG10_RATES))
    return mixing / mixing.sum(axis=0)


_MIXING = _mixing()
_SCEPTICAL = _prior(_SCEPTICAL_PRIOR)
_RATES = 10 ** LOG10_RATES[:, None]
_LOG_RATES = np.log(_RATES)


class Trust(NamedTuple):
    """What has been learned, shape (..., 2, 1) for orientation (rad) and position (m).

    Attributes:
        evidence: Average log-likelihood of the candidates for the drifts of tilt, heading and
            position, shape (..., 3, g).
        rates: The likeliest drifts: variance in a metre, in units of the scatter's, shape
            (..., 3, 1).
        expected_rates: The drifts that are to be expected, as some may be large: the means over
            all that are possible, shape (..., 3, 1).
        is_upright: Whether map and tracker both seem to know up, shape (..., 1, 1).
        scatter: Typical residual of a prediction, per axis.
        noise: Typical error of a prediction, per axis: with the slow part that neighbouring
            predictions share.
        views: How many new views there were, shape (..., 1, 1).
    """

    evidence: Array
    rates: Array
    expected_rates: Array
    is_upright: Mask
    scatter: Array
    noise: Array
    views: Array


def no_trust_yet(params: ChainParams, batch_shape: tuple[int, ...], like: Array) -> Trust:
    """Before the first prediction."""
    number = zeros((*batch_shape, 1, 1), like)
    evidence = zeros((*batch_shape, 3, len(LOG10_RATES)), like)
    # Two separate arrays: a tracer would take one that is passed twice for one input.
    scatter, noise = (number + constant(_FIRST_NOISE, like) for _ in range(2))
    is_upright = number > 0
    rates, expected = _rates(params, evidence, number)
    return Trust(evidence, rates, expected, is_upright, scatter, noise, number)


def _rates(params: ChainParams, evidence: Array, is_upright: Array) -> tuple[Array, Array]:
    """The candidates' geometric and arithmetic means, shape (..., 3, 1)."""
    xp = namespace(evidence)
    if not params.estimate_drift:
        least = xp.zeros_like(evidence[..., :1]) + 10.0 ** LOG10_RATES[0]
        return least, least + 0.0
    weights = _candidate_weights(params, evidence, is_upright)
    weights = weights / total(weights)
    return xp.exp(weights @ constant(_LOG_RATES, weights)), weights @ constant(_RATES, weights)


def _candidate_weights(params: ChainParams, evidence: Array, is_upright: Array) -> Array:
    """Of tilt, heading and position, up to a factor, shape (..., 3, g)."""
    xp = namespace(evidence)
    firm, sceptical = (constant(p, evidence) for p in (_prior(params.drift_prior), _SCEPTICAL))
    likelihood = xp.exp(evidence - xp.max(evidence, axis=-1, keepdims=True))
    is_up = is_upright > 0
    expects_up = is_up if params.gravity in ("auto", "none") else is_up | ~is_up
    tilt = likelihood[..., :1, :] * xp.where(expects_up, firm, sceptical)
    # A tracker whose tilt stays constant knows up, and is as good as those that do.
    steadiness = total(tilt[..., :_STEADY_STEPS]) / total(tilt)
    if params.gravity == "known":
        steadiness = xp.ones_like(steadiness)
    prior = steadiness * firm + (1 - steadiness) * sceptical
    # What the likelihoods of one drift say of the other's.
    hints = likelihood[..., 1:, :] @ constant(_MIXING.T, evidence)
    hints = xp.concat([hints[..., 1:, :], hints[..., :1, :]], axis=-2)
    return xp.concat([tilt, likelihood[..., 1:, :] * prior * hints], axis=-2)


class Lesson(NamedTuple):
    """What there is to learn from, after a prediction; n of them.

    Attributes:
        window: With the new prediction.
        ages: What the odometer has read since each prediction, shape (..., 3, n).
        values: Predictions about the newest frame, rad and m, shape (..., 6, n).
        shares: See `views.view_shares`.
        scatter: Typical residual of a prediction, per axis, shape (..., 2, 1).
        drifts: In a metre, as expected until now, rad^2 and m^2, shape (..., 2, 1).
        is_upright: Of the worlds, shape (..., 1, 1).
        is_new_view: Whether the newest older prediction is from a new view, shape (..., 1, 1).
    """

    window: Window
    ages: Array
    values: Array
    shares: Array
    scatter: Array
    drifts: Array
    is_upright: Mask
    is_new_view: Mask


def learn(params: ChainParams, trust: Trust, lesson: Lesson) -> Trust:
    """After a prediction: note the scatter; average evidence in at every second new view."""
    xp = namespace(lesson.ages)
    window, scatter = lesson.window, lesson.scatter
    is_view = lesson.is_new_view & (total(window.is_valid) > RECENT + 1)
    views = trust.views + xp.astype(is_view, scatter.dtype)
    lessons = xp.floor((views - 1) / _VIEWS_PER_LESSON) + 1
    is_lesson = is_view & (lessons * _VIEWS_PER_LESSON == views + _VIEWS_PER_LESSON - 1)
    count = window.is_valid.shape[-1]
    inputs = (
        trust.evidence,
        trust.noise,
        lessons,
        scatter,
        lesson.drifts,
        window.rows,
        window.is_valid,
        lesson.ages,
        lesson.values,
        lesson.shares,
    )

    def compute(*rows: Array) -> tuple[Array, ...]:
        # The priors are weighed against the evidence of the whole window.
        return _learn(params, max(count / _JUDGED, 1.0), *rows)

    evidence, noise = compute_where(is_lesson[..., 0, 0], compute, inputs, inputs[:2])
    changes = is_lesson | (lesson.is_upright & ~trust.is_upright)
    changes = changes | (~lesson.is_upright & trust.is_upright)
    rates, expected = compute_where(
        changes[..., 0, 0],
        partial(_rates, params),
        (evidence, xp.astype(lesson.is_upright, evidence.dtype)),
        (trust.rates, trust.expected_rates),
    )
    return Trust(evidence, rates, expected, lesson.is_upright, scatter, noise, views)


_CHANNEL_SCATTER = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""Tilt, heading and position, from orientation and position."""


def _learn(
    params: ChainParams,
    emphasis: float,
    evidence: Array,
    noise: Array,
    lessons: Array,
    scatter: Array,
    drifts: Array,
    rows: Array,
    is_valid: Array,
    ages: Array,
    values: Array,
    shares: Array,
) -> tuple[Array, ...]:
    """From what `learn` gathers, for rows of walks."""
    excess = _excess(values, shares, noise, drifts, ages)
    rows, is_valid, ages, values, excess = (
        part[..., : min(_JUDGED, part.shape[-1])] for part in (rows, is_valid, ages, values, excess)
    )
    window = Window(rows, is_valid)
    length_m = _ERROR_LENGTH_M + _ERROR_LENGTH_PER_M * noise[..., 1:, :]
    samples = Samples(
        values,
        is_valid,
        view_exponents(window.vio_place_m, window.vio_gaze, length_m, ERROR_LENGTH_RAD),
        ages[..., :1, :],
        excess,
        (1 / (noise * noise)).mT @ ages[..., 1:, :],
    )
    new = weigh_drifts(samples, constant(_CHANNEL_SCATTER, scatter) @ scatter)
    new = new._replace(log_likelihood=emphasis * new.log_likelihood)
    return _average(params, evidence, noise, lessons, new)


def _excess(values: Array, shares: Array, noise: Array, drifts: Array, ages: Array) -> Array:
    """By how much outliers' variance is larger than that of the others, shape (..., 1, n).

    Judged by the distance from a robust mean, and never from the smoothed path: that follows
    the outliers. What VIO has drifted does not make a prediction one.
    """
    xp = namespace(values)
    expected = 3 * (noise * noise + drifts * ages[..., :1, :])
    weights = to_axes(shares / (expected + squared_lengths(values)))
    mean = total(weights * values) / xp.maximum(total(weights), 1e-12)
    outlying = squared_lengths(values - mean) / expected - _OUTLYING
    outlying = xp.maximum(outlying, 0.0)
    return outlying[..., :1, :] + outlying[..., 1:, :]


def _average(
    params: ChainParams, evidence: Array, noise: Array, lessons: Array, new: Evidence
) -> tuple[Array, Array]:
    xp = namespace(lessons)
    rate = xp.maximum(1 / xp.maximum(lessons, 1.0), _LEARNING)
    evidence = evidence + rate * (new.log_likelihood - evidence)
    # What may be error or drift counts as error here: uncertainty must not be too small.
    own = evidence[..., 1:, :]
    weights = xp.exp(own - xp.max(own, axis=-1, keepdims=True))
    weights = weights * constant(_prior(params.drift_prior), weights)
    variance = total(weights * new.variance[..., 1:, :]) / total(weights)
    return evidence, noise + rate * (xp.sqrt(variance) - noise)
