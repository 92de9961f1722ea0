"""Polycam's raw export: `keyframes/cameras/*.json`, ARKit's pose as `t_00` to `t_23` by rows.

World_from_cam in ARKit's y-up world, with ARKit's (OpenGL) camera axes; a file's name is its time
in microseconds. `corrected_cameras` holds the same poses after Polycam's loop closure, and is read
where it is there. Stated by Polycam: PolyCam/polyform, README.md, "Polycam's data format"; the
camera axes by nerfstudio's converter (nerfstudio/process_data/polycam_utils.py), which takes the
matrix as an OpenGL camera's.
"""

from __future__ import annotations

from pathlib import Path

from vioapr.errors import VioAprError
from vioapr.files.text import is_folder, read_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.folders import find_frames, require_frames
from vioapr.formats.frame_files import POLYCAM_FOLDERS, build_track, find_polycam, read_polycam
from vioapr.trajectory import Trajectory

_CORRECTED, _RAW = (cameras for cameras, _ in POLYCAM_FOLDERS)


def _find_cameras(path: Path) -> list[Path]:
    """The camera files of a capture, of its `keyframes`, or of one folder of cameras."""
    if path.name in (_CORRECTED, _RAW):
        return find_frames(path, r".*\.json")
    found = find_polycam(path) if is_folder(path) else None
    return [] if found is None else found[0]


def sniff(path: Path, head: bytes) -> float:
    """Sure of a folder whose first camera file has the matrix; its reader refuses a file alone."""
    if head:
        return 0.95 if head.lstrip()[:1] == b"{" and b'"t_23"' in head else 0.0
    try:
        files = _find_cameras(path)
        return 0.95 if files and '"t_23"' in read_text(files[0]) else 0.0
    except (OSError, VioAprError):
        return 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses, timed by the cameras and named by their images.

    Args:
        path: The capture's folder, its `keyframes`, or one of the folders of camera files: give
            `keyframes/cameras` for the tracking as it was, with its drift.
        options: Strictness and notes.

    Raises:
        FileError: It cannot be read or is malformed, naming the camera file.
    """
    wanted = "a folder of Polycam's keyframes/cameras/*.json"
    files = require_frames(path, _find_cameras(path), wanted)
    folder = files[0].parent
    if folder.name == _CORRECTED and path.name != _CORRECTED:
        text = f"poses are Polycam's after loop closure: give {_RAW}/ for the tracking as it was"
        options.note(path, text, is_warning=False)
        raw = len(find_frames(folder.with_name(_RAW), r".*\.json"))
        if raw > len(files):
            text = f"{_CORRECTED} has {len(files)} of {raw} frames: the others are left out"
            options.note(path, text, is_warning=True)
    return build_track(path, files, read_polycam(folder, files), options)


FORMAT = Format(
    name="polycam",
    title="Polycam raw export",
    convention=(
        "JSON a frame with t_00 to t_23 by rows; world_from_cam, ARKit's y-up world, OpenGL "
        "camera axes, microseconds, metres"
    ),
    extensions=("/",),
    sniff=sniff,
    read=read,
    has_times=True,
    has_names=True,
    up="+y",
)
