"""COLMAP's text model: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, cam_from_world."""

from __future__ import annotations

import re
from pathlib import Path

from vioapr.errors import FormatError
from vioapr.files.tables import Rows, format_rows
from vioapr.files.text import is_folder, plain_name, read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named, writable_names
from vioapr.formats.poses import pose_columns, poses_of
from vioapr.trajectory import Trajectory

_COLUMNS = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
_FILE = "images.txt"
# A name is no number: rows of integers are no images.
_IMAGE_LINE = re.compile(rb"(?m)^\d+( [-+.\deE]+){7} \d+ (?=\S).*[^-+.\deE\s].*$")

PARTS = tuple(
    f"{name}.{ending}"
    for name in ("images", "cameras", "points3D", "rigs", "frames")
    for ending in ("txt", "bin")
)
"""A model's files, of both formats: programs take those that end in .bin where there are both."""
PLACEHOLDER_SIZE = (640, 480)
PLACEHOLDER_PINHOLE = (500.0, 500.0, 320.0, 240.0)
"""fx, fy, cx, cy of the camera that is written, as a trajectory knows of none."""


def file_of(path: Path, name: str) -> Path:
    """The file of a model that is given as its folder or as the file itself."""
    return path / name if is_folder(path) else path


def sniff(path: Path, head: bytes) -> float:
    """Sure by the name images.txt and a row of the format; likely by the row alone."""
    if not head:
        return 0.9 if (path / _FILE).is_file() else 0.0
    if b"\0" in head or not _IMAGE_LINE.search(head):
        return 0.0
    return 1.0 if plain_name(path) == _FILE else 0.8


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses of `images.txt` or of a model's folder, ordered by name.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
        ParameterError: The options do not fit the file's sequences.
    """
    path = file_of(path, _FILE)
    rows = Rows(path, [], [])
    expects_points = False  # after each image comes a line of points, maybe empty
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        stripped = line.strip()
        if stripped.startswith("#"):
            continue
        if expects_points:
            expects_points = False
            if len(stripped.split()) % 3:
                raise FormatError(path, "expected points as X Y POINT3D_ID after an image", number)
        elif stripped:
            row = stripped.split(maxsplit=9)
            if len(row) != 10:
                raise FormatError(path, f"expected 10 columns ({_COLUMNS}), got {len(row)}", number)
            rows.fields.append(row)
            rows.lines.append(number)
            expects_points = True
    if not len(rows):
        raise FormatError(path, f"expected rows of {_COLUMNS}, got none: the file is empty")
    values = rows.numbers(slice(1, 8))
    poses = poses_of(rows, values[:, 4:7], values[:, [1, 2, 3, 0]])
    return build_named(rows, rows.column(9), conventions.cam_from_world(poses), options)


def images_of(trajectory: Trajectory) -> list[tuple[int, str, list[float]]]:
    """Number, name and `QW QX QY QZ TX TY TZ` of every image, as both of COLMAP's formats have.

    Raises:
        ParameterError: A name that the formats cannot hold.
    """
    names = writable_names(trajectory, ",")
    columns = pose_columns(conventions.cam_from_world(trajectory.target_from_source), (3, 0, 1, 2))
    return [
        (number, name, [*row[3:], *row[:3]])
        for number, (name, row) in enumerate(zip(names, columns, strict=True), start=1)
    ]


def write(path: Path, trajectory: Trajectory) -> None:
    """Write images.txt, or a model into a folder (a path without a suffix).

    The model's only camera is a placeholder, PINHOLE; it has no points.

    Raises:
        ParameterError: A name that the format cannot hold.
        UnwritableError: A file cannot be written.
    """
    # The blank line is the image's points.
    rows = [(number, *pose, 1, f"{name}\n") for number, name, pose in images_of(trajectory)]
    content = f"# {_COLUMNS}\n# and a line of points\n" + format_rows(rows, " ")
    if path.suffix and not is_folder(path):
        write_text(path, content)
        return
    write_text(path / _FILE, content)
    camera = (1, "PINHOLE", *PLACEHOLDER_SIZE, *PLACEHOLDER_PINHOLE)
    write_text(path / "cameras.txt", "# a placeholder\n" + format_rows([camera], " "))
    write_text(path / "points3D.txt", "# none\n")


FORMAT = Format(
    name="colmap",
    title="COLMAP text model",
    convention=f"{_COLUMNS}; cam_from_world (T is not the camera's position), OpenCV axes",
    extensions=(".txt", "/"),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    default_for=(_FILE,),
    parts=PARTS,
)
