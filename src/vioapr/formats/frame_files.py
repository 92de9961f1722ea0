"""Phone apps that write a JSON file a frame: 3D Scanner App ("All Data") and Polycam (raw).

Both write ARKit's poses: world_from_cam, y up, in metres, OpenGL camera axes. A broken file costs
its frame alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileError, FormatError
from vioapr.files.tables import RowProblem, Rows
from vioapr.files.text import natural_key, read_text
from vioapr.formats import conventions
from vioapr.formats.base import ReadOptions
from vioapr.formats.named import build_named
from vioapr.formats.poses import build_trajectory, rigid_of_file
from vioapr.schemas.foreign_json import as_numbers, load_object
from vioapr.trajectory import Trajectory

SCANNER_APP_FILES = "frame_*.json"
POLYCAM_FOLDERS = (("corrected_cameras", "corrected_images"), ("cameras", "images"))
"""Folders of cameras with those of their images: Polycam corrects poses and lenses, if asked."""

_LEAST_TIME_DIGITS = 9
_POLYCAM_STEP_S = (0.02, 60.0)


@dataclass(frozen=True, eq=False)
class FrameFile:
    """What a file says of its frame.

    Attributes:
        path: The file; its name without ending is the image's.
        timestamp_s: When it was taken, s; NaN where the file does not say.
        matrix: world_from_cam, shape (4, 4), OpenGL axes; NaN where it is unusable.
        camera: Width, height, fx, fy, cx, cy, pixels; NaN where not known.
    """

    path: Path
    timestamp_s: float
    matrix: NDArray[np.float64]
    camera: tuple[float, float, float, float, float, float]


@dataclass(eq=False)
class FrameFiles:
    """The frames of a capture.

    Attributes:
        frames: In the natural order of their names.
        problems: What is wrong with single files.
    """

    frames: list[FrameFile] = field(default_factory=list[FrameFile])
    problems: list[FileError] = field(default_factory=list[FileError])

    def ordered(self) -> FrameFiles:
        """Those with a time later than all before; problems are added for the others."""
        kept: list[FrameFile] = []
        for frame in sorted(self.frames, key=lambda frame: frame.timestamp_s):
            time_s = frame.timestamp_s
            if kept and not time_s > kept[-1].timestamp_s:
                what = "the time of another frame" if np.isfinite(time_s) else "no time"
                problem = f"expected a later time than the frame before, got {what}: left out"
                self.problems.append(FormatError(frame.path, problem))
            elif np.isfinite(time_s):
                kept.append(frame)
        return FrameFiles(kept, self.problems)


def find_scanner_app(folder: Path) -> list[Path]:
    """The frames' files of 3D Scanner App, in order; none if the folder is no such."""
    found = sorted(folder.glob(SCANNER_APP_FILES), key=lambda path: natural_key(path.name))
    return [path for path in found if path.stem.removeprefix("frame_").isdecimal()]


def read_scanner_app(folder: Path) -> FrameFiles:
    """Read `frame_00000.json` and so on: `cameraPoseARFrame` by rows, `intrinsics`, `time`.

    Raises:
        FileError: There is none, or none can be read.
    """
    return _read_all(folder, find_scanner_app(folder), _scanner_app_frame)


def find_polycam(folder: Path) -> tuple[list[Path], Path] | None:
    """The cameras' files of Polycam in order and the folder of their images; None without.

    Args:
        folder: The capture, its `keyframes`, or one in which the capture is.
    """
    for root in (folder / "keyframes", folder, *sorted(folder.glob("*/keyframes"))):
        for cameras, images in POLYCAM_FOLDERS:
            if found := sorted((root / cameras).glob("*.json"), key=lambda p: natural_key(p.name)):
                return found, root / images
    return None


def read_polycam(folder: Path, paths: Sequence[Path]) -> FrameFiles:
    """Read Polycam's cameras: `t_00` to `t_23`, `fx` to `cy`, `width`, `height`, `timestamp`.

    Raises:
        FileError: There is none, or none can be read.
    """
    found = _read_all(folder, paths, _polycam_frame)
    times = np.array([frame.timestamp_s for frame in found.frames])
    steps = np.diff(np.unique(times[np.isfinite(times)]))
    step = float(np.median(steps)) if len(steps) else 1.0
    # Microseconds, as Polycam says; where the steps are none of keyframes, which are parts of a
    # second to a minute apart, another unit.
    units = (per for per in (1, 1000, 1_000_000) if step / per <= _POLYCAM_STEP_S[1])
    per_second = next(units, 1_000_000_000) if len(steps) else 1_000_000
    found.frames = [
        FrameFile(frame.path, frame.timestamp_s / per_second, frame.matrix, frame.camera)
        for frame in found.frames
    ]
    return found


def _read_all(
    folder: Path, paths: Sequence[Path], read: Callable[[Path, dict[str, Any]], FrameFile]
) -> FrameFiles:
    """Read all files that can be read.

    Raises:
        FileError: There is none, or none can be read.
    """
    found = FrameFiles()
    for path in paths:
        try:
            found.frames.append(read(path, load_object(path, read_text(path))))
        except FileError as error:
            found.problems.append(error)
    if not found.frames:
        if found.problems:
            raise found.problems[0]
        raise FormatError(folder, "expected a JSON file a frame, found none")
    return found


def _scanner_app_frame(path: Path, content: dict[str, Any]) -> FrameFile:
    if "cameraPoseARFrame" not in content:
        raise FormatError(path, 'expected a frame with "cameraPoseARFrame"')
    k = np.full(9, np.nan)
    if content.get("intrinsics") is not None:
        k = as_numbers(path, content["intrinsics"], (9,), '"intrinsics"', 1)
    matrix = as_numbers(path, content["cameraPoseARFrame"], (16,), '"cameraPoseARFrame"', 1)
    time_s = content.get("time")
    return FrameFile(
        path,
        np.nan if time_s is None else float(as_numbers(path, time_s, (), '"time"', 1)),
        matrix.reshape(4, 4),
        (np.nan, np.nan, float(k[0]), float(k[4]), float(k[2]), float(k[5])),
    )


def _polycam_frame(path: Path, content: dict[str, Any]) -> FrameFile:
    keys = [f"t_{row}{column}" for row in range(3) for column in range(4)]
    if missing := [key for key in keys if key not in content]:
        raise FormatError(path, f'expected a camera with "{missing[0]}"')
    rows = as_numbers(path, [content[key] for key in keys], (12,), "t_00 to t_23", 1)
    names = ("width", "height", "fx", "fy", "cx", "cy")
    camera = [content.get(name, np.nan) for name in names]
    width, height, fx, fy, cx, cy = as_numbers(path, camera, (6,), "the camera", 1).tolist()
    # Small numbers are of frames.
    is_time = path.stem.isdecimal() and len(path.stem) >= _LEAST_TIME_DIGITS
    time = content.get("timestamp", float(path.stem) if is_time else np.nan)
    return FrameFile(
        path,
        float(as_numbers(path, time, (), '"timestamp"', 1)),
        np.vstack([rows.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]),
        (width, height, fx, fy, cx, cy),
    )


def build_track(
    path: Path, paths: Sequence[Path], found: FrameFiles, options: ReadOptions
) -> Trajectory:
    """Build vio_from_cam poses of all frames that have one, named by their images.

    Frames are untimed, in the order of their names, where no file says when it was.

    Args:
        path: The capture, for messages.
        paths: All files, in order.
        found: What those that could be read say.
        options: Strictness, rate and notes.

    Raises:
        FormatError: No frame or too few have a pose, or `strict` and one has none.
    """
    rows = Rows.numbered(path, len(paths))
    line_of = {str(file): line for line, file in enumerate(paths, start=1)}
    for problem in found.problems:
        # The summary names the file: entries of a folder have no number that users see.
        text = f"{Path(problem.path).name}: {problem.problem}"
        rows.problems[line_of[problem.path]] = RowProblem(text, text)
    matrices, times = np.full((len(paths), 4, 4), np.nan), np.full(len(paths), np.nan)
    for frame in found.frames:
        row = line_of[str(frame.path)] - 1
        matrices[row], times[row] = frame.matrix, frame.timestamp_s
    poses = conventions.world_from_arcam(rigid_of_file(rows, matrices, options))
    names = [f"{file.stem}.jpg" for file in paths]
    if not np.isfinite(times).any():
        return build_named(rows, names, poses, options, target="vio")
    for line in np.flatnonzero(~np.isfinite(times)) + 1:
        rows.problems.setdefault(int(line), RowProblem("expected a time, got none", "no time"))
    return build_trajectory(rows, times, poses, options, names=names, target="vio")
