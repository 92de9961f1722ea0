"""ios_logger's `ARposes.txt`: `time,x,y,z,qw,qx,qy,qz`, ARKit.

World_from_cam in ARKit's y-up world, with ARKit's (OpenGL) camera axes, seconds since 1970. Stated
by its source: Varvrar/ios_logger, ios_logger/ViewController.mm (`session:didUpdateFrame:` writes
`frame.camera.transform`). The folder's `Frames.txt` has the times of the video's frames.
"""

from __future__ import annotations

from pathlib import Path

from vioapr.files.tables import all_numbers, format_rows, head_rows, parse_rows
from vioapr.files.text import is_folder, plain_name, read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.headed import build_timed
from vioapr.formats.poses import pose_columns, require_times
from vioapr.trajectory import Trajectory

_COLUMNS = "time,x,y,z,qw,qx,qy,qz"
_FILE = "ARposes.txt"
_POSITION_QUAT_XYZW = (1, 2, 3, 5, 6, 7, 4)


def sniff(path: Path, head: bytes) -> float:
    """Sure by the name ARposes.txt and 8 columns, or of a folder with such a file."""
    if not head:
        return 0.95 if is_folder(path) and (path / _FILE).is_file() else 0.0
    is_named = plain_name(path) == _FILE.lower()
    return 0.95 if is_named and all_numbers(head_rows(head, ","), range(8, 9)) else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses of the file or of the recording's folder.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    path = path / _FILE if is_folder(path) else path
    rows = parse_rows(path, read_text(path), range(8, 9), what=_COLUMNS, delimiter=",")
    convert = conventions.world_from_arcam
    return build_timed(rows, options, convert, pose=_POSITION_QUAT_XYZW)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "an ios_logger file")
    poses = conventions.world_from_arcam(trajectory.target_from_source)
    times = trajectory.timestamp_s.tolist()
    columns = pose_columns(poses, (3, 0, 1, 2))
    rows = [(time, *row) for time, row in zip(times, columns, strict=True)]
    write_text(path, format_rows(rows, ","))


FORMAT = Format(
    name="ios-logger",
    title="ios_logger ARposes.txt",
    convention=(
        f"{_COLUMNS}; world_from_cam, ARKit's y-up world, OpenGL camera axes, quaternion wxyz, "
        "seconds, metres"
    ),
    extensions=(".txt", "/"),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    default_for=("arposes.txt",),
    up="+y",
)
