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

from vioapr.fusion.chain.columns import rotation_matrix, turned, turns_from
from vioapr.fusion.chain.sums import largest, squared_lengths
from vioapr.fusion.chain.window import pushed
from vioapr.geometry.arrays import Array, Mask, constant, holds_nowhere, namespace, zeros
from vioapr.geometry.tree import tree_map

_LEADS = np.array([1.0, 0.0])[:, None, None]
_CHALLENGES = 1 - _LEADS

MOST_EVIDENCE = 8.0
"""Evidence is bounded, so that what was long right can be left: after about this many
predictions of new views to the contrary, and as many for the challenger."""

EVIDENCE_AFTER_LOSS = 3.0
"""What is kept of it over a loss of tracking: the world may be another one."""

_LEAST_LEAD = 0.5
"""Evidence by which the challenger has to be ahead."""

_WEAK = 1.0
"""A challenger with no more evidence than that gives way to a new one."""

_SAME = 0.25
"""Hypotheses whose squared distance is below this share of the gate's are one."""

_AGREEMENT_MEMORY = 0.1
"""Weight of a new prediction in the mean of how well predictions fit."""


class Hypotheses(NamedTuple):
    """Both, as of the last prediction; leading one first along the axis before the last two.

    Attributes:
        world_from_vio: Rotation as quaternion xyzw, shape (..., 2, 4, 1).
        place_m: Where the camera was, in the world, shape (..., 2, 3, 1).
        path: How each prediction's frame lies about that, as smoothed: rotation vectors about
            the world's axes, rad, and positions as carried to the newest by VIO, m, shape
            (..., 2, 6, n).
        precision: Of the newest along the six axes, 1/rad^2 and 1/m^2, shape (..., 2, 6, 1).
        depth_m: Distance of what the regressor looks at, shape (..., 2, 1, 1).
        evidence: Shape (..., 2, 1, 1).
        agreement: Running mean of how well predictions fit, 0 to 1, shape (..., 2, 1, 1).
        slope: Predicted motion over the tracker's, shape (..., 2, 1, 1).
        lessons: How many predictions of new views the slope rests on, shape (..., 2, 1, 1).
    """

    world_from_vio: Array
    place_m: Array
    path: Array
    precision: Array
    depth_m: Array
    evidence: Array
    agreement: Array
    slope: Array
    lessons: Array

    def carry(self, moved_m: Array) -> Array:
        """The camera's places, after the tracker has moved, shape (..., 2, 3, 1)."""
        return self.place_m + rotation_matrix(self.world_from_vio) @ moved_m[..., None, :, :]

    def push(self, place_m: Array, moves: Array) -> Hypotheses:
        """With a new newest frame, that no prediction has corrected yet.

        Args:
            place_m: Of `carry`.
            moves: See `Window.moving`.
        """
        first = namespace(place_m).zeros_like(self.path[..., :1])
        path = pushed(self.path, first, moves[..., None, :, :])
        return self._replace(place_m=place_m, path=path)

    def weigh(self, fit: Array, newness: Array) -> Hypotheses:
        """With a prediction's evidence.

        Args:
            fit: How well it fits, 0 to 1, shape (..., 2, 1, 1).
            newness: Share of it that is new, as views share their bias, shape (..., 1, 1).
        """
        xp = namespace(fit)
        new = newness[..., None, :, :]
        evidence = xp.minimum(self.evidence + new * (2 * fit - 1), MOST_EVIDENCE)
        agreement = self.agreement + _AGREEMENT_MEMORY * new * (fit - self.agreement)
        return self._replace(evidence=xp.maximum(evidence, 0.0), agreement=agreement)

    def challenge(self, fits: Mask, gates: Array, rotation: Array, place_m: Array) -> Hypotheses:
        """With a challenger that begins at the newest prediction, where one is needed.

        Args:
            fits: Whether that prediction fits, shape (..., 2, 1, 1).
            gates: Squared distances within which it would, rad^2 and m^2, shape (..., 2, 2, 1).
            rotation: world_from_vio by that prediction, shape (..., 4, 1).
            place_m: Its place, shape (..., 3, 1).
        """
        xp = namespace(gates)
        leader, other = ((..., slice(k, k + 1), slice(None), slice(None)) for k in range(2))
        gap = xp.concat(
            [
                turns_from(self.world_from_vio[other], self.world_from_vio[leader]),
                self.place_m[other] - self.place_m[leader],
            ],
            axis=-2,
        )
        nearness = squared_lengths(gap) / gates[leader]
        is_same = largest(nearness) < _SAME
        is_weak = ~fits[other] & (self.evidence[other] <= _WEAK)
        begins = ~fits[leader] & (is_weak | is_same)
        evidence = xp.where(is_same | begins, xp.astype(begins, gates.dtype), self.evidence[other])
        here = self._replace(evidence=xp.concat([self.evidence[leader], evidence], axis=-3))
        starts = begins & (constant(_CHALLENGES, gates) > 0)
        return here.restarted(starts, rotation, place_m)

    def restarted(self, starts: Mask, rotation: Array, place_m: Array) -> Hypotheses:
        """Begun at a prediction where `starts` says so, shape (..., 2, 1, 1)."""
        if holds_nowhere(starts):
            return self
        xp = namespace(place_m)
        new = self._replace(
            world_from_vio=rotation[..., None, :, :] + 0 * self.world_from_vio,
            place_m=place_m[..., None, :, :] + 0 * self.place_m,
            path=xp.zeros_like(self.path),
            agreement=xp.zeros_like(self.agreement) + 0.5,
            slope=xp.ones_like(self.slope),
            lessons=xp.zeros_like(self.lessons),
        )
        return tree_map(lambda a, b: xp.where(starts, a, b), new, self)

    def overtake(self) -> tuple[Hypotheses, Mask]:
        """In order of evidence; and whether the challenger leads now, shape (..., 1, 1)."""
        xp = namespace(self.evidence)
        lead = self.evidence[..., 1:, :, :] - self.evidence[..., :1, :, :]
        swaps = lead > _LEAST_LEAD
        if holds_nowhere(swaps):
            return self, swaps[..., 0, :, :]
        ordered = tree_map(lambda part: xp.where(swaps, xp.flip(part, axis=-3), part), self)
        return ordered, swaps[..., 0, :, :]

    def corrected(self, path: Array, precision: Array, depth_m: Array) -> Hypotheses:
        """About the newest frame as smoothed.

        Args:
            path: See `Hypotheses`, about the newest frame as it was.
            precision: Of the newest, shape (..., 2, 6, 1).
            depth_m: See `Hypotheses`.
        """
        newest = path[..., :1]
        return self._replace(
            world_from_vio=turned(self.world_from_vio, newest[..., :3, :]),
            place_m=self.place_m + newest[..., 3:, :],
            path=path - newest,
            precision=precision,
            depth_m=depth_m,
        )


def no_hypotheses(batch_shape: tuple[int, ...], count: int, like: Array) -> Hypotheses:
    """Before the first prediction."""

    def both(rows: int, columns: int = 1) -> Array:
        return zeros((*batch_shape, 2, rows, columns), like)

    identity = constant(np.array([[0.0], [0.0], [0.0], [1.0]]), like)
    return Hypotheses(
        both(4) + identity,
        both(3),
        both(6, count),
        both(6) + 1.0,
        both(1),
        both(1) + constant(_LEADS, like),
        both(1) + 0.5,
        both(1) + 1.0,
        both(1),
    )


def begun(hypotheses: Hypotheses, is_known: Mask, rotation: Array, place_m: Array) -> Hypotheses:
    """Started at a prediction, where nothing was known before it.

    Args:
        hypotheses: Of before.
        is_known: Shape (..., 1, 1).
        rotation: world_from_vio by that prediction, shape (..., 4, 1).
        place_m: Its place, shape (..., 3, 1).
    """
    xp = namespace(place_m)
    starts = ~is_known[..., None, :, :]
    if holds_nowhere(starts):
        return hypotheses
    begun = hypotheses.restarted(starts, rotation, place_m)
    evidence = xp.where(starts, constant(_LEADS, place_m), begun.evidence)
    return begun._replace(evidence=evidence)
