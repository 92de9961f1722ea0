"""OpenSfM's and OpenDroneMap's `reconstruction.json`: `shots` with `rotation` and `translation`.

Cam_from_world: an axis-angle rotation in radians and p_cam = R p_world + t, OpenCV axes; the world
is z up where satellites were seen, and about so otherwise. Stated by its makers: mapillary/OpenSfM,
doc/source/geometry.rst ("Camera Coordinates").
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import read_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named
from vioapr.formats.poses import poses_of, quaternions_of_rotvecs
from vioapr.schemas.base import parse_json
from vioapr.schemas.foreign_json import as_numbers
from vioapr.trajectory import Trajectory


def sniff(path: Path, head: bytes) -> float:
    """Sure of a JSON list that speaks of shots, by their list or by its file's name."""
    start = head.lstrip()
    if start[:1] != b"[" or b'"cameras"' not in head[:4096]:
        return 0.0
    return 0.9 if b'"shots"' in head or path.name.startswith("reconstruction") else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses of the largest reconstruction, in the natural order of the shots.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the shot's number in it.
        ParameterError: The options do not fit the file's sequences.
    """
    found = _shots_of_models(path)
    shots = max(found, key=len)
    if len(found) > 1:
        rest = sum(map(len, found)) - len(shots)
        text = f"{len(found)} reconstructions: {rest} shots of the smaller ones are left out"
        options.note(path, text, is_warning=True)
    rotvecs, translations = np.zeros((len(shots), 3)), np.zeros((len(shots), 3))
    for row, value in enumerate(shots.values()):
        shot = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        rotvecs[row] = as_numbers(path, shot.get("rotation"), (3,), '"rotation"', row + 1)
        translation = shot.get("translation")
        translations[row] = as_numbers(path, translation, (3,), '"translation"', row + 1)
    rows = Rows.numbered(path, len(shots))
    poses = poses_of(rows, translations, quaternions_of_rotvecs(rotvecs))
    return build_named(rows, list(shots), conventions.cam_from_world(poses), options)


def _shots_of_models(path: Path) -> list[dict[str, Any]]:
    """The shots of each reconstruction that has some."""
    models: object = parse_json(path, read_text(path))
    found: list[dict[str, Any]] = []
    for model in cast("list[object]", models) if isinstance(models, list) else []:
        fields = cast("dict[str, Any]", model) if isinstance(model, dict) else {}
        shots: object = fields.get("shots")
        if isinstance(shots, dict) and shots:
            found.append(cast("dict[str, Any]", shots))
    if not found:
        raise FormatError(path, 'expected a list of reconstructions with "shots", got none')
    return found


FORMAT = Format(
    name="opensfm",
    title="OpenSfM or OpenDroneMap reconstruction.json",
    convention=(
        "JSON shots with axis-angle rotation and translation; cam_from_world (t is not the "
        "camera's position), OpenCV axes, no times"
    ),
    extensions=(".json",),
    sniff=sniff,
    read=read,
    has_names=True,
    default_for=("reconstruction.json",),
)
