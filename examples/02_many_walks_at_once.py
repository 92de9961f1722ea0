"""Choose a threshold: one batch of walks times thresholds, in a single pass.

Every leading axis of a frame is a batch axis, and parameters may be arrays over it.

python examples/02_many_walks_at_once.py
"""

from types import SimpleNamespace

import numpy as np

from vioapr.evaluation.metrics import pose_errors
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import run_steps, stack_walks
from vioapr.fusion.pairing import pair_frames
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.walks import WalkParams, simulate_walk

WALKS = 20
THRESHOLDS_M = np.array([0.1, 0.2, 0.4, 0.8, 1.6])


def main() -> None:
    """Print median error and share of frames for every threshold."""
    walks = [simulate_walk(WalkParams(duration_s=100), seed) for seed in range(WALKS)] * len(
        THRESHOLDS_M
    )
    frames = stack_walks([pair_frames(walk.apr, walk.vio) for walk in walks])
    params = SimpleNamespace(
        distance_threshold_m=np.repeat(THRESHOLDS_M, WALKS),
        angle_threshold_deg=4.0,
        run_pairs=2,
        optimized_frames=8,
    )
    fused = run_steps(METHODS["vio-apr"], params, frames)

    gt_world_from_cam = Rigid3(
        np.stack([walk.gt.position_m for walk in walks], axis=1),
        np.stack([walk.gt.quat_xyzw for walk in walks], axis=1),
    )
    errors_m = pose_errors(gt_world_from_cam, fused.world_from_cam).position_m
    is_trusted = (fused.status == Status.KEYFRAME) | (fused.status == Status.OPTIMIZED)
    for threshold_m in THRESHOLDS_M:
        is_run = params.distance_threshold_m == threshold_m
        trusted = is_trusted[:, is_run]
        median_m = np.median(errors_m[:, is_run][trusted])
        print(
            f"d_th {threshold_m:.1f} m: median {median_m:.2f} m on {trusted.mean():.0%} of frames"
        )


if __name__ == "__main__":
    main()
