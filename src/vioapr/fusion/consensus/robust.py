"""What the two robust means of method `consensus` have in common."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.votes import Votes
from vioapr.geometry.arrays import Array, Mask, constant, namespace
from vioapr.geometry.tree import tree_map

ITERATIONS = 2

_GATE = 4.0
"""Squared errors, in units of the typical one, from which a vote counts as an outlier."""

_MEDIAN_CHI2 = 2.366
"""Median of the chi-squared distribution with three degrees of freedom."""

_NEWEST = 7
"""Votes whose common disagreement with the mean raises doubt."""

_FEW = 5
"""Votes from which on a median residual says something."""


class Fit(NamedTuple):
    """A robust mean.

    Attributes:
        mean: Rotation as quaternion xyzw of world_from_vio, shape (..., 4, 1), or the camera's
            position in m, shape (..., 3, 1).
        samples: The votes relative to the start, shape (..., 3, n), m or rad.
        independent: Shape (..., 3, 1): how many independent votes each axis rests on.
        scatter: Shape (..., 1, 1), typical error of a vote per axis.
        distrust: Shape (..., 1, n), (residual / scatter)^2.
        excess: Shape (..., 1, n), by how much outliers' variance is larger than that of the
            others. What VIO has drifted does not make a vote an outlier.
        doubt: Shape (..., 1, 1), variance by which the newest votes disagree with the mean.
    """

    mean: Array
    samples: Array
    independent: Array
    scatter: Array
    distrust: Array
    excess: Array
    doubt: Array


def newest(values: Array) -> Array:
    """Of the votes whose common disagreement with the mean raises doubt, shape (..., k, m)."""
    return values[..., : min(_NEWEST, values.shape[-1])]


class Typical(NamedTuple):
    """Picks the lower median of some votes' values.

    Attributes:
        absent: Shape (..., k, n), a huge number for votes that do not count, else 0.
        is_middle: Shape (..., k, n), 1 at the median's place in the sorted values, else 0.
        is_few: Shape (..., k, 1), whether too few votes count.
    """

    absent: Array
    is_middle: Array
    is_few: Mask

    def row(self, index: int) -> Typical:
        """One of the k choices of votes."""
        return tree_map(lambda part: part[..., index : index + 1, :], self)

    def median(self, values: Array) -> Array:
        """Of values of shape (..., 1, n), k being 1."""
        return namespace(values).sort(values + self.absent, axis=-1) @ self.is_middle.mT


def typical_of(counts: Array) -> Typical:
    """Of the votes where `counts`, shape (..., k, n), is 1 and not 0."""
    xp = namespace(counts)
    number = total(counts)
    index = constant(_indices(counts.shape[-1]), counts)
    is_middle = xp.astype(index == xp.floor((number - 1) / 2), counts.dtype)
    return Typical((1 - counts) * 1e12, is_middle, number < _FEW)


@cache
def _indices(count: int) -> np.ndarray:
    return np.arange(float(count))


@cache
def _ones(count: int) -> np.ndarray:
    return np.ones((count, 1))


class Ballot(NamedTuple):
    """What the votes' weights depend on besides their residuals, of orientation or position.

    Attributes:
        votes: The memory.
        shares: See `views.view_shares`, shape (..., 1, n).
        base: Votes' variances in units of the usual one: as the regressor states, and what VIO
            has drifted since, shape (..., k, n).
        fresh: The votes that the scatter is judged by: those since the last jump.
        newest: The newest few votes.
        last: The scatter at the last vote, shape (..., 1, 1).
        noise: Typical error of a prediction, shape (..., 1, 1).
    """

    votes: Votes
    shares: Array
    base: Array
    fresh: Typical
    newest: Typical
    last: Array
    noise: Array

    def scatter2(self, squares: Array, limits: tuple[float, float]) -> Array:
        """The typical squared residual per axis, shape (..., 1, 1).

        Args:
            squares: Squared residuals, shape (..., 1, n).
            limits: Of the scatter.
        """
        xp = namespace(squares)
        median = self.fresh.median(squares) / _MEDIAN_CHI2
        median = xp.where(self.fresh.is_few, self.last * self.last, median)
        return xp.minimum(xp.maximum(median, limits[0] ** 2), limits[1] ** 2)

    def finish(
        self, mean: Array, samples: Array, independent: Array, squares: Array, scatter2: Array
    ) -> Fit:
        """The fit that iterations have led to.

        Args:
            mean: See `Fit`.
            samples: See `Fit`.
            independent: See `Fit`.
            squares: Squared residuals, shape (..., 1, n).
            scatter2: Square of the scatter.
        """
        xp = namespace(squares)
        distrust = squares / scatter2
        outlying = distrust / (3 * self.base[..., -1:, :]) - _GATE
        excess = xp.maximum(outlying, 0.0)
        # Most of the newest votes are farther off than usual, as when the camera is covered:
        # either they are wrong, or the mean is.
        usual = self.newest.median(newest(squares)) / 3
        doubt = usual - _GATE * self.noise * self.noise
        doubt = xp.maximum(doubt, 0.0)
        return Fit(mean, samples, independent, xp.sqrt(scatter2), distrust, excess, doubt)


def total(values: Array) -> Array:
    """Sum over the votes, shape (..., k, n) to (..., k, 1)."""
    return values @ constant(_ones(values.shape[-1]), values)


def squared_length(vectors: Array) -> Array:
    """Of each vote's vector, shape (..., 3, n) to (..., 1, n)."""
    return constant(_SUM_OF_THREE, vectors) @ (vectors * vectors)


_SUM_OF_THREE = np.ones((1, 3))


def best_supported(candidates: Array, nearness: Array, ballot: Ballot) -> Array:
    """The vote that most others are near to, shape (..., d, 1): where to start among outliers.

    Votes count the less, and are the less eligible, the more VIO has drifted since.

    Args:
        candidates: Shape (..., d, n).
        nearness: Of each two, shape (..., n, n), up to a factor.
        ballot: Of the votes.
    """
    xp = namespace(nearness)
    base = ballot.base[..., -1:, :]
    support = (ballot.shares / base) @ nearness * ballot.votes.is_valid / base
    best = xp.astype(xp.argmax(support, axis=-1, keepdims=True), support.dtype)
    is_best = xp.astype(constant(_indices(support.shape[-1]), support) == best, support.dtype)
    return candidates @ is_best.mT


def independent_votes(weights: Array, denominators: Array) -> Array:
    """How many independent votes a mean rests on: views count, not votes, shape (..., k, 1).

    Args:
        weights: Shares over the denominators, shape (..., k, n).
        denominators: Likewise.
    """
    number = total(weights) ** 2 / (total(weights / denominators) + 1e-12)
    return namespace(number).maximum(number, 1.0)
