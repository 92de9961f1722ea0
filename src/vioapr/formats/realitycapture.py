"""RealityCapture's CSV: `#name,x,y,alt,heading,pitch,roll` and further columns.

Position in a world of x east, y north, z up; angles in degrees. At 0, 0, 0 the camera looks down
and the top of its picture points to y; heading turns it clockwise seen from above, pitch then
raises the view, roll turns it about its y axis. Stated by the makers: "Knowledge Base: Registration
export and camera orientations" (Epic's forum, topic 682588, function EulerRotation, which gives
cam_from_world with OpenCV axes). A published camera agrees with it to 8 digits: its XMP matrix and
its angles (topic 710449). Exports of omega, phi, kappa are not read.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import format_rows, parse_rows
from vioapr.files.text import read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named, writable_names
from vioapr.formats.poses import rigid_of_matrices
from vioapr.trajectory import Trajectory

_COLUMNS = ("name", "x", "y", "alt", "heading", "pitch", "roll")
_OTHER_NAMES = {"z": "alt", "altitude": "alt", "yaw": "heading"}
_MAX_DEG = 1e6
_GIMBAL_LOCK = 1e-7


def sniff(path: Path, head: bytes) -> float:
    """Sure by the header line."""
    del path
    lines = head[:4096].decode("utf-8", "replace").splitlines()
    found = _find_header(lines)
    if found is None:
        return 0.0
    names = found[1]
    return 0.95 if set(_COLUMNS) <= set(names) or {"omega", "phi", "kappa"} <= set(names) else 0.0


def _find_header(lines: list[str]) -> tuple[int, list[str]] | None:
    """The index and the columns of the header, which may come after a line `#cameras 12`."""
    for index, line in enumerate(lines[:3]):
        names = [name.strip().lower() for name in line.lstrip("\ufeff# ").split(",")]
        if line.lstrip("\ufeff ").startswith("#") and names[0] == "name" and len(names) > 6:
            return index, [_OTHER_NAMES.get(name, name) for name in names]
    return None


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses in the natural order of the images' names.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
        ParameterError: The options do not fit the file's sequences.
    """
    text = read_text(path)
    found = _find_header(text.splitlines()[:3])
    names = [] if found is None else found[1]
    missing = [name for name in _COLUMNS if name not in names]
    if missing:
        hint = ": export heading, pitch, roll instead of omega, phi, kappa" * ("omega" in names)
        lacks = "it has no " + ", ".join(missing) if found else "found none"
        problem = f"expected a header #{','.join(_COLUMNS)}; {lacks}{hint}"
        raise FormatError(path, problem, None if found is None else found[0] + 1)
    width = len(names)
    rows = parse_rows(path, text, range(width, width + 1), what=",".join(names), delimiter=",")
    columns = [names.index(name) for name in _COLUMNS]
    values = rows.numbers(columns[1:])
    matrices = np.zeros((len(rows), 3, 4))
    matrices[:, :, :3] = np.swapaxes(_cam_from_world(values[:, 3:]), -1, -2)
    matrices[:, :, 3] = values[:, :3]
    poses = rigid_of_matrices(rows, matrices)
    return build_named(rows, rows.column(columns[0]), poses, options)


def _cam_from_world(heading_pitch_roll_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices of the makers' angles, shape (n, 3, 3); NaN for angles that are none."""
    with np.errstate(all="ignore"):
        is_angle = np.abs(heading_pitch_roll_deg) <= _MAX_DEG
    angles = np.radians(np.where(is_angle, heading_pitch_roll_deg, np.nan))
    (sh, sp, sr), (ch, cp, cr) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [cr * ch + sr * sp * sh, sr * sp * ch - cr * sh, -cp * sr],
        [-cp * sh, -cp * ch, -sp],
        [cr * sp * sh - sr * ch, cr * sp * ch + sr * sh, -cp * cr],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write positions and angles with all digits; other columns are left out.

    Raises:
        ParameterError: A name that the format cannot hold.
        UnwritableError: The file cannot be written.
    """
    names = writable_names(trajectory, ",")
    poses = conventions.cam_from_world(trajectory.target_from_source)
    matrices = poses.to_matrix()
    cos_pitch: NDArray[np.float64] = np.hypot(matrices[:, 1, 0], matrices[:, 1, 1])
    pitch = np.arctan2(-matrices[:, 1, 2], cos_pitch)
    heading: NDArray[np.float64] = np.arctan2(-matrices[:, 1, 0], -matrices[:, 1, 1])
    roll: NDArray[np.float64] = np.arctan2(-matrices[:, 0, 2], -matrices[:, 2, 2])
    # Of a level camera (pitch 90), heading and roll turn about one axis: heading has it all.
    is_level = cos_pitch < _GIMBAL_LOCK
    heading = np.where(is_level, np.arctan2(-matrices[:, 0, 1], matrices[:, 0, 0]), heading)
    roll = np.where(is_level, 0.0, roll)
    angles = np.degrees(np.column_stack([heading, pitch, roll]))
    columns = np.column_stack([trajectory.position_m, angles]).tolist()
    rows = [(name, *row) for name, row in zip(names, columns, strict=True)]
    write_text(path, f"#{','.join(_COLUMNS)}\n" + format_rows(rows, ","))


FORMAT = Format(
    name="realitycapture",
    title="RealityCapture or RealityScan CSV",
    convention=(
        "#name,x,y,alt,heading,pitch,roll; the camera's position, angles in degrees, looking down "
        "at 0; z-up world, read as world_from_cam with OpenCV axes, no times"
    ),
    extensions=(".csv",),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    up="+z",
)
