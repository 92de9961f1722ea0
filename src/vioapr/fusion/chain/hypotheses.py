"""The two hypotheses of method `chain` about where the tracking world lies in the map.

The leading one is the answer. The other one, the challenger, begins at a prediction that
neither explains, and is smoothed from the same window. Each collects evidence: what a
prediction of a new view says for or against it. The challenger takes over once it has more of
it; so one prediction alone never moves the answer, and a world that was changed without notice,
a wrong start or an updated map are left after a few predictions that agree.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.columns import rotation_matrix, turns_from
from vioapr.fusion.chain.sums import largest, squared_lengths
from vioapr.geometry.arrays import Array, Mask, constant, holds_nowhere, namespace, zeros
from vioapr.geometry.tree import tree_map

CHALLENGES = np.array([0.0, 1.0])[:, None, None]
"""Which of the two does not lead, shape (2, 1, 1)."""

MOST_EVIDENCE = 8.0
"""Evidence is bounded, so that what was long right can be left: after about this many
predictions of new views to the contrary, and as many for the challenger."""

EVIDENCE_AFTER_LOSS = 3.0
"""What is kept of it over a loss of tracking: the world may be another one."""

_LEAST_LEAD = 0.5
"""Evidence by which the challenger has to be ahead."""

_CONFIRMED = 1.2
"""More than one prediction gives."""

_WEAK = 1.0
"""A challenger with no more evidence than that gives way to a new one."""

_SAME = 0.25
"""Hypotheses whose squared distance is below this share of the gate's are one."""

_AGREEMENT_MEMORY = 0.1
"""Weight of a new prediction in the mean of how well predictions fit."""

_FIRST_AGREEMENT, _LEADING_AGREEMENT = 0.1, 0.5
"""Of a challenger that has begun, and at least of one that has come to lead."""

_TURN, _PLACE, _PRECISION = slice(0, 4), slice(4, 7), slice(7, 13)
_DEPTH, _EVIDENCE, _AGREEMENT = slice(13, 14), slice(14, 15), slice(15, 16)
_SLOPE, _LESSONS = slice(16, 17), slice(17, 18)
_ROWS = 18
_IDENTITY = np.array([[0.0], [0.0], [0.0], [1.0]])


class Hypotheses(NamedTuple):
    """Both, as of the last prediction; leading one first along the axis before the last two.

    Attributes:
        rows: Shape (..., 2, 18, 1): see the properties.
        path: How each prediction's frame lies about the newest, as smoothed: rotation vectors
            about the world's axes, rad, and positions as carried to the newest by VIO, m, shape
            (..., 2, 6, n).
    """

    rows: Array
    path: Array

    @property
    def world_from_vio(self) -> Array:
        """Rotation as quaternion xyzw, shape (..., 2, 4, 1)."""
        return self.rows[..., _TURN, :]

    @property
    def place_m(self) -> Array:
        """Where the camera was, in the world, shape (..., 2, 3, 1)."""
        return self.rows[..., _PLACE, :]

    @property
    def precision(self) -> Array:
        """Of the newest frame along the six axes, 1/rad^2 and 1/m^2, shape (..., 2, 6, 1)."""
        return self.rows[..., _PRECISION, :]

    @property
    def depth_m(self) -> Array:
        """Distance of what the regressor looks at, shape (..., 2, 1, 1)."""
        return self.rows[..., _DEPTH, :]

    @property
    def evidence(self) -> Array:
        """For each, at least 0, shape (..., 2, 1, 1)."""
        return self.rows[..., _EVIDENCE, :]

    @property
    def agreement(self) -> Array:
        """Running mean of how well predictions fit, 0 to 1, shape (..., 2, 1, 1)."""
        return self.rows[..., _AGREEMENT, :]

    @property
    def slope(self) -> Array:
        """Predicted motion over the tracker's, shape (..., 2, 1, 1)."""
        return self.rows[..., _SLOPE, :]

    @property
    def lessons(self) -> Array:
        """How many predictions of new views the slope rests on, shape (..., 2, 1, 1)."""
        return self.rows[..., _LESSONS, :]

    @property
    def matrices(self) -> Array:
        """Rotations of world_from_vio, shape (..., 2, 3, 3)."""
        return rotation_matrix(self.world_from_vio)

    @property
    def other_share(self) -> Array:
        """Probability that the challenger is right and not the leader, shape (..., 1, 1).

        By how many predictions fit the one and the other, beyond that at which it began.
        """
        leading, other = self.agreement[..., 0, :, :], self.agreement[..., 1, :, :]
        other = namespace(other).maximum(other - _FIRST_AGREEMENT, 0.0)
        return other / (leading + other + 1e-6)

    def support(self, fit: Array, newness: Array) -> tuple[Array, Array]:
        """Evidence and agreement with a prediction, shapes (..., 2, 1, 1).

        Args:
            fit: How well it fits, 0 to 1, shape (..., 2, 1, 1).
            newness: Share of it that is new, as views share their bias, shape (..., 1, 1, 1).
        """
        xp = namespace(fit)
        evidence = xp.minimum(self.evidence + newness * (2 * fit - 1), MOST_EVIDENCE)
        agreement = self.agreement + _AGREEMENT_MEMORY * newness * (fit - self.agreement)
        return xp.maximum(evidence, 0.0), agreement

    def bounded(self, most: Array) -> Hypotheses:
        """With no more evidence than that, shape (..., 1, 1)."""
        xp = namespace(self.rows)
        less = xp.minimum(self.evidence, most[..., None, :, :])
        parts = [self.rows[..., : _EVIDENCE.start, :], less, self.rows[..., _EVIDENCE.stop :, :]]
        return self._replace(rows=xp.concat(parts, axis=-2))

    def challenge(self, fits: Mask, gates: Array, first: Array) -> Hypotheses:
        """With a challenger that begins at the newest prediction, where one is needed.

        Args:
            fits: Whether that prediction fits, shape (..., 2, 1, 1).
            gates: Squared distances within which it would, rad^2 and m^2, shape (..., 2, 2, 1).
            first: What a hypothesis is that begins there, see `beginning`.
        """
        xp = namespace(gates)
        leader, other = ((..., slice(k, k + 1), slice(None), slice(None)) for k in range(2))
        turns = turns_from(self.world_from_vio[other], self.world_from_vio[leader])
        gap = xp.concat([turns, self.place_m[other] - self.place_m[leader]], axis=-2)
        is_same = largest(squared_lengths(gap) / gates[leader]) < _SAME
        is_weak = ~fits[other] & (self.evidence[other] <= _WEAK)
        begins = ~fits[leader] & (is_weak | is_same)
        # One of two that are the same is enough.
        alone = constant(_OTHER_EVIDENCE, gates) * xp.astype(is_same, gates.dtype)
        kept = Hypotheses(self.rows * (1 - alone), self.path)
        if holds_nowhere(begins):
            return kept
        starts = begins & (constant(CHALLENGES, gates) > 0)
        begun = Hypotheses(first[..., None, :, :] + 0 * self.rows, xp.zeros_like(self.path))
        return tree_map(lambda a, b: xp.where(starts, a, b), begun, kept)

    def overtake(self, is_known: Mask) -> tuple[Hypotheses, Mask]:
        """In order of evidence; and whether the challenger leads now, shape (..., 1, 1, 1).

        Args:
            is_known: Whether there is a leader at all, shape (..., 1, 1, 1): if so, the
                prediction at which the challenger began is not enough.
        """
        xp = namespace(self.rows)
        leader, other = self.evidence[..., :1, :, :], self.evidence[..., 1:, :, :]
        swaps = (other > leader + _LEAST_LEAD) & ((other > _CONFIRMED) | ~is_known)
        if holds_nowhere(swaps):
            return self, swaps
        ordered = tree_map(lambda part: xp.where(swaps, xp.flip(part, axis=-3), part), self)
        gains = swaps & (constant(_LEADING_ROW, leader) > 0)
        rows = xp.where(gains, xp.maximum(ordered.rows, _LEADING_AGREEMENT), ordered.rows)
        return ordered._replace(rows=rows), swaps


def _only(which: int, row: slice) -> np.ndarray:
    """1 in a row of one hypothesis, else 0, shape (2, 18, 1)."""
    rows = np.zeros((2, _ROWS, 1))
    rows[which, row] = 1.0
    return rows


_LEADING_ROW = _only(0, _AGREEMENT)
_OTHER_EVIDENCE = _only(1, _EVIDENCE)


def assemble(
    world_from_vio: Array,
    place_m: Array,
    precision: Array,
    depth_m: Array,
    evidence: Array,
    agreement: Array,
    slope: Array,
    lessons: Array,
) -> Array:
    """The rows of `Hypotheses`, of the shapes of its properties."""
    parts = [world_from_vio, place_m, precision, depth_m, evidence, agreement, slope, lessons]
    return namespace(place_m).concat(parts, axis=-2)


def beginning(world_from_vio: Array, place_m: Array, precision: Array) -> Array:
    """The rows of a hypothesis that begins at a prediction, shape (..., 18, 1).

    Args:
        world_from_vio: Rotation by that prediction, shape (..., 4, 1).
        place_m: Its place, shape (..., 3, 1).
        precision: Its own, shape (..., 6, 1).
    """
    xp = namespace(place_m)
    nothing = xp.zeros_like(place_m[..., :1, :])
    one = nothing + 1.0
    rest = (nothing, one, nothing + _FIRST_AGREEMENT, one, nothing)
    return assemble(world_from_vio, place_m, precision, *rest)


def no_hypotheses(batch_shape: tuple[int, ...], count: int, like: Array) -> Hypotheses:
    """Before the first prediction: nothing speaks for either."""
    place_m = zeros((*batch_shape, 3, 1), like)
    identity = zeros((*batch_shape, 4, 1), like) + constant(_IDENTITY, like)
    first = beginning(identity, place_m, zeros((*batch_shape, 6, 1), like) + 1.0)
    rows = zeros((*batch_shape, 2, _ROWS, 1), like) + first[..., None, :, :]
    path = zeros((*batch_shape, 2, 6, count), like)
    return Hypotheses(rows, path).bounded(zeros((*batch_shape, 1, 1), like))
