"""ScanNet++'s `iphone/pose_intrinsic_imu.json`: for each frame a 4x4 `aligned_pose`.

`aligned_pose` is world_from_cam by rows, with OpenCV camera axes, in the z-up world of the laser
scan. `pose` beside it is ARKit's own, and is not read. Stated by its toolkit: scannetpp/scannetpp,
iphone/arkit_pcl.py, which applies `aligned_pose` to OpenCV rays. The poses of the DSLR,
`dslr/nerfstudio/transforms.json`, are of the format nerfstudio.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import natural_key, read_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named
from vioapr.formats.poses import build_trajectory, rigid_of_file
from vioapr.formats.times import seconds_of
from vioapr.schemas.foreign_json import as_numbers, load_object
from vioapr.trajectory import Trajectory

_POSE = "aligned_pose"


def sniff(path: Path, head: bytes) -> float:
    """Sure of a JSON object that speaks of aligned poses."""
    del path
    return 0.95 if head.lstrip()[:1] == b"{" and f'"{_POSE}"'.encode() in head else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses, named frame_000000.jpg, timed where all frames have a time.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the frame's number in it.
    """
    frames = load_object(path, read_text(path))
    if not frames:
        raise FormatError(path, f'expected frames with an "{_POSE}", got none')
    keys = sorted(frames, key=natural_key)
    matrices: list[NDArray[np.float64]] = []
    times: list[float] = []
    for entry, key in enumerate(keys, start=1):
        frame = cast("dict[str, Any]", frames[key]) if isinstance(frames[key], dict) else {}
        matrices.append(as_numbers(path, frame.get(_POSE), (4, 4), f'"{_POSE}"', entry))
        if "timestamp" in frame:
            times.append(float(as_numbers(path, frame["timestamp"], (), '"timestamp"', entry)))
    rows = Rows.numbered(path, len(keys))
    poses = rigid_of_file(rows, np.array(matrices), options)
    names = [f"{key}.jpg" for key in keys]
    if len(times) < len(keys):
        return build_named(rows, names, poses, options)
    seconds = seconds_of(path, np.array(times), options)
    return build_trajectory(rows, seconds, poses, options, names=names)


FORMAT = Format(
    name="scannetpp",
    title="ScanNet++ iPhone poses",
    convention=(
        f"JSON with a 4x4 {_POSE} a frame; world_from_cam, OpenCV axes, z-up world, seconds, metres"
    ),
    extensions=(".json",),
    sniff=sniff,
    read=read,
    has_times=True,
    has_names=True,
    default_for=("pose_intrinsic_imu.json",),
)
