"""Period alignment (paper, section 3.3): a run of confirmed predictions gives a reference."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from vioapr.fusion.types import FrameInput
from vioapr.geometry.arrays import Array, Mask, compute_where, constant, namespace, select, zeros
from vioapr.geometry.averaging import geometric_median, mean_quaternion
from vioapr.geometry.relative import relative_gap
from vioapr.geometry.rigid import Rigid3, between, choose, stack

_NEWEST = (..., 0, slice(None))
"""Index of the newest pose in a run."""


class CheckerParams(Protocol):
    """The parameters of the relative pose checker; numbers, or arrays of the batch shape."""

    @property
    def distance_threshold_m(self) -> Array | float:
        """The paper's d_th."""
        ...

    @property
    def angle_threshold_deg(self) -> Array | float:
        """The paper's o_th."""
        ...

    @property
    def run_pairs(self) -> Array | float:
        """The paper's N."""
        ...


class Run(NamedTuple):
    """The latest consecutive predictions whose neighbours passed the checker.

    Attributes:
        apr_world_from_cam: Shape (..., capacity), newest first.
        vio_from_cam: Shape (..., capacity), newest first.
        length: Shape (...), how many of them count; a float, for the deployed graph.
    """

    apr_world_from_cam: Rigid3
    vio_from_cam: Rigid3
    length: Array


class Reference(NamedTuple):
    """A pair of mean poses that ties the two worlds together (the paper's P-bar).

    Attributes:
        apr_world_from_cam: Mean of a run's predictions.
        vio_from_cam: Mean of the same frames' VIO poses.
        is_known: Shape (...), whether there is a reference.
    """

    apr_world_from_cam: Rigid3
    vio_from_cam: Rigid3
    is_known: Mask

    def world_from_vio(self) -> Rigid3:
        """The rigid transform between the worlds (Algorithm 1, lines 1-3)."""
        return self.apr_world_from_cam @ self.vio_from_cam.inverse()

    def place(self, vio_from_cam: Rigid3) -> Rigid3:
        """world_from_cam of a tracked pose (Algorithm 1, lines 4-5).

        Relative to the reference, not through world_from_vio: far from the tracking world's
        origin that keeps single precision exact enough.
        """
        return self.apr_world_from_cam @ between(self.vio_from_cam, vio_from_cam)


def empty_run(batch_shape: tuple[int, ...], capacity: int, like: Array) -> Run:
    """A run without poses."""
    shape = (*batch_shape, capacity)
    # Two separate arrays: a tracer would take one array that is passed twice for one input.
    return Run(
        Rigid3.identity(shape, like=like),
        Rigid3.identity(shape, like=like),
        zeros(batch_shape, like),
    )


def no_reference(batch_shape: tuple[int, ...], like: Array) -> Reference:
    """A reference that is not known."""
    return Reference(
        Rigid3.identity(batch_shape, like=like),
        Rigid3.identity(batch_shape, like=like),
        zeros(batch_shape, like) > 0,
    )


def passes_checker(
    params: CheckerParams,
    apr_from_a: Rigid3,
    vio_from_a: Rigid3,
    frame: FrameInput,
) -> Mask:
    """Whether a frame's motion since pose a is the same for regressor and VIO, shape (...)."""
    gap = relative_gap(apr_from_a, frame.apr_world_from_cam, vio_from_a, frame.vio_from_cam)
    return (gap.distance_m <= params.distance_threshold_m) & (
        gap.angle_deg <= params.angle_threshold_deg
    )


def extend_run(params: CheckerParams, run: Run, frame: FrameInput) -> Run:
    """Add a frame to the run; where it disagrees with the newest, start again from it."""
    agrees = passes_checker(
        params, run.apr_world_from_cam.at(_NEWEST), run.vio_from_cam.at(_NEWEST), frame
    )
    one = namespace(run.length).ones_like(run.length)
    continues = agrees & (run.length > 0)
    return Run(
        push(run.apr_world_from_cam, frame.apr_world_from_cam),
        push(run.vio_from_cam, frame.vio_from_cam),
        select(continues, run.length + one, one),
    )


def push(newest_first: Rigid3, pose: Rigid3) -> Rigid3:
    """Put a pose in front of a buffer of shape (..., n) and drop the oldest."""
    xp = namespace(pose.translation_m)

    def put(buffer: Array, new: Array) -> Array:
        return xp.concat([new[..., None, :], buffer[..., :-1, :]], axis=-2)

    return Rigid3(*map(put, newest_first, pose))


def update_reference(
    params: CheckerParams, reference: Reference, run: Run, is_complete: Mask
) -> Reference:
    """The reference, replaced by the means of the run where that is complete, shape (...)."""
    xp = namespace(run.length)
    index = xp.cumulative_sum(xp.ones_like(run.vio_from_cam.translation_m[..., 0]), axis=-1)
    size = xp.ones_like(run.length) * params.run_pairs + 1
    weights = xp.astype(index <= size[..., None], run.length.dtype)
    # Both worlds in one batch: half as many operations.
    poses = stack([run.apr_world_from_cam, run.vio_from_cam], axis=-3)
    old = stack([reference.apr_world_from_cam, reference.vio_from_cam], axis=-2)
    new = compute_where(is_complete, _mean_poses, (*poses, weights), tuple(old))
    apr_world_from_cam, vio_from_cam = (Rigid3(*new).at((..., k, slice(None))) for k in range(2))
    return Reference(apr_world_from_cam, vio_from_cam, reference.is_known | is_complete)


def _mean_poses(position_m: Array, quat_xyzw: Array, weights: Array) -> tuple[Array, Array]:
    """Geometric medians and mean rotations, shapes (..., 2, n, 3), (..., 2, n, 4), (..., n)."""
    newest = position_m[..., :1, :]
    medians = geometric_median(position_m - newest, weights[..., None, :])
    return newest[..., 0, :] + medians, mean_quaternion(quat_xyzw, weights[..., None, :])


def hide_unless(condition: Mask, pose: Rigid3) -> Rigid3:
    """The pose where the condition holds, NaN elsewhere."""
    nan = constant(float("nan"), pose.translation_m)
    xp = namespace(pose.translation_m)
    return choose(condition, pose, Rigid3(*(xp.zeros_like(part) + nan for part in pose)))
