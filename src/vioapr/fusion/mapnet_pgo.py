"""Baseline: MapNet's pose graph over a sliding window (Brahmbhatt et al. 2018, section 3.4).

The poses of the latest predictions are the unknowns. Every prediction pulls its pose, VIO's
motion pulls neighbours, both with constant covariance and without robust kernel; Gauss-Newton
minimizes the weighted sum of squares. The newest pose of the window is the estimate; frames
without a prediction carry it on by VIO.

Where the authors' program (NVlabs/geomapnet) leaves the choice to its data sets, ours differs:
it reports the middle pose of 7, spaced 10 or 150 frames apart, and so looks into the future;
ours is causal and takes successive predictions. Its covariances are 1 for predictions and 1 or
20 for odometry, of positions normalized per scene; ours are in metres and degrees, and by
default those of method pose-graph. Only the ratios matter to the optimum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import tyro

from vioapr.errors import ParameterError
from vioapr.fusion.alignment import hide_unless, push
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import Array, constant, namespace, norm, select, zeros
from vioapr.geometry.rigid import Rigid3, between, choose

_NEWEST = (..., 0, slice(None))
"""Index of the newest pose of a window."""

_CROSS_TABLE = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]],
    dtype=np.float64,
)
"""The (3, 9) table that turns a vector v into the matrix of v x."""


@dataclass(frozen=True)
class MapnetPgoParams:
    """The window and the constant covariances."""

    window: Annotated[int, tyro.conf.arg(name="mapnet-window")] = 7
    """Predictions in the window: more average longer, and take longer (cubic)."""
    prior_sigma_m: Annotated[float, tyro.conf.arg(name="mapnet-prior-sigma-m")] = 1.0
    """Standard deviation of a prediction's position per axis, m."""
    prior_sigma_deg: Annotated[float, tyro.conf.arg(name="mapnet-prior-sigma-deg")] = 3.0
    """Standard deviation of a prediction's orientation per axis, deg."""
    between_sigma_m: Annotated[float, tyro.conf.arg(name="mapnet-between-sigma-m")] = 0.03
    """Standard deviation of VIO's motion between predictions per axis, m: smaller makes the
    window more rigid."""
    between_sigma_deg: Annotated[float, tyro.conf.arg(name="mapnet-between-sigma-deg")] = 0.2
    """Standard deviation of VIO's turn between predictions per axis, deg."""
    iterations: Annotated[int, tyro.conf.arg(name="mapnet-iterations")] = 5
    """Gauss-Newton iterations a frame; from the last frame's poses, 5 come within 1e-9 m of the
    optimum (the authors' program starts anew from the predictions and takes 10)."""

    def __post_init__(self) -> None:
        for name in ("prior_sigma_m", "prior_sigma_deg", "between_sigma_m", "between_sigma_deg"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise ParameterError(
                    f"--mapnet-{name.replace('_', '-')}: expected a number greater than 0, "
                    f"got {value}"
                )
        for name, count in (("window", self.window), ("iterations", self.iterations)):
            if not (count >= 1 and count == int(count)):
                raise ParameterError(
                    f"--mapnet-{name}: expected a whole number of at least 1, got {count}"
                )


class Window(NamedTuple):
    """The latest predictions, newest first; its size does not depend on the walk's length.

    Attributes:
        world_from_cam: Shape (..., window), the poses as last optimized.
        apr_world_from_cam: Shape (..., window), the predictions.
        vio_from_cam: Shape (..., window), the tracker's poses at the predictions.
        length: Shape (...), how many of them count.
    """

    world_from_cam: Rigid3
    apr_world_from_cam: Rigid3
    vio_from_cam: Rigid3
    length: Array

    def is_valid(self) -> Array:
        """Which poses count, shape (..., window)."""
        xp = namespace(self.length)
        ones = xp.ones_like(self.vio_from_cam.translation_m[..., 0])
        return xp.cumulative_sum(ones, axis=-1) <= self.length[..., None]

    def place(self, vio_from_cam: Rigid3) -> Rigid3:
        """world_from_cam of a tracked pose, by VIO's motion since the newest prediction."""
        motion = between(self.vio_from_cam.at(_NEWEST), vio_from_cam)
        return self.world_from_cam.at(_NEWEST) @ motion


def init(params: MapnetPgoParams, batch_shape: tuple[int, ...], like: Array) -> Window:
    """The window before the first frame."""
    shape = (*batch_shape, int(params.window))
    # Separate arrays: a tracer would take one array that is passed thrice for one input.
    pose, apr, vio = (Rigid3.identity(shape, like=like) for _ in range(3))
    return Window(pose, apr, vio, zeros(batch_shape, like))


def step(params: MapnetPgoParams, state: Window, frame: FrameInput) -> tuple[Window, Estimate]:
    """One frame: a prediction enters the window and moves it, other frames are carried on."""
    xp = namespace(state.length)
    length = select(frame.keeps_world, state.length, xp.zeros_like(state.length))
    state = state._replace(length=length)
    is_used = frame.has_apr & frame.tracking_ok
    window = _choose_window(is_used, optimize(params, _extend(state, frame)), state)

    tracked = xp.astype(frame.tracking_ok & (window.length > 0), xp.int32) * int(Status.TRACKED)
    status = xp.where(is_used, xp.zeros_like(tracked) + int(Status.OPTIMIZED), tracked)
    world_from_cam = window.place(frame.vio_from_cam)
    world_from_vio = world_from_cam @ frame.vio_from_cam.inverse()
    return window, Estimate(
        hide_unless(status > 0, world_from_cam),
        hide_unless(status > 0, world_from_vio),
        status,
        xp.zeros_like(status),
    )


def _extend(window: Window, frame: FrameInput) -> Window:
    """Put a prediction in front and drop the oldest.

    Its pose is first guessed by VIO, close to the optimum even if the prediction is far off.
    """
    has_past = window.length > 0
    guess = choose(has_past, window.place(frame.vio_from_cam), frame.apr_world_from_cam)
    length = window.length + 1
    capacity = window.vio_from_cam.batch_shape[-1]
    return Window(
        push(window.world_from_cam, guess),
        push(window.apr_world_from_cam, frame.apr_world_from_cam),
        push(window.vio_from_cam, frame.vio_from_cam),
        namespace(length).clip(length, None, capacity),
    )


def _choose_window(condition: Array, if_true: Window, if_false: Window) -> Window:
    each = condition[..., None]
    return Window(
        choose(each, if_true.world_from_cam, if_false.world_from_cam),
        choose(each, if_true.apr_world_from_cam, if_false.apr_world_from_cam),
        choose(each, if_true.vio_from_cam, if_false.vio_from_cam),
        select(condition, if_true.length, if_false.length),
    )


def optimize(params: MapnetPgoParams, window: Window) -> Window:
    """Gauss-Newton on the window's poses, from where they are."""
    xp = namespace(window.length)
    for _ in range(int(params.iterations)):
        residuals, jacobian = linearize(params, window)
        transposed = xp.matrix_transpose(jacobian)
        update = -xp.linalg.solve(transposed @ jacobian, transposed @ residuals[..., None])
        shape = (*window.world_from_cam.batch_shape, 6)
        moved = perturb(window.world_from_cam, xp.reshape(update, shape))
        window = window._replace(world_from_cam=moved)
    return window


def perturb(world_from_cam: Rigid3, tangent: Array) -> Rigid3:
    """Move poses by tangent vectors: t + d in the world, R exp(w) in the camera.

    Args:
        world_from_cam: Shape (...).
        tangent: Shape (..., 6): translation d in m, then rotation vector w in rad.
    """
    turn = quaternion.from_rotvec(tangent[..., 3:])
    return Rigid3(
        world_from_cam.translation_m + tangent[..., :3],
        quaternion.normalize(quaternion.multiply(world_from_cam.quat_xyzw, turn)),
    )


def linearize(params: MapnetPgoParams, window: Window) -> tuple[Array, Array]:
    """Weighted residuals and their derivatives by `perturb`'s tangent vectors.

    Poses that do not count have residual 0 and only a prior, so that they stay where they are
    and the system has full rank.

    Returns:
        Shapes (..., m) and (..., m, n), with n = 6 window and m = 12 window - 6: of every pose
        the position and rotation against the prediction, then of every pair of neighbours the
        motion and turn against VIO.
    """
    xp = namespace(window.length)
    is_valid = window.is_valid()
    size = window.vio_from_cam.batch_shape[-1]
    prior, by_pose = _linearize_priors(params, window)
    prior = select(is_valid, prior, xp.zeros_like(prior))
    identity = np.eye(size)
    rows = [_place_blocks(by_pose, identity)]
    residuals = [_flatten(prior)]
    if size > 1:
        pair, by_newer, by_older = _linearize_pairs(params, window)
        weight = xp.astype(is_valid[..., 1:], pair.dtype)[..., None]
        residuals.append(_flatten(pair * weight))
        weight = weight[..., None]
        rows.append(
            _place_blocks(by_newer * weight, identity[:-1])
            + _place_blocks(by_older * weight, identity[1:])
        )
    return xp.concat(residuals, axis=-1), xp.concat(rows, axis=-2)


def _linearize_priors(params: MapnetPgoParams, window: Window) -> tuple[Array, Array]:
    """Residuals (..., window, 6) and Jacobians (..., window, 6, 6) of the predictions."""
    apr, pose = window.apr_world_from_cam, window.world_from_cam
    turn = _turn_between(apr.quat_xyzw, pose.quat_xyzw)
    eye = constant(np.eye(3), turn) + 0 * turn[..., None]
    sigma_rad = math.radians(params.prior_sigma_deg)
    xp = namespace(turn)
    residuals = xp.concat(
        [(pose.translation_m - apr.translation_m) / params.prior_sigma_m, turn / sigma_rad],
        axis=-1,
    )
    return residuals, _stack_blocks(
        [[eye / params.prior_sigma_m, 0 * eye], [0 * eye, _log_jacobian(turn) / sigma_rad]]
    )


def _linearize_pairs(params: MapnetPgoParams, window: Window) -> tuple[Array, Array, Array]:
    """Of neighbours: residuals (..., window - 1, 6), Jacobians by newer and older pose."""
    pose, vio = window.world_from_cam, window.vio_from_cam
    newer, older = (..., slice(None, -1), slice(None)), (..., slice(1, None), slice(None))
    motion = between(pose.at(older), pose.at(newer))
    vio_motion = between(vio.at(older), vio.at(newer))
    turn = _turn_between(vio_motion.quat_xyzw, motion.quat_xyzw)
    by_turn = _log_jacobian(turn)
    xp = namespace(turn)
    older_from_world = xp.matrix_transpose(quaternion.to_matrix(pose.at(older).quat_xyzw))
    newer_from_older = xp.matrix_transpose(quaternion.to_matrix(motion.quat_xyzw))
    sigma_m, sigma_rad = params.between_sigma_m, math.radians(params.between_sigma_deg)
    zero = 0 * by_turn
    residuals = xp.concat(
        [(motion.translation_m - vio_motion.translation_m) / sigma_m, turn / sigma_rad], axis=-1
    )
    by_newer = [[older_from_world / sigma_m, zero], [zero, by_turn / sigma_rad]]
    by_older = [
        [-older_from_world / sigma_m, _cross_matrix(motion.translation_m) / sigma_m],
        [zero, -(by_turn @ newer_from_older) / sigma_rad],
    ]
    return residuals, _stack_blocks(by_newer), _stack_blocks(by_older)


def _turn_between(a_xyzw: Array, b_xyzw: Array) -> Array:
    """Rotation vector of a^-1 b, shape (..., 3), rad."""
    return quaternion.to_rotvec(quaternion.multiply(quaternion.inverse(a_xyzw), b_xyzw))


def _log_jacobian(rotvec_rad: Array) -> Array:
    """The derivative of log(exp(v) exp(w)) by w at w = 0, shapes (..., 3) to (..., 3, 3).

    The inverse of the right Jacobian of rotations: I + [v]/2 + c [v]^2, with
    c = (1 - h cot h) / (2 h)^2 and h = |v| / 2, which tends to 1/12.
    """
    xp = namespace(rotvec_rad)
    half = norm(rotvec_rad)[..., None, None] / 2
    is_small = half < 1e-3
    safe = xp.where(is_small, xp.ones_like(half), half)
    factor = xp.where(
        is_small,
        1 / 12 + half * half / 180,
        (1 - safe * xp.cos(safe) / xp.sin(safe)) / (4 * safe * safe),
    )
    cross = _cross_matrix(rotvec_rad)
    return constant(np.eye(3), rotvec_rad) + cross / 2 + factor * (cross @ cross)


def _cross_matrix(vectors: Array) -> Array:
    """The matrix [v] with [v] u = v x u, shapes (..., 3) to (..., 3, 3)."""
    flat = vectors @ constant(_CROSS_TABLE, vectors)
    return namespace(flat).reshape(flat, (*flat.shape[:-1], 3, 3))


def _stack_blocks(blocks: list[list[Array]]) -> Array:
    """Matrices (..., 6, 6) of blocks (..., 3, 3)."""
    xp = namespace(blocks[0][0])
    return xp.concat([xp.concat(row, axis=-1) for row in blocks], axis=-2)


def _place_blocks(blocks: Array, columns: np.ndarray) -> Array:
    """Rows of the Jacobian: block k at the pose that row k of a 0/1 matrix names.

    Args:
        blocks: Shape (..., k, 6, 6).
        columns: Shape (k, window).

    Returns:
        Shape (..., 6 k, 6 window).
    """
    placed = blocks[..., None, :] * constant(columns[:, None, :, None], blocks)
    shape = (*placed.shape[:-4], 6 * columns.shape[0], 6 * columns.shape[1])
    return namespace(placed).reshape(placed, shape)


def _flatten(residuals: Array) -> Array:
    """Shapes (..., k, 6) to (..., 6 k)."""
    shape = (*residuals.shape[:-2], 6 * residuals.shape[-2])
    return namespace(residuals).reshape(residuals, shape)


METHOD = Method(
    name="mapnet-pgo",
    summary="MapNet's pose graph over a sliding window, with constant covariance",
    params_type=MapnetPgoParams,
    init=init,
    step=step,
)
