"""7-Scenes folders: `frame-XXXXXX.pose.txt`, each a 4x4 matrix, world_from_cam."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from vioapr.errors import FileMissingError, FormatError, ParameterError, UnreadableError
from vioapr.files.tables import format_rows
from vioapr.files.text import is_folder, write_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.folders import read_matrix_files
from vioapr.formats.named import build_named, writable_names
from vioapr.trajectory import Trajectory

_POSE_SUFFIX, _IMAGE_SUFFIX = ".pose.txt", ".color.png"


def _find_poses(path: Path) -> list[Path]:
    """The pose files of a sequence's folder, or of all sequences of a scene's."""
    try:
        found = sorted(path.glob(f"*{_POSE_SUFFIX}"))
        return found or sorted(path.glob(f"*/*{_POSE_SUFFIX}"))
    except OSError as error:
        raise UnreadableError.of(path, error) from None


def sniff(path: Path, head: bytes) -> float:
    """Sure of a folder with such files, or with folders of such files."""
    del head
    try:
        return 1.0 if is_folder(path) and _find_poses(path) else 0.0
    except UnreadableError:
        return 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses of a sequence's or a scene's folder.

    Images are named frame-XXXXXX.color.png, after their folder where the folder is a
    sequence (seq-01).

    Raises:
        FileError: It cannot be read or is malformed, naming the pose file and line.
        ParameterError: The options do not fit the sequences.
    """
    files = _find_poses(path)
    if not files:
        wanted = f"expected a folder of frame-XXXXXX{_POSE_SUFFIX}"
        if not path.exists():
            raise FileMissingError(path, f"{wanted}, found nothing of this name")
        raise FormatError(path, f"{wanted}, found none")
    prefix = f"{path.name}/" if re.fullmatch(r"seq-?\d+", path.name) else ""
    names = [
        prefix + file.relative_to(path).as_posix().removesuffix(_POSE_SUFFIX) + _IMAGE_SUFFIX
        for file in files
    ]
    rows, poses = read_matrix_files(path, files, options)
    return build_named(rows, names, poses, options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write a file for each pose, in folders as the image names have them.

    Names other than FOLDER/NAME.color.png are lost: frames are numbered instead.

    Raises:
        UnwritableError: A file cannot be written.
        ParameterError: Image names that lead out of the folder, or are the same.
    """
    names = writable_names(trajectory, "", _IMAGE_SUFFIX)
    if not all(name.endswith(_IMAGE_SUFFIX) for name in names):
        names = [f"frame-{row:06d}{_IMAGE_SUFFIX}" for row in range(len(names))]
    matrices = trajectory.target_from_source.to_matrix().tolist()
    for name, matrix in zip(names, matrices, strict=True):
        parts = PurePosixPath(name).parts
        if parts[0] == "/" or ".." in parts or "\\" in name or "\0" in name:
            raise ParameterError(f"the image name {name!r} leads out of the folder")
        inside = parts[1:] if parts[0] == path.name and len(parts) > 1 else parts
        target = path.joinpath(*inside)
        stem = target.name.removesuffix(_IMAGE_SUFFIX)
        write_text(target.with_name(stem + _POSE_SUFFIX), format_rows(matrix, " "))


FORMAT = Format(
    name="7scenes",
    title="7-Scenes pose folder",
    convention="4x4 matrix a file, frame-XXXXXX.pose.txt; world_from_cam, OpenCV axes, no times",
    extensions=("/",),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
    name_pattern=r".*\.color\.png",
    parts=(f"*{_POSE_SUFFIX}", f"*/*{_POSE_SUFFIX}"),
)
