"""COLMAP's binary model: `images.bin`, cam_from_world, little-endian.

An image is its number (u32), quaternion wxyz and translation (7 f64), camera (u32), name (text
ended by a zero byte), a count of points (u64) and the points (24 bytes each). Read without
pycolmap: one file of a model, without its cameras, is enough for a trajectory, and a broken one
must give an error rather than end the process.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import is_folder, plain_name, read_bytes, write_bytes
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.colmap import PARTS, PLACEHOLDER_PINHOLE, PLACEHOLDER_SIZE, file_of, images_of
from vioapr.formats.named import build_named
from vioapr.formats.poses import poses_of
from vioapr.plurals import count_of
from vioapr.trajectory import Trajectory

_FILE = "images.bin"
_COUNT = struct.Struct("<Q")
_IMAGE = struct.Struct("<I7dI")
_CAMERA = struct.Struct("<IiQQ4d")
_POINT_BYTES = 24
_PINHOLE = 1


def sniff(path: Path, head: bytes) -> float:
    """Sure by the name images.bin and a first image that makes sense; likely by the latter."""
    if not head:
        return 0.95 if (path / _FILE).is_file() else 0.0
    if len(head) < _COUNT.size + _IMAGE.size:
        return 0.0
    quat_wxyz = np.array(_IMAGE.unpack_from(head, _COUNT.size)[1:5])
    # Comparing each component first keeps the squares from overflowing; NaN compares false.
    if not (np.abs(quat_wxyz) < 2).all() or abs(np.linalg.norm(quat_wxyz) - 1) > 1e-3:
        return 0.0
    return 1.0 if plain_name(path) == _FILE else 0.8


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses of `images.bin` or of a model's folder, ordered by name.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the image's number in it.
        ParameterError: The options do not fit the file's sequences.
    """
    path = file_of(path, _FILE)
    content = read_bytes(path)
    if len(content) < _COUNT.size:
        raise FormatError(path, "expected a count of images, got the end of the file")
    (count,) = _COUNT.unpack_from(content)
    if count == 0 or count > len(content) // _IMAGE.size:
        raise FormatError(
            path, f"expected at least one image and as many as the file has room for, got {count}"
        )
    names: list[str] = []
    values = np.zeros((count, 7))
    at = _COUNT.size
    for number in range(1, count + 1):
        end_of_name = content.find(b"\0", at + _IMAGE.size)
        if end_of_name < 0 or end_of_name + 1 + _COUNT.size > len(content):
            raise FormatError(
                path, f"expected {count_of(count, 'image')}, got the end of the file", number
            )
        values[number - 1] = _IMAGE.unpack_from(content, at)[1:8]
        try:
            names.append(content[at + _IMAGE.size : end_of_name].decode())
        except UnicodeDecodeError:
            raise FormatError(path, "expected an image name in UTF-8", number) from None
        (points,) = _COUNT.unpack_from(content, end_of_name + 1)
        at = end_of_name + 1 + _COUNT.size + points * _POINT_BYTES
        if at > len(content):
            raise FormatError(
                path, f"expected {count_of(points, 'point')}, got the end of the file", number
            )
    rows = Rows.numbered(path, len(names))
    poses = poses_of(rows, values[:, 4:7], values[:, [1, 2, 3, 0]])
    return build_named(rows, names, conventions.cam_from_world(poses), options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write images.bin, or a model into a folder (a path without a suffix).

    The model's only camera is a placeholder, PINHOLE; it has no points.

    Raises:
        ParameterError: A name that the format cannot hold.
        UnwritableError: A file cannot be written.
    """
    images = [
        _IMAGE.pack(number, *pose, 1) + name.encode() + b"\0" + _COUNT.pack(0)
        for number, name, pose in images_of(trajectory)
    ]
    content = _COUNT.pack(len(images)) + b"".join(images)
    if path.suffix and not is_folder(path):
        write_bytes(path, content)
        return
    write_bytes(path / _FILE, content)
    camera = _CAMERA.pack(1, _PINHOLE, *PLACEHOLDER_SIZE, *PLACEHOLDER_PINHOLE)
    write_bytes(path / "cameras.bin", _COUNT.pack(1) + camera)
    write_bytes(path / "points3D.bin", _COUNT.pack(0))


FORMAT = Format(
    name="colmap-binary",
    title="COLMAP binary model",
    convention="images.bin; cam_from_world (T is not the camera's position), OpenCV axes",
    extensions=(".bin", "/"),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    default_for=(".bin",),
    parts=PARTS,
)
