"""Meshroom's (AliceVision's) `cameras.sfm`: views with a path, poses with `rotation` and `center`.

The numbers are texts. `rotation` lists the columns of cam_from_world, which are the rows of
world_from_cam; `center` is the camera's position; OpenCV axes. Stated by its source:
alicevision/AliceVision, src/aliceVision/sfmDataIO/jsonIO.hpp (`savePose3`; Eigen's matrices are by
columns), and by converters (nerfstudio/process_data/meshroom_utils.py). Rigs are not read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import read_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named
from vioapr.formats.poses import rigid_of_matrices
from vioapr.schemas.foreign_json import get_list, load_object
from vioapr.trajectory import Trajectory


def sniff(path: Path, head: bytes) -> float:
    """Sure of a JSON object that speaks of views and the ids of their poses."""
    del path
    is_scene = head.lstrip()[:1] == b"{" and b'"viewId"' in head and b'"poseId"' in head
    return 0.9 if is_scene else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses, named by the views' paths, in their natural order.

    Views without a pose are left out.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the view's number in it.
        ParameterError: The options do not fit the file's sequences.
    """
    scene = load_object(path, read_text(path))
    pose_of = {
        str(pose.get("poseId")): _matrix(path, pose, entry)
        for entry, pose in enumerate(_objects(path, scene, "poses"), start=1)
    }
    names: list[str] = []
    matrices: list[NDArray[np.float64]] = []
    for entry, view in enumerate(_objects(path, scene, "views"), start=1):
        name = view.get("path")
        if not isinstance(name, str):
            raise FormatError(path, 'expected a view with a text "path"', entry)
        if str(view.get("rigId", "-1")) not in ("-1", str(2**32 - 1)):
            raise FormatError(path, "expected views without rigs, which are not read", entry)
        names.append(name)
        matrices.append(pose_of.get(str(view.get("poseId")), np.full((3, 4), np.nan)))
    rows = Rows.numbered(path, len(names))
    return build_named(rows, names, rigid_of_matrices(rows, np.array(matrices)), options)


def _objects(path: Path, scene: dict[str, Any], key: str) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = []
    for entry, value in enumerate(get_list(path, scene, key), start=1):
        if not isinstance(value, dict):
            raise FormatError(path, f'expected an object in "{key}"', entry)
        entries.append(cast("dict[str, Any]", value))
    return entries


def _matrix(path: Path, pose: dict[str, Any], entry: int) -> NDArray[np.float64]:
    fields = _member(_member(pose, "pose"), "transform")
    rotation = _texts(path, fields.get("rotation"), 9, '"rotation"', entry)
    center = _texts(path, fields.get("center"), 3, '"center"', entry)
    return np.column_stack([rotation.reshape(3, 3), center])


def _member(parent: dict[str, Any], key: str) -> dict[str, Any]:
    value: object = parent.get(key)
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


def _texts(path: Path, value: object, count: int, what: str, entry: int) -> NDArray[np.float64]:
    fields = cast("list[Any]", value) if isinstance(value, list) else []
    try:
        numbers = np.array([float(field) for field in fields])
    except (TypeError, ValueError, OverflowError):
        numbers = np.zeros(0)
    if numbers.shape != (count,):
        raise FormatError(path, f"expected {count} numbers in {what} of a pose", entry)
    return numbers


FORMAT = Format(
    name="meshroom",
    title="Meshroom cameras.sfm",
    convention=(
        "JSON views and poses: rotation by rows world_from_cam, center the camera's position; "
        "OpenCV axes, no times"
    ),
    extensions=(".sfm", ".json"),
    sniff=sniff,
    read=read,
    has_names=True,
    default_for=(".sfm",),
)
