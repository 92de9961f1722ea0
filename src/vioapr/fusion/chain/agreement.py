"""Whether predictions and motion belong together: is the user where the map is at all?

Outside the map a regressor still answers: anything, always the same, or motion at a fraction of
its size. A camera that is turned against the tracker's predicts motion about wrong axes. In all
of these cases predictions may agree well enough with one another. What they have in common is
that they do not tell of the motion that the tracker has seen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.columns import since
from vioapr.fusion.chain.hypotheses import Hypotheses
from vioapr.fusion.chain.sums import row_sum, squared_length, total, typical_of
from vioapr.fusion.chain.window import Window, is_among_newest
from vioapr.geometry.arrays import Array, Mask, constant, namespace, zeros

_LEAST_WAY_M, _LEAST_WAY_PER_M = 0.5, 4.0
"""Ways over which the slope is judged: this long, plus this multiple of the scatter."""

_SLOPE_MEMORY = 0.1
"""Least weight of a new prediction in the running mean of the slope."""

_SLOPE_LIMITS = (-1.0, 3.0)

_ROLL_RAD = 0.1
"""Typical error of a relative rotation, when those of four rolls are compared."""

_ROLL_MEMORY = 0.05
"""Weight of a new prediction in the running mean over rolls."""

_LEAST_TURN2 = 0.03
"""Squared sine of half a turn that tells rolls apart well: about 20 degrees."""

_ROLL_LEAD = 0.2
"""By how much more a roll has to explain to be believed."""

_BAD_AGREEMENT, _GOOD_AGREEMENT = 0.15, 0.3
_BAD_SLOPE, _GOOD_SLOPE = 0.45, 0.6
_BAD_SCATTER2 = 0.07
"""Squared scatter of orientation beyond what a regressor that is of use can have, rad^2."""

_FOUND, _SURE, _UNSURE = 1.5, 0.6, 0.4
"""Evidence from which on the place counts as found, and confidence from which on it is sure and
below which it is not any more."""

_FULL_AGREEMENT = 0.7
"""Of predictions of which every fourth is wild."""

_HERE, _CONFIDENCE, _IS_SURE, _WAS_FOUND = (slice(k, k + 1) for k in range(4))
_AT_FIRST = np.array([[1.0], [0.0], [0.0], [0.0]])


class Agreement(NamedTuple):
    """What is remembered of it.

    Attributes:
        beyond: By how much the typical squares exceed what a regressor may err by, rad^2 and
            m^2, shape (..., 2, 1).
        surprise: Running mean of the squared distances of predictions from what was expected,
            rad^2 and m^2, shape (..., 2, 1).
        rolls: Share of relative rotations that fit if the camera is turned about its axis by
            0, 90, 180 and 270 degrees against the tracker's, shape (..., 4, 1).
        verdict: Whether the user is where the map is, 1 or 0, with hysteresis; the probability
            that the leading hypothesis is the right one; whether that is enough, with
            hysteresis; and whether it ever was in this tracking world, shape (..., 4, 1).
    """

    beyond: Array
    surprise: Array
    rolls: Array
    verdict: Array

    @property
    def is_here(self) -> Mask:
        """Whether the user is where the map is, shape (..., 1, 1)."""
        return self.verdict[..., _HERE, :] > 0

    @property
    def confidence(self) -> Array:
        """Probability that the leading hypothesis is the right one, shape (..., 1, 1)."""
        return self.verdict[..., _CONFIDENCE, :]

    @property
    def is_sure(self) -> Mask:
        """Whether that is enough, shape (..., 1, 1)."""
        return self.verdict[..., _IS_SURE, :] > 0

    @property
    def was_found(self) -> Mask:
        """Whether it ever was in this tracking world, shape (..., 1, 1)."""
        return self.verdict[..., _WAS_FOUND, :] > 0

    def unsure(self, is_back: Mask, is_new: Mask) -> Agreement:
        """After a loss of tracking, and in a new tracking world, shapes (..., 1, 1)."""
        xp = namespace(self.verdict)
        here = self.verdict[..., _HERE, :]
        doubts = self.verdict * constant(np.array([[1.0], [1.0], [0.0], [1.0]]), here)
        verdict = xp.where(is_back, doubts, self.verdict)
        nothing = here * constant(_AT_FIRST, here)
        return self._replace(verdict=xp.where(is_new, nothing, verdict))


def no_agreement(batch_shape: tuple[int, ...], like: Array) -> Agreement:
    """Before the first prediction."""

    def nothing(rows: int) -> Array:
        return zeros((*batch_shape, rows, 1), like)

    first = nothing(4) + constant(_AT_FIRST, like)
    return Agreement(nothing(2), nothing(2), nothing(4), first)


def compare_motion(
    hypotheses: Hypotheses, window: Window, ways_m: Array, scatter_m: Array, newness: Array
) -> tuple[Array, Array]:
    """The slope of predicted on tracked motion, and its lessons, shapes (..., 2, 1, 1).

    It is that of the newest prediction against the older ones: their median.

    Args:
        hypotheses: Both, as of before.
        window: Past predictions.
        ways_m: The tracker's ways since, in the world, shape (..., 2, 3, n).
        scatter_m: Typical residual per axis, shape (..., 1, 1).
        newness: Share of the newest prediction that is new and fits, shape (..., 2, 1, 1).
    """
    xp = namespace(ways_m)
    way2 = squared_length(ways_m)
    least = (_LEAST_WAY_M + _LEAST_WAY_PER_M * scatter_m)[..., None, :, :]
    counts = window.is_valid[..., None, :, :] * xp.astype(way2 > least * least, way2.dtype)
    predicted = (window.place_m[..., :1] - window.place_m)[..., None, :, :]
    ratio = row_sum(predicted * ways_m) / xp.maximum(way2, 1e-6)
    ratio = xp.minimum(xp.maximum(ratio, _SLOPE_LIMITS[0]), _SLOPE_LIMITS[1])
    typical = typical_of(counts)
    new = xp.where(typical.is_few, 0.0, newness)
    lessons = hypotheses.lessons + new
    rate = new * xp.maximum(1 / (1 + lessons), _SLOPE_MEMORY)
    slope = hypotheses.slope + rate * (typical.median(ratio) - hypotheses.slope)
    return slope, lessons


def compare_rolls(window: Window) -> Array:
    """How well rotations since the older predictions fit the tracker's, for four rolls.

    A camera that is turned about its axis sees the tracker's turn v as r^-1 v r. Shape
    (..., 4, 1), 0 to 1.
    """
    xp = namespace(window.rows)
    turns = window.turns
    moved = since(turns, turns[..., :1])
    apr, vio = moved[..., 0, :, :], moved[..., 1, :, :]
    crossed = apr[..., :1, :] * vio[..., 1:2, :] - apr[..., 1:2, :] * vio[..., :1, :]
    products = xp.concat([apr * vio, crossed, vio * vio], axis=-2)
    terms = constant(_ROLL_TERMS, products) @ products
    cosines, tilting = terms[..., :4, :], terms[..., 4:, :]
    gaps2 = xp.maximum(4 * (1 - cosines * cosines), 0.0)
    weight = window.is_valid * xp.minimum(tilting / _LEAST_TURN2, 1.0)
    weight = weight * constant(1 - is_among_newest(weight.shape[-1], 1), weight)
    return total(weight / (1 + gaps2 / (3 * _ROLL_RAD**2))) / xp.maximum(total(weight), 1.0)


_ROLL_TERMS = np.array(
    [
        [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [-1.0, -1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0],
    ]
)
"""Scalar products of the two rotations' quaternions for four rolls, and how far the tracker
turned about other axes than the camera's; from products of x, y, z, w, the cross product in the
image, and squares of x, y, z, w."""


def judge(agreement: Agreement, hypotheses: Hypotheses, rolls: Array, newness: Array) -> Agreement:
    """With a prediction: whether the user is where the map is, and how sure that is.

    Args:
        agreement: Of before, with the newest scatter beyond limits and surprise.
        hypotheses: With that prediction.
        rolls: Of `compare_rolls`.
        newness: Share of the newest prediction that is new, shape (..., 1, 1).
    """
    xp = namespace(rolls)
    mean = agreement.rolls + _ROLL_MEMORY * newness * (rolls - agreement.rolls)
    turned = xp.max(mean[..., 1:, :], axis=-2, keepdims=True) - mean[..., :1, :]
    scatter2 = agreement.beyond[..., :1, :]
    leading, slope = hypotheses.agreement[..., 0, :, :], hypotheses.slope[..., 0, :, :]
    is_bad = (leading < _BAD_AGREEMENT) | (slope < _BAD_SLOPE)
    is_bad = is_bad | (scatter2 > _BAD_SCATTER2) | (turned > _ROLL_LEAD)
    is_good = (leading > _GOOD_AGREEMENT) & (slope > _GOOD_SLOPE)
    is_good = is_good & (scatter2 <= 0) & (turned < _ROLL_LEAD / 2)
    is_here = xp.where(is_bad, 0.0, xp.where(is_good, 1.0, agreement.verdict[..., _HERE, :]))
    share = (leading - _BAD_AGREEMENT) / (_FULL_AGREEMENT - _BAD_AGREEMENT)
    share = xp.minimum(xp.maximum(share, 0.0), 1.0)
    confidence = is_here * share * (1 - hypotheses.other_share)
    evidence = hypotheses.evidence[..., 0, :, :]
    becomes_sure = (confidence > _SURE) & (evidence > _FOUND)
    stays_sure = (confidence > _UNSURE) & agreement.is_sure
    is_sure = xp.astype(becomes_sure | stays_sure, confidence.dtype)
    was_found = xp.maximum(is_sure, agreement.verdict[..., _WAS_FOUND, :])
    verdict = xp.concat([is_here, confidence, is_sure, was_found], axis=-2)
    return agreement._replace(rolls=mean, verdict=verdict)
