"""Spectacular AI's JSON Lines: `time`, `position` {x, y, z} and `orientation` {w, x, y, z}.

World_from_cam in a z-up world, OpenCV axes, seconds, metres. The SDK writes the pose itself, or
`cameraPoses` with a 4x4 `cameraToWorld` for each camera; recordings (`data.jsonl`) have the pose
below a name as `groundTruth`, of the device, among lines of sensors. Stated by the makers:
SpectacularAI/docs, other/DATA_FORMAT.md ("Ground truth and VIO output") and the SDK's page on
tracking ("Coordinate systems"); `cameraToWorld` by SpectacularAI/sdk-examples,
python/oak/common/deserialize_output.py.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError
from vioapr.files.tables import RowProblem, Rows
from vioapr.files.text import read_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.left_out import NOT_TRACKED
from vioapr.formats.poses import build_trajectory, rigid_of_file
from vioapr.formats.times import seconds_of
from vioapr.geometry import quaternion
from vioapr.schemas.foreign_json import as_numbers
from vioapr.trajectory import UNIT_TOLERANCE, Trajectory

_OUTPUT, _CAMERAS = "pose", "cameraPoses"
_OF_CAMERA = (_OUTPUT, _CAMERAS)
_TRACKING = "TRACKING"


def sniff(path: Path, head: bytes) -> float:
    """Sure of lines that are JSON objects, one of them with a time and a pose."""
    del path
    if head.lstrip()[:1] != b"{":
        return 0.0
    for line in head.split(b"\n")[:200]:
        try:
            entry: object = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(entry, dict) and "time" in entry and _kind_of(cast("dict[str, Any]", entry)):
            return 0.9
    return 0.0


def _kind_of(entry: dict[str, Any]) -> str | None:
    """Where a line has its pose; None if it has none."""
    if isinstance(entry.get(_CAMERAS), list) and entry[_CAMERAS]:
        return _CAMERAS
    if "position" in entry and "orientation" in entry:
        return _OUTPUT
    for key, value in entry.items():
        if isinstance(value, dict) and "position" in value and "orientation" in value:
            return key
    return None


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses of the SDK, or world_from_device poses below a name.

    Lines that say another status than TRACKING have no pose.

    Args:
        path: The file.
        options: `sequence` names the poses to read where the file has several.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
        ParameterError: The poses are several tracks', or not the one's that is asked for.
    """
    tracks = _read_tracks(path, options)
    kind = _choose(path, list(tracks), options)
    rows = Rows(path, [[] for _ in tracks[kind]], [line for line, _ in tracks[kind]])
    times: list[float] = []
    matrices: list[NDArray[np.float64]] = []
    for line, entry in tracks[kind]:
        times.append(float(as_numbers(path, entry.get("time"), (), '"time"', line)))
        matrices.append(_matrix_of(path, entry, kind, line))
        status = entry.get("status", _TRACKING)
        if status != _TRACKING:
            rows.problems[line] = RowProblem(
                f"expected a tracked pose, got {status!r}", NOT_TRACKED
            )
            matrices[-1] = np.full((4, 4), np.nan)
    if kind == _OUTPUT:
        text = "poses are taken for the primary camera's: some versions write the IMU's"
        options.note(path, text, is_warning=False)
    poses = rigid_of_file(rows, np.array(matrices), options)
    seconds = seconds_of(path, np.array(times), options, fixed="s")
    source = "cam" if kind in _OF_CAMERA else "device"
    return build_trajectory(rows, seconds, poses, options, source=source)


def _read_tracks(path: Path, options: ReadOptions) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """The lines with a pose and their numbers, by where they have it."""
    tracks: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    text = read_text(path)
    lines = text.splitlines()
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            entry: object = json.loads(line)
        except (ValueError, RecursionError):
            entry = None
        if isinstance(entry, dict):
            fields = cast("dict[str, Any]", entry)
            if (kind := _kind_of(fields)) is not None:
                tracks.setdefault(kind, []).append((number, fields))
        elif number == len(lines) > 1 and not text.endswith("\n") and not options.strict:
            options.note(path, f"line {number} ends early: left out", is_warning=True)
        else:
            raise FormatError(path, "expected a JSON object in each line", number)
    return tracks


def _choose(path: Path, kinds: list[str], options: ReadOptions) -> str:
    if not kinds:
        raise FormatError(path, 'expected lines with "position" and "orientation", got none')
    listed = ", ".join(kinds)
    if options.sequence is not None:
        if options.sequence not in kinds:
            raise ParameterError(f"{path} has no {options.sequence!r}: expected one of {listed}")
        return options.sequence
    if len(kinds) > 1:
        raise ParameterError(f"{path} has several tracks: choose one with `sequence`: {listed}")
    return kinds[0]


def _matrix_of(path: Path, entry: dict[str, Any], kind: str, line: int) -> NDArray[np.float64]:
    """The 4x4 matrix of a line; NaN where it has a quaternion that is none."""
    if kind == _CAMERAS:
        camera: object = entry[_CAMERAS][0]
        fields = cast("dict[str, Any]", camera) if isinstance(camera, dict) else {}
        return as_numbers(path, fields.get("cameraToWorld"), (4, 4), '"cameraToWorld"', line)
    pose = entry if kind == _OUTPUT else cast("dict[str, Any]", entry[kind])
    position = _vector(path, pose["position"], "xyz", '"position" with x, y, z', line)
    quat = _vector(path, pose["orientation"], "xyzw", '"orientation" with w, x, y, z', line)
    norm = float(np.linalg.norm(quat))
    if not abs(norm - 1) <= UNIT_TOLERANCE:
        return np.full((4, 4), np.nan)
    matrix = np.eye(4)
    matrix[:3, :3] = quaternion.to_matrix(quat / norm)
    matrix[:3, 3] = position
    return matrix


def _vector(path: Path, value: object, names: str, what: str, line: int) -> NDArray[np.float64]:
    fields = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
    return as_numbers(path, [fields.get(name) for name in names], (len(names),), what, line)


FORMAT = Format(
    name="spectacular",
    title="Spectacular AI JSON Lines",
    convention=(
        "time, position x y z, orientation w x y z, or cameraPoses; world_from_cam, z-up world, "
        "OpenCV axes, seconds, metres"
    ),
    extensions=(".jsonl",),
    sniff=sniff,
    read=read,
    has_times=True,
    default_for=(".jsonl",),
    up="+z",
)
