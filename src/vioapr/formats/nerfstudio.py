"""nerfstudio and instant-ngp `transforms.json`: 4x4 matrices, OpenGL camera axes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named, writable_names
from vioapr.formats.poses import rigid_of_matrices
from vioapr.schemas.foreign_json import as_numbers, get_list, load_object
from vioapr.trajectory import Trajectory


def sniff(path: Path, head: bytes) -> float:
    """Sure of a JSON object that speaks of transform matrices."""
    del path
    return 0.95 if head.lstrip()[:1] == b"{" and b'"transform_matrix"' in head else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses in the natural order of the images' paths.

    The world is the file's, which nerfstudio turns and scales: see its `applied_transform`.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the frame's number in it.
        ParameterError: The options do not fit the file's sequences.
    """
    frames = get_list(path, load_object(path, read_text(path)), "frames")
    names: list[str] = []
    matrices: list[NDArray[np.float64]] = []
    for entry, value in enumerate(frames, start=1):
        frame = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        name = frame.get("file_path")
        if not isinstance(name, str):
            raise FormatError(path, 'expected a frame with a text "file_path"', entry)
        names.append(name)
        matrix = frame.get("transform_matrix")
        matrices.append(as_numbers(path, matrix, (4, 4), '"transform_matrix"', entry))
    rows = Rows.numbered(path, len(names))
    poses = conventions.world_from_arcam(rigid_of_matrices(rows, np.array(matrices)))
    return build_named(rows, names, poses, options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits; intrinsics are left out.

    Raises:
        UnwritableError: The file cannot be written.
        ParameterError: Two images have one name.
    """
    names = writable_names(trajectory, "")
    matrices = conventions.world_from_arcam(trajectory.target_from_source).to_matrix().tolist()
    frames = [
        {"file_path": name, "transform_matrix": matrix}
        for name, matrix in zip(names, matrices, strict=True)
    ]
    write_text(path, json.dumps({"frames": frames}, indent=1) + "\n")


FORMAT = Format(
    name="nerfstudio",
    title="nerfstudio or instant-ngp transforms.json",
    convention="4x4 transform_matrix by file_path; world_from_cam, OpenGL camera axes, no times",
    extensions=(".json",),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    default_for=(".json",),
)
