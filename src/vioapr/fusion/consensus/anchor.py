"""The latest estimate of method `consensus`, from which VIO carries on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vioapr.fusion.consensus.drift import CORRELATED_PART
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.robust import Fit
from vioapr.geometry.arrays import Array, Mask, constant, namespace, zeros

_COMMON_BIAS = np.array([[0.2], [0.5]])
"""Share of the errors' variance that all views of a place have in common, and that no
comparison of votes can show; of orientation and position."""

_GRAVITY_RAD = 0.004
"""Error of a tracker's gravity, rad."""

_POSITION_ROW = np.array([[0.0], [1.0]])
_TILTS = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])


class Anchor(NamedTuple):
    """The estimate at the last vote; variances and drifts of orientation and position.

    Attributes:
        world_from_vio: Rotation, quaternion xyzw, shape (..., 4, 1); the tracking world is z up.
        matrix: The same rotation, shape (..., 3, 3).
        position_m: The camera's then, in the world, shape (..., 3, 1).
        vio_place_m: The tracker's position then, shape (..., 3, 1).
        is_known: Whether there is an estimate, shape (..., 1, 1).
        variances: About and along the axes of the world, rad^2 and m^2, shape (..., 2, 3).
        drifts: Variance that a metre of motion adds to each axis, shape (..., 2, 1).
        odometer: Its readings then, shape (..., 3, 1).
    """

    world_from_vio: Array
    matrix: Array
    position_m: Array
    vio_place_m: Array
    is_known: Mask
    variances: Array
    drifts: Array
    odometer: Array

    def carry(self, vio_place_m: Array) -> Array:
        """A place of the tracking world in the world, shapes (..., 3, 1)."""
        return self.position_m + self.matrix @ (vio_place_m - self.vio_place_m)

    def deviations(self, vio_place_m: Array, odometer: Array) -> Array:
        """Standard deviations now: of then, and of what VIO may have drifted since, (..., 2, 3).

        Args:
            vio_place_m: Where the tracker is now, shape (..., 3, 1).
            odometer: Its readings now.
        """
        xp = namespace(odometer)
        since = odometer - self.odometer
        moved = vio_place_m - self.vio_place_m
        growth = self.drifts * since[..., :1, :] + since[..., 1:, :]
        turned = self.variances[..., :1, :] + growth[..., :1, :]
        by_turn = xp.max(turned, axis=-1, keepdims=True) * (moved.mT @ moved)
        return xp.sqrt(self.variances + growth + constant(_POSITION_ROW, growth) * by_turn)


def no_anchor(batch_shape: tuple[int, ...], like: Array) -> Anchor:
    """Before the first vote."""

    def nothing(*axes: int) -> Array:
        return zeros((*batch_shape, *axes), like)

    identity = nothing(4, 1) + constant(np.array([[0.0], [0.0], [0.0], [1.0]]), like)
    return Anchor(
        identity,
        nothing(3, 3),
        nothing(3, 1),
        nothing(3, 1),
        nothing(1, 1) > 0,
        nothing(2, 3),
        nothing(2, 1),
        nothing(3, 1),
    )


def variances_of(params: ConsensusParams, noise: Array, fits: tuple[Fit, Fit]) -> Array:
    """Of the means of rotation and position, per axis of the world, shape (..., 2, 3).

    Args:
        params: Of the method.
        noise: Typical error of a prediction, rad and m, shape (..., 2, 1).
        fits: Of rotation and position.
    """
    xp = namespace(noise)
    common = constant(_COMMON_BIAS, noise)
    independent = xp.concat([fit.independent.mT for fit in fits], axis=-2)
    doubt = xp.concat([fit.doubt for fit in fits], axis=-2)
    variances = noise * noise * (common + (1 - common) / independent) + doubt
    if params.gravity == "known":
        tilts = constant(_TILTS, variances)
        variances = variances * (1 - tilts) + tilts * _GRAVITY_RAD**2
    return variances


def drifts_of(rates: Array, noise: Array) -> Array:
    """Of heading and position, in rad^2 and m^2 a metre, shape (..., 2, 1).

    Args:
        rates: See `trust.Trust`.
        noise: Typical error of a prediction, rad and m.
    """
    return CORRELATED_PART * rates[..., 1:, :] * noise * noise
