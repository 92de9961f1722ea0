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
from vioapr.geometry.arrays import Array, Mask, namespace, select, zeros
from vioapr.geometry.pose_graph import (
    Factors,
    gauss_newton,
    motion_residual,
    perturb,
    prior_residual,
    solve_dense,
)
from vioapr.geometry.rigid import Rigid3, between, choose

_NEWEST = (..., 0, slice(None))
"""Index of the newest pose of a window."""


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
    optimum (the authors' program starts again from the predictions and takes 10)."""

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

    def is_valid(self) -> Mask:
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


def _choose_window(condition: Mask, if_true: Window, if_false: Window) -> Window:
    each = condition[..., None]
    return Window(
        choose(each, if_true.world_from_cam, if_false.world_from_cam),
        choose(each, if_true.apr_world_from_cam, if_false.apr_world_from_cam),
        choose(each, if_true.vio_from_cam, if_false.vio_from_cam),
        select(condition, if_true.length, if_false.length),
    )


def optimize(params: MapnetPgoParams, window: Window) -> Window:
    """Gauss-Newton on the window's poses, from where they are."""
    poses = gauss_newton(
        window.world_from_cam,
        lambda poses: linearize(params, window._replace(world_from_cam=poses)),
        perturb,
        solve_dense,
        int(params.iterations),
    )
    return window._replace(world_from_cam=poses)


def linearize(params: MapnetPgoParams, window: Window) -> list[Factors]:
    """The predictions' pull on every pose, and VIO's motion between neighbours.

    Poses that do not count have residual 0 and only a prior, so that they stay where they are
    and the system has full rank.
    """
    xp = namespace(window.length)
    is_valid = window.is_valid()
    pose, vio = window.world_from_cam, window.vio_from_cam
    number = np.arange(pose.batch_shape[-1])
    prior, by_pose = prior_residual(
        pose,
        window.apr_world_from_cam,
        params.prior_sigma_m,
        math.radians(params.prior_sigma_deg),
    )
    prior = select(is_valid, prior, xp.zeros_like(prior))
    factors = [Factors(prior, (number,), (by_pose,))]
    if len(number) > 1:
        newer, older = (..., slice(None, -1), slice(None)), (..., slice(1, None), slice(None))
        motion, by_older, by_newer = motion_residual(
            pose.at(older),
            pose.at(newer),
            between(vio.at(older), vio.at(newer)),
            params.between_sigma_m,
            math.radians(params.between_sigma_deg),
        )
        weight = xp.astype(is_valid[..., 1:], motion.dtype)[..., None]
        each = weight[..., None]
        jacobians = (by_newer * each, by_older * each)
        factors.append(Factors(motion * weight, (number[:-1], number[1:]), jacobians))
    return factors


METHOD = Method(
    name="mapnet-pgo",
    summary="MapNet's pose graph over a sliding window, with constant covariance",
    params_type=MapnetPgoParams,
    init=init,
    step=step,
)
