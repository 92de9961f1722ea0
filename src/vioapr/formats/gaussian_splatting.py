"""3D Gaussian Splatting's `cameras.json`: a list with `img_name`, `position` and `rotation`.

`position` is the camera's, `rotation` a 3x3 matrix by rows, world_from_cam, with OpenCV axes, in
the world of the COLMAP model. Stated by its source: graphdeco-inria/gaussian-splatting,
utils/camera_utils.py (`camera_to_JSON` inverts world-to-view).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import read_text, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named, writable_names
from vioapr.formats.poses import rigid_of_matrices
from vioapr.schemas.base import parse_json
from vioapr.schemas.foreign_json import as_numbers
from vioapr.trajectory import Trajectory

PLACEHOLDER_SIZE = (640, 480)
PLACEHOLDER_FOCAL_PX = 500.0
"""Of the cameras that are written, as a trajectory knows of none."""


def sniff(path: Path, head: bytes) -> float:
    """Sure of a JSON list that speaks of image names, positions and rotations."""
    del path
    keys = (b'"img_name"', b'"position"', b'"rotation"')
    return 0.95 if head.lstrip()[:1] == b"[" and all(key in head for key in keys) else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses in the natural order of the images' names.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the camera's number in it.
        ParameterError: The options do not fit the file's sequences.
    """
    cameras: object = parse_json(path, read_text(path))
    if not isinstance(cameras, list) or not cameras:
        raise FormatError(path, "expected a list of cameras, got something else or none")
    names: list[str] = []
    matrices: list[NDArray[np.float64]] = []
    for entry, value in enumerate(cast("list[object]", cameras), start=1):
        camera = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        name = camera.get("img_name")
        if not isinstance(name, str):
            raise FormatError(path, 'expected a camera with a text "img_name"', entry)
        names.append(name)
        rotation = as_numbers(path, camera.get("rotation"), (3, 3), '"rotation"', entry)
        position = as_numbers(path, camera.get("position"), (3,), '"position"', entry)
        matrices.append(np.column_stack([rotation, position]))
    rows = Rows.numbered(path, len(names))
    return build_named(rows, names, rigid_of_matrices(rows, np.array(matrices)), options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits; sizes and focal lengths are placeholders.

    Raises:
        UnwritableError: The file cannot be written.
        ParameterError: Two images have one name.
    """
    width, height = PLACEHOLDER_SIZE
    matrices = trajectory.target_from_source.to_matrix()
    cameras = [
        {
            "id": number,
            "img_name": name,
            "width": width,
            "height": height,
            "position": matrix[:3, 3].tolist(),
            "rotation": matrix[:3, :3].tolist(),
            "fy": PLACEHOLDER_FOCAL_PX,
            "fx": PLACEHOLDER_FOCAL_PX,
        }
        for number, (name, matrix) in enumerate(
            zip(writable_names(trajectory, ""), matrices, strict=True)
        )
    ]
    write_text(path, json.dumps(cameras) + "\n")


FORMAT = Format(
    name="3dgs",
    title="3D Gaussian Splatting cameras.json",
    convention=(
        "JSON list of img_name, position and 3x3 rotation; world_from_cam, OpenCV axes, no times"
    ),
    extensions=(".json",),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    default_for=("cameras.json",),
)
