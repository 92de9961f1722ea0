"""The accuracy of one walk's estimates against its ground truth, in one call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError
from vioapr.evaluation.metrics import PoseErrors, Summary, pose_errors, summarize
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory, poses_of_frames


class Accuracy(NamedTuple):
    """How far a walk's estimates are from the truth.

    Attributes:
        timestamp_s: The frames that have ground truth, shape (n,); NaN without a clock.
        errors: Shape (n,); NaN where a frame is not localized.
        summary: Medians, 95th percentiles, precision levels and the share of frames with a
            pose.
    """

    timestamp_s: NDArray[np.float64]
    errors: PoseErrors
    summary: Summary


def evaluate(
    estimates: FusedWalk | Trajectory,
    gt: Trajectory,
    *,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> Accuracy:
    """Compare a walk's estimates with ground truth, without aligning them.

    Args:
        estimates: From `fuse`, or any trajectory, world_from_cam.
        gt: world_from_cam in the same world, on the same clock.
        tolerance_s: Largest difference of timestamps between a frame and its ground truth, s.

    Raises:
        AssociationError: No frame has ground truth.
    """
    is_fused = isinstance(estimates, FusedWalk)
    poses = estimates.world_from_cam if is_fused else estimates.target_from_source
    is_timed = is_fused or estimates.is_timed
    gt_poses = poses_of_frames(
        gt,
        estimates.timestamp_s if is_timed else None,
        None if is_fused else estimates.names,
        tolerance_s,
    )
    rows = gt_poses.is_known
    if not rows.any():
        raise AssociationError(f"no frame has ground truth within {tolerance_s} s")
    errors = pose_errors(gt_poses.at(rows), poses.at(rows))
    return Accuracy(estimates.timestamp_s[rows], errors, summarize(errors))
