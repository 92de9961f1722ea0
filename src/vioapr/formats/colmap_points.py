"""COLMAP's points: `points3D.bin`, little-endian, in the model's world.

A point is its number (u64), position (3 f64), colour (3 u8), error (f64), a count of observations
(u64) and these (8 bytes each). Read without pycolmap, as images are: whoever only shows a map needs
no more.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.text import read_bytes

POINTS_FILE = "points3D.bin"
_COUNT = struct.Struct("<Q")
_POINT = np.dtype(
    [("id", "<u8"), ("xyz", "<f8", 3), ("rgb", "u1", 3), ("error", "<f8"), ("track", "<u8")]
)
_OBSERVATION_BYTES = 8


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Read the points of a model.

    Returns:
        Positions in the model's world, shape (n, 3), and colours, RGB, shape (n, 3).

    Raises:
        FileError: It cannot be read, or is cut off, naming the point.
    """
    content = read_bytes(path)
    if len(content) < _COUNT.size:
        raise FormatError(path, "expected a count of points, got the end of the file")
    (count,) = _COUNT.unpack_from(content)
    if count > len(content) // _POINT.itemsize:
        raise FormatError(path, f"expected {count} points, got {len(content)} bytes")
    rows = np.zeros(count, dtype=_POINT)
    at, track_at = _COUNT.size, _POINT.itemsize - _COUNT.size
    for number in range(count):
        end = at + _POINT.itemsize
        if end <= len(content):
            (observations,) = _COUNT.unpack_from(content, at + track_at)
            rows[number] = np.frombuffer(content, _POINT, 1, at)[0]
            at = end + _OBSERVATION_BYTES * observations
        if end > len(content) or at > len(content):
            raise FormatError(path, "expected a point, got the end of the file", number + 1)
    return rows["xyz"].copy(), rows["rgb"].copy()
