"""The frames of a `transforms.json`: read one by one, so that a broken one costs itself alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.text import read_text
from vioapr.formats import conventions
from vioapr.formats.poses import MAX_DISTANCE_M
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.foreign_json import as_numbers, get_list, load_object

_CAMERA = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
_TIMES = {
    "timestamp": None, "timestamp_s": 1.0, "timestamp_ms": 1e-3, "timestamp_us": 1e-6,
    "timestamp_ns": 1e-9, "time_s": 1.0, "time": None,
}  # fmt: skip
_ROUNDING = 0.02


@dataclass(frozen=True, eq=False)
class TransformsFrame:
    """A frame of the file.

    Attributes:
        entry: Its 1-based number in the file.
        file_path: Of its image, as written.
        matrix: Shape (4, 4), world_from_cam, OpenGL axes; NaN where it is unusable.
        members: All that the file says of it.
    """

    entry: int
    file_path: str
    matrix: NDArray[np.float64]
    members: dict[str, Any]


@dataclass(eq=False)
class Transforms:
    """What a file holds.

    Attributes:
        path: The file.
        members: Its members beside the frames.
        frames: Those with an image's path.
        problems: What is wrong with single frames.
    """

    path: Path
    members: dict[str, Any]
    frames: list[TransformsFrame] = field(default_factory=list[TransformsFrame])
    problems: list[FormatError] = field(default_factory=list[FormatError])

    @staticmethod
    def read(path: Path) -> Transforms:
        """Read all frames that can be read.

        Raises:
            FileError: The file cannot be read, is no JSON, or no frame of it can be used.
        """
        content = load_object(path, read_text(path))
        found = Transforms(path, {key: value for key, value in content.items() if key != "frames"})
        for entry, value in enumerate(get_list(path, content, "frames"), start=1):
            members = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
            name = members.get("file_path")
            if not isinstance(name, str) or not name.strip():
                problem = 'expected a frame with a text "file_path": left out'
                found.problems.append(FormatError(path, problem, entry))
                continue
            matrix, problem = read_matrix(path, members.get("transform_matrix"), entry)
            if problem:
                problem = f"{problem}: the frame {name} has no pose"
                found.problems.append(FormatError(path, problem, entry))
            found.frames.append(TransformsFrame(entry, name, matrix, members))
        if not found.frames:
            raise found.problems[0]
        return found

    def camera(self, frame: TransformsFrame) -> dict[str, float]:
        """What is known of a frame's camera: its own members, else the file's.

        Raises:
            FormatError: They are no numbers.
        """
        given = {key: frame.members.get(key, self.members.get(key)) for key in _CAMERA}
        known = {key: value for key, value in given.items() if value is not None}
        values = list(known.values())
        numbers = as_numbers(self.path, values, (len(known),), "intrinsics", frame.entry)
        return dict(zip(known, numbers.tolist(), strict=True))

    @property
    def is_distorted(self) -> bool:
        """Whether a camera has lens distortion."""
        places = [self.members, *(frame.members for frame in self.frames)]
        return any(place.get(key) for place in places for key in _DISTORTION)

    def has(self, key: str) -> bool:
        """Whether the file or one of its frames says something under a name."""
        return key in self.members or any(key in frame.members for frame in self.frames)


def read_matrix(path: Path, value: object, entry: int) -> tuple[NDArray[np.float64], str | None]:
    """A frame's matrix as 4x4, and what is wrong with it: nested or flat lists, 3 rows or 4."""
    unusable = np.full((4, 4), np.nan)
    if value is None:
        return unusable, 'expected a "transform_matrix", found none'
    for shape in ((4, 4), (3, 4), (16,), (12,)):
        try:
            numbers = as_numbers(path, value, shape, '"transform_matrix"', entry)
        except FormatError:
            continue
        matrix = np.vstack([numbers.reshape(-1, 4)[:3], [0.0, 0.0, 0.0, 1.0]])
        if not np.isfinite(matrix).all():
            return unusable, 'expected finite numbers in "transform_matrix"'
        if np.abs(matrix[:3, 3]).max() > MAX_DISTANCE_M:
            farthest = np.abs(matrix[:3, 3]).max()
            return (
                unusable,
                f"expected a position within {MAX_DISTANCE_M:.0e} m, got {farthest:.3g}",
            )
        return matrix, None
    return unusable, 'expected a "transform_matrix" of 4x4 numbers'


def poses_of_matrices(
    found: Transforms, frames: Sequence[TransformsFrame]
) -> tuple[Rigid3, NDArray[np.float64]]:
    """Poses of some frames, NaN where a matrix is none of a rotation; problems are added.

    A matrix may carry a scale, the same along all axes: it is taken off the rotation.

    Returns:
        world_from_cam, OpenCV axes, shape (n,); the scale of each matrix, 1 mostly.
    """
    matrices = np.array([frame.matrix for frame in frames])
    rotations = matrices[:, :3, :3]
    # Bounded before it is multiplied, so that nothing overflows.
    is_sane = np.isfinite(matrices).all(axis=(1, 2)) & (np.abs(rotations) < 1e6).all(axis=(1, 2))
    safe = np.where(is_sane.reshape(-1, 1, 1), rotations, np.eye(3))
    lengths = np.linalg.norm(safe, axis=1)
    scale: NDArray[np.float64] = lengths.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.asarray(safe / scale[:, None, None])
        products = np.swapaxes(unit, 1, 2) @ unit
    is_rotation = np.asarray(np.abs(products - np.eye(3)) <= _ROUNDING).all(axis=(1, 2))
    determinants = np.asarray(np.linalg.det(np.where(np.isfinite(unit), unit, 0.0)))
    is_mirror = is_rotation & (determinants < 0)
    is_odd = np.isfinite(matrices).all(axis=(1, 2)) & ~(is_sane & is_rotation)
    for row in np.flatnonzero(is_odd).tolist():
        problem = "expected a rotation matrix, got one not orthonormal"
        found.problems.append(_no_pose(found, frames[row], problem))
    for row in np.flatnonzero(is_mirror).tolist():
        problem = "expected a rotation matrix, got a mirror image (determinant -1)"
        found.problems.append(_no_pose(found, frames[row], problem))
    known = np.flatnonzero(is_sane & is_rotation & ~is_mirror)
    poses = Rigid3.unknown((len(frames),))
    arcam = Rigid3(matrices[known, :3, 3], quaternion.from_matrix(_nearest_rotations(unit[known])))
    cam = conventions.world_from_arcam(arcam)
    poses.translation_m[known], poses.quat_xyzw[known] = cam.translation_m, cam.quat_xyzw
    return poses, np.where(is_sane & is_rotation, scale, 1.0)


def _no_pose(found: Transforms, frame: TransformsFrame, problem: str) -> FormatError:
    text = f"{problem}: the frame {frame.file_path} has no pose"
    return FormatError(found.path, text, frame.entry)


def _nearest_rotations(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotations nearest to matrices that are almost such, shape (n, 3, 3)."""
    left, _, right = np.linalg.svd(matrices)
    return left @ right


def read_times(found: Transforms) -> tuple[NDArray[np.float64], str] | None:
    """When each frame was taken, s, NaN where a frame does not say; and the unit in the file.

    `time` from 0 to 1 is an animation's, as of dynamic scenes, and no clock.

    Returns:
        Shape (n,) and the unit; None if fewer than 9 of 10 frames say.
    """
    for key, scale in _TIMES.items():
        values = np.array([_number(frame.members.get(key)) for frame in found.frames])
        known = values[np.isfinite(values)]
        if len(known) < 0.9 * len(values) or (key == "time" and known.max() <= 1):
            continue
        if scale is None:
            scale, unit = unit_of_times(known)
        else:
            unit = key.rpartition("_")[2]
        return values * scale, unit
    return None


def _number(value: object) -> float:
    """A number, or a text that is one; else NaN."""
    try:
        return float(value) if isinstance(value, int | float | str) else np.nan
    except (ValueError, OverflowError):
        return np.nan


def unit_of_times(values: NDArray[np.float64]) -> tuple[float, str]:
    """The unit of timestamps: by how large they are, else by the step between frames.

    Args:
        values: Shape (n,), n above 0, finite, in any order.

    Returns:
        Seconds of one unit, and the unit's name.
    """
    # Since 1970: seconds are 1e9, and so on by thousands.
    largest = float(np.abs(values).max())
    for scale, unit, least in ((1e-9, "ns", 1e17), (1e-6, "us", 1e14), (1e-3, "ms", 1e11)):
        if largest > least:
            return scale, unit
    steps = np.diff(np.unique(values))
    step = float(np.median(steps)) if len(steps) else 0.0
    for scale, unit, least in ((1e-9, "ns", 3e6), (1e-6, "us", 4e3), (1e-3, "ms", 8.0)):
        if step > least:
            return scale, unit
    return 1.0, "s"
