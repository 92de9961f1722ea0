"""Running methods over walks and collecting their errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.cases import Case
from vioapr.evaluation.content_jumps import ContentSteps, content_steps
from vioapr.evaluation.metrics import PoseErrors, pose_errors
from vioapr.evaluation.reliability import Reliability, measure_reliability
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.methods import get_method
from vioapr.fusion.offline import View, fuse_walks
from vioapr.fusion.smoothing import SMOOTHERS, smooth_walks
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.work.progress import Tick, ignore


@dataclass(frozen=True, eq=False)
class Result:
    """A method's estimates of a case and their errors, over its n frames with ground truth.

    Attributes:
        case: The walk, odometry and regressor.
        method: The method's name.
        timestamp_s: Shape (n,).
        gt_world_from_cam: Shape (n,).
        world_from_cam: The estimates, shape (n,); NaN where unlocalized.
        status: Shape (n,), integers of `Status`.
        errors: The estimates' errors, shape (n,).
        raw_errors: The raw predictions' errors on the same frames, shape (n,); NaN where a
            frame has no prediction.
        sigma_position_m: Shape (n,), per axis, or None where the method has none.
        sigma_orientation_deg: Shape (n,), or None.
        content: How content was moved, over all the case's frames, live in any view; None where
            it is not known where content was shown.
    """

    case: Case
    method: str
    timestamp_s: NDArray[np.float64]
    gt_world_from_cam: Rigid3
    world_from_cam: Rigid3
    status: NDArray[np.integer]
    errors: PoseErrors
    raw_errors: PoseErrors
    sigma_position_m: NDArray[np.float64] | None = None
    sigma_orientation_deg: NDArray[np.float64] | None = None
    content: ContentSteps | None = None

    @property
    def reliability(self) -> Reliability:
        """Whether content stays put, and whether stated sigmas can be believed."""
        sigmas = (self.sigma_position_m, self.sigma_orientation_deg)
        return measure_reliability(self.errors, *sigmas, self.content)

    def has_status(self, *statuses: Status) -> NDArray[np.bool_]:
        """Shape (n,), the frames with one of the statuses."""
        return np.isin(self.status, statuses)


def evaluate_cases(
    cases: Sequence[Case],
    params_of_method: Mapping[str, Any],
    *,
    view: View = "retrospective",
    offline: bool = False,
    tick: Tick = ignore,
) -> list[Result]:
    """Fuse every case with every method.

    Args:
        cases: From `load_cases`.
        params_of_method: The methods' names, each with its parameters.
        view: See `vioapr.fusion.offline.View`.
        offline: Use the future too, by the methods that can (`SMOOTHERS`); the others run as ever.
        tick: Called as often as `count_ticks` says, for progress.

    Returns:
        For each method, in order, a result a case.

    Raises:
        MissingExtraError: A method needs a package that is not installed.
    """
    results: list[Result] = []
    for name, params in params_of_method.items():
        # A missing package must show now, not after minutes with other methods.
        get_method(name).init(params, (), np.zeros(()))
    for name, params in params_of_method.items():
        walks = [case.frames for case in cases]
        if offline and name in SMOOTHERS:
            fused = smooth_walks(get_method(name), params, walks, tick=tick)
        else:
            fused = fuse_walks(get_method(name), params, walks, view=view, tick=tick)
        results += [compare_with_gt(c, name, walk) for c, walk in zip(cases, fused, strict=True)]
    return results


def count_ticks(cases: Sequence[Case], methods: Iterable[str]) -> int:
    """How often `evaluate_cases` calls its tick."""
    lengths = [len(case.frames) for case in cases]
    return sum(
        max(lengths, default=0) if get_method(name).is_batched else sum(lengths) for name in methods
    )


def compare_with_gt(case: Case, method: str, fused: FusedWalk) -> Result:
    """Find the errors of a method's estimates, and of the raw predictions, of a case's frames."""
    rows = case.has_gt
    gt = case.gt_world_from_cam.at(rows)
    inputs = case.frames.inputs
    raw = pose_errors(gt, inputs.apr_world_from_cam.at(rows))
    has_apr = inputs.has_apr[rows]
    estimate = fused.world_from_cam.at(rows)
    sigmas = (fused.sigma_position_m, fused.sigma_orientation_deg)
    content = None
    if fused.world_from_vio is not None:
        content = content_steps(inputs, fused.world_from_vio, has_clock=case.has_clock)
    return Result(
        case,
        method,
        fused.timestamp_s[rows],
        gt,
        estimate,
        fused.status[rows],
        pose_errors(gt, estimate),
        PoseErrors(*(np.where(has_apr, error, np.nan) for error in raw)),
        *(None if sigma is None else sigma[rows] for sigma in sigmas),
        content=content,
    )
