"""How far method `consensus` trusts VIO: what it has learned of noise and drift so far."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.drift import (
    ERROR_LENGTH_RAD,
    LOG10_RATES,
    Evidence,
    Samples,
    weigh_drifts,
)
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.robust import Fit, total
from vioapr.fusion.consensus.views import view_exponents
from vioapr.fusion.consensus.votes import RECENT, Votes
from vioapr.geometry.arrays import Array, Mask, compute_where, constant, namespace, zeros

_LEARNING = 0.12
"""Weight of a lesson's evidence in the running average."""

_JUDGED = 20
"""Newest votes by which the drift is judged: what that costs grows with their third power."""

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

_COUPLING = 1.0
"""Heading and position drift alike: a factor of ten between them costs this logarithm."""

_FIRST_NOISE = np.array([[0.08], [0.5]])
"""Typical errors of a regressor, rad and m, until the votes tell."""


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
_LOG_RATES = np.log(10) * LOG10_RATES[:, None]


class Trust(NamedTuple):
    """What has been learned, shape (..., 2, 1) for orientation (rad) and position (m).

    Attributes:
        evidence: Average log-likelihood of the candidates for the drifts of tilt, heading and
            position, shape (..., 3, g).
        rates: The likeliest drifts: variance in a metre, in units of the scatter's, shape
            (..., 3, 1).
        is_upright: Whether map and tracker both seem to know up, shape (..., 1, 1).
        scatter: Typical residual of a vote, per axis.
        noise: Typical error of a prediction, per axis: with the slow part that neighbouring
            votes share.
        views: How many new views there were, shape (..., 1, 1).
    """

    evidence: Array
    rates: Array
    is_upright: Mask
    scatter: Array
    noise: Array
    views: Array


def no_trust_yet(params: ConsensusParams, batch_shape: tuple[int, ...], like: Array) -> Trust:
    """Before the first vote."""
    number = zeros((*batch_shape, 1, 1), like)
    evidence = zeros((*batch_shape, 3, len(LOG10_RATES)), like)
    # Two separate arrays: a tracer would take one that is passed twice for one input.
    scatter, noise = (number + constant(_FIRST_NOISE, like) for _ in range(2))
    is_upright = number > 0
    rates = _likeliest_rates(params, evidence, is_upright)
    return Trust(evidence, rates, is_upright, scatter, noise, number)


def _likeliest_rates(params: ConsensusParams, evidence: Array, is_upright: Mask) -> Array:
    """Geometric means over the candidates, shape (..., 3, 1)."""
    xp = namespace(evidence)
    if not params.estimate_drift:
        return xp.zeros_like(evidence[..., :1]) + 10.0 ** LOG10_RATES[0]
    weights = _candidate_weights(params, evidence, is_upright)
    return xp.exp((weights @ constant(_LOG_RATES, weights)) / total(weights))


def _candidate_weights(params: ConsensusParams, evidence: Array, is_upright: Mask) -> Array:
    """Of tilt, heading and position, up to a factor, shape (..., 3, g)."""
    xp = namespace(evidence)
    firm, sceptical = (constant(p, evidence) for p in (_prior(params.drift_prior), _SCEPTICAL))
    likelihood = xp.exp(evidence - xp.max(evidence, axis=-1, keepdims=True))
    expects_up = is_upright if params.gravity in ("auto", "none") else is_upright | ~is_upright
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


def learn(
    params: ConsensusParams,
    trust: Trust,
    votes: Votes,
    ages: Array,
    fits: tuple[Fit, Fit],
    is_upright: Mask,
    is_new_view: Mask,
) -> Trust:
    """After a vote: note the scatter, and average the evidence in at every second new view.

    Args:
        params: Of the method.
        trust: The last one.
        votes: With the new one.
        ages: What the odometer has read since each vote, shape (..., 3, n).
        fits: Of rotation and position.
        is_upright: Of the worlds.
        is_new_view: Whether the newest older vote is from a new view, shape (..., 1, 1).
    """
    xp = namespace(ages)
    scatter = xp.concat([fit.scatter for fit in fits], axis=-2)
    noise2 = trust.noise * trust.noise
    jumps = (1 / noise2).mT @ ages[..., 1:, :]
    is_view = is_new_view & (total(votes.is_valid) > RECENT + 1)
    views = trust.views + xp.astype(is_view, scatter.dtype)
    lessons = xp.floor((views - 1) / _VIEWS_PER_LESSON) + 1
    is_lesson = is_view & (lessons * _VIEWS_PER_LESSON == views + _VIEWS_PER_LESSON - 1)
    judged = (
        xp.concat([fit.samples for fit in fits], axis=-2),
        votes.is_valid,
        votes.rows,
        ages,
        fits[0].excess + fits[1].excess,
        jumps,
    )
    count = votes.is_valid.shape[-1]
    newest = (part[..., : min(_JUDGED, count)] for part in judged)
    inputs = (trust.evidence, trust.noise, lessons, scatter, *newest)

    def compute(*rows: Array) -> tuple[Array, ...]:
        # The priors are weighed against the evidence of the whole memory.
        return _learn(params, max(count / _JUDGED, 1.0), *rows)

    evidence, noise = compute_where(is_lesson[..., 0, 0], compute, inputs, inputs[:2])
    rates = _likeliest_rates(params, evidence, is_upright)
    return Trust(evidence, rates, is_upright, scatter, noise, views)


_CHANNEL_SCATTER = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""Tilt, heading and position, from orientation and position."""


def _learn(
    params: ConsensusParams,
    emphasis: float,
    evidence: Array,
    noise: Array,
    lessons: Array,
    scatter: Array,
    values: Array,
    is_valid: Array,
    rows: Array,
    ages: Array,
    excess: Array,
    jumps: Array,
) -> tuple[Array, ...]:
    """From what `learn` gathers, for rows of walks."""
    votes = Votes(rows, is_valid)
    length_m = _ERROR_LENGTH_M + _ERROR_LENGTH_PER_M * noise[..., 1:, :]
    samples = Samples(
        values,
        is_valid,
        view_exponents(votes.vio_place_m, votes.vio_gaze, length_m, ERROR_LENGTH_RAD),
        ages[..., :1, :],
        excess,
        jumps,
    )
    new = weigh_drifts(samples, constant(_CHANNEL_SCATTER, scatter) @ scatter)
    new = new._replace(log_likelihood=emphasis * new.log_likelihood)
    return _average(params, evidence, noise, lessons, new)


def _average(
    params: ConsensusParams, evidence: Array, noise: Array, lessons: Array, new: Evidence
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
