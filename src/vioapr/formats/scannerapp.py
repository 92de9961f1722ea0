"""3D Scanner App's "All Data" export: a folder of `frame_00000.json` with ARKit's pose.

`cameraPoseARFrame` is a 4x4 matrix by rows, world_from_cam in ARKit's y-up world with ARKit's
(OpenGL) camera axes; `time` is in seconds. Some frames have a picture, `frame_00000.jpg`. The
order of the matrix is that of pwais/psegs-ios-lidar-ext's captures, whose last four numbers are
0, 0, 0, 1; that the camera looks along -z shows in how their desk lies below it.
"""

from __future__ import annotations

from pathlib import Path

from vioapr.errors import VioAprError
from vioapr.files.text import read_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.folders import find_frames, require_frames
from vioapr.formats.frame_files import build_track, read_scanner_app
from vioapr.trajectory import Trajectory

_PATTERN = r"frame_\d+\.json"
_POSE = '"cameraPoseARFrame"'


def sniff(path: Path, head: bytes) -> float:
    """Sure of a folder whose first frame has the app's pose; its reader refuses a frame alone."""
    if head:
        return 0.95 if head.lstrip()[:1] == b"{" and _POSE.encode() in head else 0.0
    try:
        files = find_frames(path, _PATTERN)
        return 0.95 if files and _POSE in read_text(files[0]) else 0.0
    except VioAprError:
        return 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses of a capture's folder.

    Every frame is named by its picture, whether there is one or not.

    Raises:
        FileError: It cannot be read or is malformed, naming the frame's file.
    """
    wanted = "a folder of 3D Scanner App's frame_00000.json"
    files = require_frames(path, find_frames(path, _PATTERN), wanted)
    return build_track(path, files, read_scanner_app(path), options)


FORMAT = Format(
    name="3dscannerapp",
    title="3D Scanner App, All Data",
    convention=(
        "JSON a frame with cameraPoseARFrame, 4x4 by rows; world_from_cam, ARKit's y-up world, "
        "OpenGL camera axes, seconds, metres"
    ),
    extensions=("/",),
    sniff=sniff,
    read=read,
    has_times=True,
    has_names=True,
    up="+y",
)
