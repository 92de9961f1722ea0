"""Baseline: a mean of the latest corrections, without those that stray.

Every prediction gives a correction, the `world_from_vio` that would make VIO agree with it. The
estimate is the mean of the latest ones; those farther from it than their root-mean-square
deviation are dropped, and the mean is taken again. Position and orientation are filtered each by
itself. Filters of this kind smooth the answers of localization services in AR frameworks, such as
Immersal's. A filter knows neither how far VIO has drifted nor how good a prediction is.

Corrections are averaged as they are, so a turn of one moves the camera by as much more as it is
farther from where tracking began.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import tyro

from vioapr.errors import ParameterError
from vioapr.fusion.alignment import hide_unless, push
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry.arrays import Array, compute_where, namespace, norm, select, zeros
from vioapr.geometry.averaging import mean_quaternion
from vioapr.geometry.quaternion import angle_between_deg
from vioapr.geometry.rigid import Rigid3, choose

_TIE = 1e-3
"""Two corrections both lie exactly one deviation from their mean: rounding must not drop one."""


@dataclass(frozen=True)
class PoseFilterParams:
    """How many corrections are averaged, and which of them are dropped."""

    window: Annotated[int, tyro.conf.arg(name="filter-window")] = 8
    """Latest corrections that are averaged: more smooth longer, and follow drift later."""
    max_deviations: Annotated[float, tyro.conf.arg(name="filter-max-deviations")] = 1.0
    """Those farther from the mean than this many root-mean-square deviations are dropped."""

    def __post_init__(self) -> None:
        if not (self.window >= 1 and self.window == int(self.window)):
            raise ParameterError(
                f"--filter-window: expected a whole number of at least 1, got {self.window}"
            )
        # Below 1, all could be dropped: the nearest one is within one deviation, but no closer.
        if not 1 <= self.max_deviations < float("inf"):
            raise ParameterError(
                f"--filter-max-deviations: expected a number of at least 1, "
                f"got {self.max_deviations}"
            )


class PoseFilterState(NamedTuple):
    """The latest corrections and their mean; its size does not depend on the walk's length.

    Attributes:
        corrections: Shape (..., window), world_from_vio by each prediction alone, newest first.
        length: Shape (...), how many of them count.
        world_from_vio: Shape (...), their mean; any pose while there are none.
    """

    corrections: Rigid3
    length: Array
    world_from_vio: Rigid3


def init(params: PoseFilterParams, batch_shape: tuple[int, ...], like: Array) -> PoseFilterState:
    """The filter before the first frame."""
    return PoseFilterState(
        Rigid3.identity((*batch_shape, int(params.window)), like=like),
        zeros(batch_shape, like),
        Rigid3.identity(batch_shape, like=like),
    )


def step(
    params: PoseFilterParams, state: PoseFilterState, frame: FrameInput
) -> tuple[PoseFilterState, Estimate]:
    """One frame: a prediction enters the mean, VIO carries it to frames without."""
    xp = namespace(state.length)
    is_used = frame.has_apr & frame.tracking_ok
    length = select(frame.keeps_world, state.length, xp.zeros_like(state.length))
    correction = frame.apr_world_from_cam @ frame.vio_from_cam.inverse()
    pushed = push(state.corrections, correction)
    corrections = choose(is_used[..., None], pushed, state.corrections)
    capacity = corrections.batch_shape[-1]
    length = select(is_used, xp.clip(length + 1, None, capacity), length)
    # Where nothing counts yet, the mean is of any pose, and not used: but it must be finite.
    counted = xp.clip(length, 1, None)
    inputs = (*corrections, counted, xp.ones_like(length) * params.max_deviations)
    filtered = compute_where(is_used, mean_without_strays, inputs, tuple(state.world_from_vio))
    world_from_vio = Rigid3(*filtered)

    zero = xp.astype(length * 0, xp.int32)
    is_placed = frame.tracking_ok & (length > 0)
    status = xp.where(is_placed, zero + int(Status.TRACKED), zero)
    status = xp.where(is_used, zero + int(Status.OPTIMIZED), status)
    return PoseFilterState(corrections, length, world_from_vio), Estimate(
        hide_unless(is_placed, world_from_vio @ frame.vio_from_cam),
        hide_unless(is_placed, world_from_vio),
        status,
        zero,
    )


def mean_without_strays(
    position_m: Array, quat_xyzw: Array, length: Array, max_deviations: Array
) -> tuple[Array, Array]:
    """The mean of the newest poses that are within some deviations of the mean of all of them.

    Args:
        position_m: Shape (..., n, 3), newest first.
        quat_xyzw: Shape (..., n, 4).
        length: Shape (...), how many count, at least 1.
        max_deviations: Shape (...), how many root-mean-square deviations are allowed, at least 1.

    Returns:
        Position and quaternion, shapes (..., 3) and (..., 4).
    """
    xp = namespace(length)
    order = xp.cumulative_sum(xp.ones_like(position_m[..., 0]), axis=-1)
    counts = xp.astype(order <= length[..., None], position_m.dtype)

    # Relative to the newest, where single precision is exact far from the origin.
    newest = position_m[..., :1, :]
    offset = position_m - newest
    distance = norm(offset - _mean(offset, counts)[..., None, :])
    kept = counts * _is_near(distance, counts, max_deviations)
    position = newest[..., 0, :] + _mean(offset, kept)

    angle = angle_between_deg(mean_quaternion(quat_xyzw, counts)[..., None, :], quat_xyzw)
    kept = counts * _is_near(angle, counts, max_deviations)
    return position, mean_quaternion(quat_xyzw, kept)


def _mean(vectors: Array, weights: Array) -> Array:
    """Weighted, shapes (..., n, 3) and (..., n) to (..., 3)."""
    xp = namespace(vectors)
    return xp.sum(vectors * weights[..., None], axis=-2) / xp.sum(weights, axis=-1)[..., None]


def _is_near(distance: Array, weights: Array, max_deviations: Array) -> Array:
    """1 where a distance is within some root-mean-square distances, else 0, shape (..., n)."""
    xp = namespace(distance)
    squared = distance * distance
    variance = xp.sum(squared * weights, axis=-1) / xp.sum(weights, axis=-1)
    limit = variance * max_deviations * max_deviations * (1 + _TIE)
    return xp.astype(squared <= limit[..., None], distance.dtype)


METHOD = Method(
    name="pose-filter",
    summary="mean of the latest corrections, those beyond one deviation dropped, as AR apps do",
    params_type=PoseFilterParams,
    init=init,
    step=step,
)
