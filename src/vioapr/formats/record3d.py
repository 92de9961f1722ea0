"""Record3D `metadata` (JSON) or the .r3d zip that holds it: `qx qy qz qw x y z` a frame.

World_from_cam with OpenGL camera axes, in a world that is the first pose's: its y axis is up
only if the phone was held level when the recording began.
"""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any, cast

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.tables import Rows
from vioapr.files.text import has_suffix, plain_name, read_bytes, read_text, write_bytes
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, index_times, pose_columns, poses_of
from vioapr.schemas.foreign_json import as_numbers, get_list, load_object
from vioapr.trajectory import Trajectory

_MEMBER = "metadata"
_MAX_MEMBER_BYTES = 1 << 30


def sniff(path: Path, head: bytes) -> float:
    """Sure of a zip named .r3d; likely of a JSON object that has poses and a frame rate."""
    if head.startswith(b"PK\x03\x04"):
        return 1.0 if has_suffix(path, ".r3d") else 0.3
    if head.lstrip()[:1] != b"{" or b'"transform_matrix"' in head:
        return 0.0
    if plain_name(path) == _MEMBER:
        return 0.9
    # The poses come after a long list of intrinsics, maybe beyond the first bytes.
    has_poses = b'"poses"' in head or b'"perFrameIntrinsicCoeffs"' in head
    return 0.7 if has_poses else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read vio_from_cam poses, timed by `frameTimestamps`, else `fps`, else a given rate.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the frame's number in it.
    """
    metadata = load_object(path, read_metadata(path))
    entries = get_list(path, metadata, "poses")
    values = np.array(
        [as_numbers(path, pose, (7,), "a pose", n) for n, pose in enumerate(entries, start=1)]
    )
    rows = Rows.numbered(path, len(entries))
    poses = conventions.world_from_arcam(poses_of(rows, values[:, 4:7], values[:, :4]))
    stamps: object = metadata.get("frameTimestamps")
    times = None
    if isinstance(stamps, list) and len(cast("list[object]", stamps)) == len(rows):
        times = as_numbers(path, cast("object", stamps), (len(rows),), '"frameTimestamps"', 1)
    elif "fps" in metadata:
        fps = float(as_numbers(path, metadata["fps"], (), '"fps"', 1))
        if not 1e-6 < fps < 1e6:
            raise FormatError(path, f'expected "fps" above 0, got {fps:.6g}')
        times = np.arange(len(rows)) / fps
    is_timed = times is not None or options.rate_hz is not None
    times = index_times(len(rows), options) if times is None else times
    return build_trajectory(rows, times, poses, options, is_timed=is_timed, target="vio")


def read_metadata(path: Path) -> str:
    """Read the JSON text of a metadata file, or of that in an .r3d zip.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is a broken zip, or one without metadata.
    """
    if not read_bytes(path, 4).startswith(b"PK\x03\x04"):
        return read_text(path)
    try:
        # A zip of thousands of images is not read whole, unless it is gzipped as well.
        is_plain = zipfile.is_zipfile(path)
        archive = zipfile.ZipFile(path if is_plain else io.BytesIO(read_bytes(path)))
        with archive, archive.open(_MEMBER) as member:
            return member.read(_MAX_MEMBER_BYTES).decode()
    except KeyError:
        raise FormatError(path, f"expected a file {_MEMBER!r} in the zip, found none") from None
    except Exception as error:  # zip raises a dozen kinds for broken content
        raise FormatError(path, f"broken zip content: {error}") from None


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits, as JSON or, under a name ending in .r3d, zipped.

    Raises:
        UnwritableError: The file cannot be written.
    """
    columns = pose_columns(conventions.world_from_arcam(trajectory.target_from_source))
    metadata: dict[str, Any] = {"poses": [row[3:] + row[:3] for row in columns]}
    if trajectory.is_timed:
        metadata["frameTimestamps"] = trajectory.timestamp_s.tolist()
    content = json.dumps(metadata).encode()
    if has_suffix(path, ".r3d"):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            # A fixed date: the same trajectory gives the same bytes.
            archive.writestr(zipfile.ZipInfo(_MEMBER), content, zipfile.ZIP_DEFLATED)
        content = buffer.getvalue()
    write_bytes(path, content)


FORMAT = Format(
    name="record3d",
    title="Record3D metadata or .r3d",
    convention=(
        "JSON poses of qx qy qz qw x y z; world_from_cam, OpenGL camera axes, "
        "relative to the first pose, metres"
    ),
    extensions=("metadata", ".r3d", ".json"),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    default_for=("metadata", ".r3d"),
)
