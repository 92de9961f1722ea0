"""Bundler's `bundle.out` and VisualSFM's `.nvm`, the older exports of structure from motion.

Bundler: for each image `f k1 k2`, a 3x3 matrix and t, cam_from_world with OpenGL axes (the camera
looks along -z); images are named by `list.txt` beside it; f = 0 marks images without a pose. Stated
by snavely/bundler_sfm, README.md ("Output format"). NVM: `name f qw qx qy qz cx cy cz k 0`, the
camera's position and the rotation cam_from_world, OpenCV axes. Stated by VisualSFM's documentation
("NVM format").
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.tables import RowProblem, Rows, is_number
from vioapr.files.text import read_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.left_out import NO_POSE
from vioapr.formats.named import build_named
from vioapr.formats.poses import build_trajectory, index_times, poses_of, rigid_of_matrices
from vioapr.plurals import count_of
from vioapr.trajectory import Trajectory

_BUNDLE_HEADER, _NVM_HEADER = b"# Bundle file", b"NVM_V3"
_LIST = "list.txt"
_MAX_IMAGES = 10_000_000


def sniff_bundle(path: Path, head: bytes) -> float:
    """Sure by the first line."""
    del path
    return 0.98 if head.startswith(_BUNDLE_HEADER) else 0.0


def sniff_nvm(path: Path, head: bytes) -> float:
    """Sure by the first line."""
    del path
    return 0.98 if head.lstrip().startswith(_NVM_HEADER) else 0.0


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """The fields of each line that has some, with its number; comments are passed over."""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line.split()


def _count(path: Path, fields: list[str], number: int) -> int:
    if not fields[0].isdecimal() or len(fields[0]) > 9 or int(fields[0]) > _MAX_IMAGES:
        raise FormatError(path, f"expected the number of images, got {fields[0][:40]!r}", number)
    return int(fields[0])


def read_bundle(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses, named by `list.txt` where it is there, in their order.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
        ParameterError: The options do not fit the file's sequences.
    """
    lines = list(_lines(read_text(path)))
    if not lines:
        raise FormatError(path, "expected a Bundler file, got an empty one")
    count = _count(path, lines[0][1], lines[0][0])
    body = lines[1 : 1 + 5 * count]
    if not count or len(body) < 5 * count:
        raise FormatError(
            path, f"expected 5 lines for each of {count_of(count, 'image')}, got {len(body)}"
        )
    for number, fields in body:
        if len(fields) != 3 or not all(map(is_number, fields)):
            raise FormatError(path, "expected 3 numbers in a line of an image", number)
    numbers = np.array([fields for _, fields in body], dtype=np.float64).reshape(count, 5, 3)
    rows = Rows(path, [[]] * count, [number for number, _ in body[::5]])
    for row in np.flatnonzero(numbers[:, 0, 0] == 0).tolist():
        problem = RowProblem("expected a focal length, got 0: an image without a pose", NO_POSE)
        rows.problems[rows.lines[row]] = problem
        numbers[row] = np.nan
    matrices = np.concatenate([numbers[:, 1:4], numbers[:, 4, :, None]], axis=2)
    cam_from_world = rigid_of_matrices(rows, matrices)
    poses = conventions.world_from_arcam(conventions.cam_from_world(cam_from_world))
    names = _listed_names(path, count)
    if names is not None:
        return build_named(rows, names, poses, options)
    times, is_timed = index_times(count, options), options.rate_hz is not None
    return build_trajectory(rows, times, poses, options, is_timed=is_timed)


def _listed_names(path: Path, count: int) -> list[str] | None:
    """The images of `list.txt`, if it has as many; a focal length may follow a name."""
    file = path.with_name(_LIST)
    if not file.is_file():
        return None
    names = [fields[0] for _, fields in _lines(read_text(file))]
    return names if len(names) == count else None


def read_nvm(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses of the first model, in the natural order of the images' names.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
        ParameterError: The options do not fit the file's sequences.
    """
    lines = list(_lines(read_text(path)))[1:]  # the first is NVM_V3
    if not lines:
        raise FormatError(path, "expected the number of images below NVM_V3, got none")
    count = _count(path, lines[0][1], lines[0][0])
    body = lines[1 : 1 + count]
    if not count or len(body) < count:
        raise FormatError(
            path, f"expected a line for each of {count_of(count, 'image')}, got {len(body)}"
        )
    names: list[str] = []
    fields: list[list[str]] = []
    for number, row in body:
        # A name may have blanks; the ten numbers are at the end.
        if len(row) < 11:
            problem = f"expected name f qw qx qy qz cx cy cz k 0, got {len(row)} columns"
            raise FormatError(path, problem, number)
        names.append(" ".join(row[:-10]))
        fields.append(row[-10:])
    rows = Rows(path, fields, [number for number, _ in body])
    values = rows.numbers(slice(1, 8))
    poses = poses_of(rows, values[:, 4:7], values[:, [1, 2, 3, 0]])
    return build_named(rows, names, conventions.centre_and_cam_from_world(poses), options)


FORMAT = Format(
    name="bundler",
    title="Bundler bundle.out",
    convention=(
        "3x3 matrix and t an image; cam_from_world (t is not the camera's position), OpenGL "
        "camera axes, no times; names in list.txt"
    ),
    extensions=(".out",),
    sniff=sniff_bundle,
    read=read_bundle,
    default_for=("bundle.out",),
)

NVM_FORMAT = Format(
    name="nvm",
    title="VisualSFM .nvm",
    convention=(
        "name f qw qx qy qz cx cy cz k 0; the camera's position, quaternion wxyz cam_from_world, "
        "OpenCV axes, no times"
    ),
    extensions=(".nvm",),
    sniff=sniff_nvm,
    read=read_nvm,
    has_names=True,
    default_for=(".nvm",),
)
