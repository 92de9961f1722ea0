"""ScanNet's `pose/0.txt`, `pose/1.txt`, ...: a 4x4 matrix a frame, world_from_cam.

The camera has OpenCV axes, the world is z up. Frames without a pose are written as -inf. Stated
by its reader: ScanNet/ScanNet, SensReader/python/SensorData.py (`camera_to_world`, written by
`export_poses`). Exports of BundleFusion and of NSVF have the same files.
"""

from __future__ import annotations

import re
from pathlib import Path

from vioapr.errors import VioAprError
from vioapr.files.tables import all_numbers, format_rows
from vioapr.files.text import is_folder, read_text, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.folders import find_frames, has_frames, read_matrix_files, require_frames
from vioapr.formats.named import build_named, writable_names
from vioapr.trajectory import Trajectory

_PATTERN = r"\d+\.txt"
_NAMES = r"\d+\.jpg"


def find_pose_folder(path: Path) -> Path:
    """The folder of pose files in a scan's folder, or that folder itself."""
    return path / "pose" if has_frames(path / "pose", _PATTERN) else path


def sniff(path: Path, head: bytes) -> float:
    """Likely of a folder of numbered text files, the first of which is a 4x4 matrix."""
    folder = find_pose_folder(path)
    if head or not is_folder(path) or not has_frames(folder, _PATTERN):
        return 0.0
    try:
        lines = read_text(find_frames(folder, _PATTERN)[0]).split("\n")
    except VioAprError:
        return 0.0
    fields = [line.split() for line in lines if line.strip()]
    return 0.85 if len(fields) == 4 and all_numbers(fields, range(4, 5)) else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses of a scan's folder or of its folder of poses.

    Images are named 0.jpg and so on, as in the folder `color`.

    Raises:
        FileError: It cannot be read or is malformed, naming the pose file and line.
        ParameterError: The options do not fit.
    """
    folder = find_pose_folder(path)
    wanted = "a folder of ScanNet's pose/0.txt, pose/1.txt, ..."
    files = require_frames(path, find_frames(folder, _PATTERN), wanted)
    rows, poses = read_matrix_files(path, files, options)
    return build_named(rows, [f"{file.stem}.jpg" for file in files], poses, options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write a file for each pose; frames whose images are not named 12.jpg are counted.

    Raises:
        UnwritableError: A file cannot be written.
        ParameterError: Image names that are the same.
    """
    names = writable_names(trajectory, "", ".jpg")
    if not all(re.fullmatch(_NAMES, name) for name in names):
        names = [f"{row}.jpg" for row in range(len(names))]
    matrices = trajectory.target_from_source.to_matrix().tolist()
    for name, matrix in zip(names, matrices, strict=True):
        write_text(path / name.replace(".jpg", ".txt"), format_rows(matrix, " "))


FORMAT = Format(
    name="scannet",
    title="ScanNet pose folder",
    convention="4x4 matrix a file, 0.txt; world_from_cam, OpenCV axes, z-up world, no times",
    extensions=("/",),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    name_pattern=_NAMES,
    parts=("[0-9]*.txt", "pose/[0-9]*.txt"),
    up="+z",
)
