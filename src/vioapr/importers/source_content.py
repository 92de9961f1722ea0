"""What a source holds, in short: so that an import, run again, sees whether it has changed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from vioapr.importers.base import Image, Walk

_DECIMALS = 6
"""Of numbers that count: another computer's last digits are no change."""

_MEDIA = frozenset({".jpg", ".jpeg", ".png", ".mp4", ".mov", ".m4v", ".avi", ".mkv", ".zip"})


def digest_walk(walk: Walk) -> str:
    """The SHA-256 of what was read of a walk, in hexadecimal; no image is read.

    Poses, times and sensors count as numbers, so that it does not matter how they are written.
    Images count by their names, sizes and times of change, and so does the video or the archive
    that they come out of.
    """
    digest = hashlib.sha256()
    digest.update("\n".join(map(str, walk.image_names)).encode())
    for values in _numbers_of(walk):
        # Zeros of either sign are one number, and so are all NaN.
        rounded = np.round(np.asarray(values, dtype=np.float64), _DECIMALS) + 0.0
        digest.update(np.where(np.isnan(rounded), np.nan, rounded).tobytes())
    if isinstance(walk.images, list | tuple):
        digest.update("\n".join(map(_describe_image, walk.images)).encode())
    else:
        digest.update("\n".join(map(_describe_file, _files_of(walk.source))).encode())
    return digest.hexdigest()


def digest_files(paths: Iterable[Path]) -> str:
    """The SHA-256 of what an archive's files look like: name, size and time of change."""
    return hashlib.sha256("\n".join(map(_describe_file, paths)).encode()).hexdigest()


def _numbers_of(walk: Walk) -> Iterator[object]:
    yield from (walk.timestamp_s, walk.tracking, *walk.vio_from_cam, *walk.intrinsics)
    if walk.gt is not None:
        yield from (walk.gt.timestamp_s, *walk.gt.target_from_source)
    for table in (walk.imu, walk.gnss, walk.heading):
        if table is not None:
            yield from vars(table).values()


def _files_of(source: Path) -> Iterable[Path]:
    if not source.is_dir():
        return [source]
    return sorted(path for path in source.rglob("*") if path.suffix.lower() in _MEDIA)


def _describe_image(image: Image) -> str:
    if isinstance(image, Path | str):
        return _describe_file(image)
    return hashlib.sha256(image).hexdigest() if isinstance(image, bytes) else ""


def _describe_file(path: Path | str) -> str:
    try:
        found = os.stat(path)  # noqa: PTH116 (of very many, text is faster than paths)
    except OSError:
        return f"{path}: missing"
    return f"{path}: {found.st_size} {found.st_mtime_ns}"
