"""How far method `consensus` trusts VIO: what it has learned of noise and drift so far."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.drift import (
    CORRELATED_PART,
    LOG10_RATES,
    Channel,
    Evidence,
    weigh_drifts,
)
from vioapr.fusion.consensus.fit import Fit
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.votes import RECENT, Odometer, ViewGaps, Votes
from vioapr.geometry.arrays import Array, compute_where, constant, namespace, zeros

_LEARNING = 0.1
"""Weight of a new view's evidence in the running average."""

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

_FIRST_NOISE_M, _FIRST_NOISE_RAD = 0.5, 0.08
"""Typical errors of a regressor, until the votes tell."""


class Trust(NamedTuple):
    """What has been learned, shape (...) or (..., g) for g candidates of drift.

    Attributes:
        tilt: Average log-likelihood of each candidate for the drift of tilt.
        heading: Likewise of heading.
        position: Likewise of position.
        is_upright: Whether map and tracker both seem to know up.
        scatter_m: Typical residual of a vote's position, per axis.
        scatter_rad: Of its rotation.
        noise_m: Typical error of a prediction, per axis: with the slow part that neighbouring
            votes share.
        noise_rad: Of its rotation.
        lessons: How often something was learned.
    """

    tilt: Array
    heading: Array
    position: Array
    is_upright: Array
    scatter_m: Array
    scatter_rad: Array
    noise_m: Array
    noise_rad: Array
    lessons: Array


class Rates(NamedTuple):
    """Variance that VIO drifts by in a metre, in units of the scatter's, shape (...)."""

    tilt: Array
    heading: Array
    position: Array

    def variances(self, trust: Trust) -> tuple[Array, Array]:
        """Of heading and position, in rad^2 and m^2 a metre."""
        return (
            CORRELATED_PART * self.heading * trust.noise_rad**2,
            CORRELATED_PART * self.position * trust.noise_m**2,
        )


def no_trust_yet(batch_shape: tuple[int, ...], like: Array) -> Trust:
    """Before the first vote."""
    candidates = (*batch_shape, len(LOG10_RATES))

    def full(value: float) -> Array:
        return zeros(batch_shape, like) + value

    return Trust(
        tilt=zeros(candidates, like),
        heading=zeros(candidates, like),
        position=zeros(candidates, like),
        is_upright=zeros(batch_shape, like) > 0,
        scatter_m=full(_FIRST_NOISE_M),
        scatter_rad=full(_FIRST_NOISE_RAD),
        noise_m=full(_FIRST_NOISE_M),
        noise_rad=full(_FIRST_NOISE_RAD),
        lessons=full(0.0),
    )


def drift_rates(params: ConsensusParams, trust: Trust) -> Rates:
    """The drifts' likeliest sizes: geometric means over the candidates."""
    xp = namespace(trust.scatter_m)
    if not params.estimate_drift:
        least = xp.ones_like(trust.scatter_m) * 10 ** LOG10_RATES[0]
        return Rates(least, least, least)
    return Rates(*(_geometric_mean(weights) for weights in _weights(params, trust)))


def _weights(params: ConsensusParams, trust: Trust) -> tuple[Array, Array, Array]:
    """Probabilities of the candidates for tilt, heading and position."""
    xp = namespace(trust.tilt)
    firm, sceptical = (
        constant(_prior(slope), trust.tilt) for slope in (params.drift_prior, _SCEPTICAL_PRIOR)
    )
    tilt_prior = xp.where(_expects_up(params, trust)[..., None], xp.log(firm), xp.log(sceptical))
    tilt = _softmax(trust.tilt + tilt_prior)
    # A tracker whose tilt stays constant knows up, and is as good as those that do.
    steadiness = xp.sum(tilt[..., :_STEADY_STEPS], axis=-1, keepdims=True)
    if params.gravity == "known":
        steadiness = xp.ones_like(steadiness)
    prior = xp.log(steadiness * firm + (1 - steadiness) * sceptical)
    return (
        tilt,
        _softmax(trust.heading + prior + _hint(trust.position)),
        _softmax(trust.position + prior + _hint(trust.heading)),
    )


def _expects_up(params: ConsensusParams, trust: Trust) -> Array:
    if params.gravity in ("known", "estimate"):
        return trust.is_upright | ~trust.is_upright
    return trust.is_upright


def _prior(slope: float) -> np.ndarray:
    prior = np.exp(-slope * (LOG10_RATES - LOG10_RATES[0]))
    return prior / prior.sum()


def _mixing() -> np.ndarray:
    """How likely each size of one drift is with each of the other's, columns sum to 1."""
    mixing = np.exp(-_COUPLING * np.abs(LOG10_RATES[:, None] - LOG10_RATES))
    return mixing / mixing.sum(axis=0)


_MIXING = _mixing()


def _hint(other: Array) -> Array:
    """What the likelihoods of one drift say of the other's, logarithm."""
    xp = namespace(other)
    mixed = _softmax(other)[..., None] * constant(_MIXING, other)
    return xp.log(xp.sum(mixed, axis=-2))


def _softmax(logits: Array) -> Array:
    xp = namespace(logits)
    weights = xp.exp(logits - xp.max(logits, axis=-1, keepdims=True))
    return weights / xp.sum(weights, axis=-1, keepdims=True)


def _geometric_mean(weights: Array) -> Array:
    xp = namespace(weights)
    return 10 ** xp.sum(weights * constant(LOG10_RATES, weights), axis=-1)


def notice_scatter(trust: Trust, rotation: Fit, position: Fit) -> Trust:
    """After every vote."""
    return trust._replace(
        is_upright=rotation.is_upright,
        scatter_m=position.scatter,
        scatter_rad=rotation.scatter,
    )


def learn(
    params: ConsensusParams,
    trust: Trust,
    votes: Votes,
    gaps: ViewGaps,
    ages: Odometer,
    rotation: Fit,
    position: Fit,
    is_new_view: Array,
) -> Trust:
    """Average the evidence of votes in, where the newest older one is from a new view."""
    xp = namespace(votes.is_valid)
    enough = xp.sum(votes.is_valid, axis=-1) > RECENT + 1
    jumps = ages.jumps_m2 / (trust.noise_m**2)[..., None]
    inputs = (
        *trust,
        *gaps,
        votes.is_valid,
        ages.motion_m,
        jumps + ages.jumps_rad2 / (trust.noise_rad**2)[..., None],
        xp.concat([rotation.samples, position.samples], axis=-1),
        rotation.excess + position.excess,
    )
    learned = compute_where(is_new_view & enough, partial(_learn, params), inputs, tuple(trust))
    return Trust._make(learned)


def _learn(params: ConsensusParams, *inputs: Array) -> tuple[Array, ...]:
    """From what `learn` gathers, for rows of walks."""
    count = len(Trust._fields)
    trust = Trust._make(inputs[:count])
    *gaps, is_valid, motion_m, jumps, samples, excess = inputs[count:]
    evidence = weigh_drifts(
        samples,
        is_valid,
        ViewGaps(*gaps),
        _ERROR_LENGTH_M + _ERROR_LENGTH_PER_M * trust.noise_m,
        motion_m,
        excess,
        jumps,
        [
            Channel(slice(0, 2), trust.scatter_rad),
            Channel(slice(2, 3), trust.scatter_rad),
            Channel(slice(3, 6), trust.scatter_m),
        ],
    )
    return tuple(_average(params, trust, evidence))


def _average(params: ConsensusParams, trust: Trust, evidence: list[Evidence]) -> Trust:
    xp = namespace(trust.lessons)
    lessons = trust.lessons + 1
    rate = xp.maximum(1 / lessons, xp.ones_like(lessons) * _LEARNING)
    old = (trust.tilt, trust.heading, trust.position)
    tilt, heading, position = (
        before + rate[..., None] * (new.log_likelihood - before)
        for before, new in zip(old, evidence, strict=True)
    )
    trust = trust._replace(tilt=tilt, heading=heading, position=position, lessons=lessons)
    # What may be error or drift counts as error here: uncertainty must not be too small.
    firm = xp.log(constant(_prior(params.drift_prior), trust.tilt))
    rad2, m2 = (
        xp.sum(_softmax(likelihood + firm) * one.variance, axis=-1)
        for likelihood, one in zip((heading, position), evidence[1:], strict=True)
    )
    return trust._replace(
        noise_m=trust.noise_m + rate * (xp.sqrt(m2) - trust.noise_m),
        noise_rad=trust.noise_rad + rate * (xp.sqrt(rad2) - trust.noise_rad),
    )
