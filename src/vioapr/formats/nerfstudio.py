"""nerfstudio and instant-ngp `transforms.json`: 4x4 matrices, OpenGL camera axes.

Some apps add the time of every frame, as `timestamp`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions, TimeUnit
from vioapr.formats.named import build_named, writable_names
from vioapr.formats.poses import build_trajectory, rigid_of_file
from vioapr.formats.times import PER_SECOND, UNIT_NAMES, find_time_unit, require_plausible_rate
from vioapr.schemas.foreign_json import as_numbers, get_list, load_object
from vioapr.trajectory import Trajectory

_TIME_KEYS: dict[str, TimeUnit | None] = {
    "timestamp": None, "timestamp_s": "s", "timestamp_ms": "ms", "timestamp_us": "us",
    "timestamp_ns": "ns", "time_s": "s", "time": None,
}  # fmt: skip


def sniff(path: Path, head: bytes) -> float:
    """Sure of a JSON object that speaks of transform matrices."""
    del path
    return 0.95 if head.lstrip()[:1] == b"{" and b'"transform_matrix"' in head else 0.0


def read_frame_times(
    path: Path, frames: Sequence[Mapping[str, object]], unit: TimeUnit | None = None
) -> tuple[NDArray[np.float64], TimeUnit] | None:
    """Read when each frame was taken, in whatever unit the file has.

    `time` from 0 to 1 is an animation's, as of dynamic scenes, and no clock.

    Args:
        path: The file, for messages.
        frames: Their members.
        unit: Of `timestamp` and `time`; found from the values by default.

    Returns:
        Times, s, shape (n,), NaN where a frame does not say, and their unit; None if fewer than
        9 of 10 frames say.

    Raises:
        FormatError: In the unit that is said, the times are none of frames.
    """
    for key, fixed in _TIME_KEYS.items():
        values = np.array([_number(frame.get(key)) for frame in frames])
        known = np.sort(values[np.isfinite(values)])
        if len(known) < 0.9 * len(values) or (key == "time" and known[-1] <= 1):
            continue
        # What a user says counts before what a name says, as with other formats.
        said = unit or fixed
        if said is not None:
            require_plausible_rate(path, known, said)
        found = said or find_time_unit(known).unit
        return values / PER_SECOND[found], found
    return None


def _number(value: object) -> float:
    """A number, or a text that is one; else NaN."""
    if not isinstance(value, int | float | str) or isinstance(value, bool):
        return np.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return np.nan


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses, by time or, without times, in the order of the images' paths.

    The world is the file's, which nerfstudio turns and scales: see its `applied_transform`.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the frame's number in it.
        ParameterError: The options do not fit the file's sequences.
    """
    frames = get_list(path, load_object(path, read_text(path)), "frames")
    names: list[str] = []
    members: list[Mapping[str, object]] = []
    matrices: list[NDArray[np.float64]] = []
    for entry, value in enumerate(frames, start=1):
        frame = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        name = frame.get("file_path")
        if not isinstance(name, str):
            raise FormatError(path, 'expected a frame with a text "file_path"', entry)
        names.append(name)
        members.append(frame)
        matrix = frame.get("transform_matrix")
        matrices.append(as_numbers(path, matrix, (4, 4), '"transform_matrix"', entry))
    rows = Rows.numbered(path, len(names))
    poses = conventions.world_from_arcam(rigid_of_file(rows, np.array(matrices), options))
    timed = read_frame_times(path, members, options.time_unit) if options.rate_hz is None else None
    if timed is None or options.sequence is not None:
        return build_named(rows, names, poses, options)
    times, unit = timed
    if unit != "s":
        options.note(path, f"times are {UNIT_NAMES[unit]}", is_warning=False)
    order = np.argsort(times, kind="stable").tolist()
    names = [names[row] for row in order]
    return build_trajectory(rows.at(order), times[order], poses.at(order), options, names=names)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits, and times where there are any; intrinsics are left out.

    Raises:
        UnwritableError: The file cannot be written.
        ParameterError: Two images have one name.
    """
    names = writable_names(trajectory, "")
    matrices = conventions.world_from_arcam(trajectory.target_from_source).to_matrix().tolist()
    frames: list[dict[str, object]] = [
        {"file_path": name, "transform_matrix": matrix}
        for name, matrix in zip(names, matrices, strict=True)
    ]
    if trajectory.is_timed:
        for frame, time_s in zip(frames, trajectory.timestamp_s.tolist(), strict=True):
            frame["timestamp"] = time_s
    write_text(path, json.dumps({"frames": frames}, indent=1) + "\n")


FORMAT = Format(
    name="nerfstudio",
    title="nerfstudio or instant-ngp transforms.json",
    convention=(
        "4x4 transform_matrix by file_path, timestamp if any; world_from_cam, OpenGL camera axes"
    ),
    extensions=(".json",),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    default_for=(".json",),
)
