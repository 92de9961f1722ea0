"""Fuse a walk frame by frame, as an application would: predictions at 1 Hz, odometry at 30 Hz.

python examples/01_stream_a_walk.py
"""

from collections import Counter

import numpy as np

from vioapr import Localizer, Status
from vioapr.geometry.rigid import distance_m
from vioapr.simulation.walks import WalkParams, simulate_walk

FRAMES_PER_PREDICTION = 30


def main() -> None:
    """Stream a simulated walk and print how each kind of pose fared."""
    walk = simulate_walk(WalkParams(duration_s=120, rate_hz=30), seed=1)
    localizer = Localizer("vio-apr")
    errors_m: dict[Status, list[float]] = {status: [] for status in Status}
    counts: Counter[Status] = Counter()
    for row, timestamp_s in enumerate(walk.gt.timestamp_s):
        has_prediction = row % FRAMES_PER_PREDICTION == 0
        apr_world_from_cam = walk.apr.target_from_source.at(row) if has_prediction else None
        estimate = localizer.update(
            timestamp_s, apr_world_from_cam, walk.vio.target_from_source.at(row)
        )
        counts[estimate.status] += 1
        gt_world_from_cam = walk.gt.target_from_source.at(row)
        errors_m[estimate.status].append(
            float(distance_m(gt_world_from_cam, estimate.world_from_cam))
        )
    for status, count in sorted(counts.items()):
        print(f"{status.label:12s} {count:5d} frames, median {np.median(errors_m[status]):.2f} m")


if __name__ == "__main__":
    main()
