"""Trajectories to write and read back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
    "polycam": "capture",
    "3dscannerapp": "scan",
    "scannet": "scene0000_00",
    "scannetpp": "pose_intrinsic_imu.json",
    "ios-logger": "ARposes.txt",
    "arkitscenes": "lowres_wide.traj",
    "spectacular": "output.jsonl",
    "kapture": "trajectories.txt",
    "lamar": "trajectories.txt",
    "3dgs": "cameras.json",
    "open3d": "trajectory.log",
    "metashape": "cameras.xml",
    "realitycapture": "cameras.csv",
    "meshroom": "cameras.sfm",
    "opensfm": "reconstruction.json",
    "bundler": "bundle.out",
    "nvm": "model.nvm",
}
FOLDERS = {"7scenes", "polycam", "3dscannerapp", "scannet"}
"""Formats that are a folder, and no file."""


def file_name(format_: Format) -> str:
    """A name under which the format is recognized."""
    return FILE_NAMES.get(format_.name, f"{format_.name}.txt")


def make_trajectory(format_: Format, count: int = 12, seed: int = 0) -> Trajectory:
    """Random poses with names and times as far as the format has them."""
    rng = np.random.default_rng(seed)
    # Whole milliseconds: what every clock of the formats can hold.
    times = 1700000000 + np.cumsum(rng.integers(1, 1000, count)) / 1000
    return Trajectory.from_arrays(
        times if format_.has_times else np.arange(count),
        rng.normal(scale=20, size=(count, 3)),
        quaternion.normalize(rng.normal(size=(count, 4))),
        names_of(format_.name, times) if format_.has_names else None,
        is_timed=format_.has_times,
    )


def names_of(name: str, timestamp_s: NDArray[np.float64]) -> list[str]:
    """Image names as a format has them, where it does not take any."""
    rows = range(len(timestamp_s))
    if name == "polycam":
        return [f"{round(time_s * 1e6)}.jpg" for time_s in timestamp_s]
    patterns = {
        "7scenes": "seq-01/frame-{:06d}.color.png",
        "3dscannerapp": "frame_{:05d}.jpg",
        "scannetpp": "frame_{:06d}.jpg",
        "scannet": "{}.jpg",
    }
    return [patterns.get(name, "seq-01/frame-{:06d}.png").format(row) for row in rows]
