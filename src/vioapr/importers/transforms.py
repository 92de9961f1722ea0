"""The frames of a `transforms.json`: read one by one, so that a broken one costs itself alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.text import read_text
from vioapr.formats.base import TimeUnit
from vioapr.formats.nerfstudio import read_frame_times
from vioapr.schemas.foreign_json import as_numbers, get_list, load_object

_CAMERA = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")


@dataclass(frozen=True, eq=False)
class TransformsFrame:
    """A frame of the file.

    Attributes:
        entry: Its 1-based number in the file.
        file_path: Of its image, as written.
        matrix: Shape (4, 4), world_from_cam, OpenGL axes, as written; NaN where it is unusable.
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

    def times(self) -> tuple[NDArray[np.float64], TimeUnit] | None:
        """When each frame was taken, s, NaN where it does not say, and the unit; or None."""
        return read_frame_times(self.path, [frame.members for frame in self.frames])

    def has(self, key: str) -> bool:
        """Whether the file or one of its frames says something under a name."""
        return key in self.members or any(key in frame.members for frame in self.frames)


def read_matrix(path: Path, value: object, entry: int) -> tuple[NDArray[np.float64], str | None]:
    """A frame's matrix as 4x4, and what keeps it from being one: lists of 3 rows or 4, or flat."""
    unusable = np.full((4, 4), np.nan)
    if value is None:
        return unusable, 'expected a "transform_matrix", found none'
    for shape in ((4, 4), (3, 4), (16,), (12,)):
        try:
            numbers = as_numbers(path, value, shape, '"transform_matrix"', entry)
        except FormatError:
            continue
        rows = numbers.reshape(-1, 4)
        if not np.isfinite(rows).any():
            return unusable, 'expected finite numbers in its "transform_matrix"'
        return (rows if len(rows) == 4 else np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])), None
    return unusable, 'expected a "transform_matrix" of 4x4 numbers'
