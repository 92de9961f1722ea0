"""Trajectories to write and read back."""

from __future__ import annotations

import numpy as np

from vioapr.formats.base import Format
from vioapr.geometry import quaternion
from vioapr.trajectory import Trajectory

FILE_NAMES = {
    "colmap": "images.txt",
    "colmap-binary": "images.bin",
    "marvin": "train.txt",
    "marvin-vio": "ARKit.txt",
    "hrapr": "chess_test_gt.txt",
    "advio-gt": "advio-01_gt_pose.csv",
    "advio-vio": "advio-01_arkit.csv",
    "stray": "odometry.csv",
    "record3d": "metadata",
    "scancapture": "poses.txt",
    "nerfstudio": "transforms.json",
    "7scenes": "chess",
    "euroc": "data.csv",
    "mstransformer": "abs_poses.csv",
    "aria": "closed_loop_trajectory.csv",
    "cambridge": "dataset_train.txt",
    "tum": "walk.tum",
    "table": "table.csv",
    "arkit-logger": "ARKit_camera_pose.txt",
    "arcore-logger": "ARCore_sensor_pose.txt",
}


def file_name(format_: Format) -> str:
    """A name under which the format is recognized."""
    return FILE_NAMES.get(format_.name, f"{format_.name}.txt")


def make_trajectory(format_: Format, count: int = 12, seed: int = 0) -> Trajectory:
    """Random poses with names and times as far as the format has them."""
    rng = np.random.default_rng(seed)
    suffix = ".color.png" if format_.name == "7scenes" else ".png"
    names = [f"seq-01/frame-{row:06d}{suffix}" for row in range(count)]
    # Whole milliseconds: what every clock of the formats can hold.
    times = 1700000000 + np.cumsum(rng.integers(1, 1000, count)) / 1000
    return Trajectory.from_arrays(
        times if format_.has_times else np.arange(count),
        rng.normal(scale=20, size=(count, 3)),
        quaternion.normalize(rng.normal(size=(count, 4))),
        names if format_.has_names else None,
        is_timed=format_.has_times,
    )
