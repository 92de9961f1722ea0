"""Where ground truth comes from: a note beside each file says who wrote it.

`gt/<id>.origin.json` holds the digest of the file that was written. Without it, or if the file was
changed since, ground truth counts as the user's.
"""

from __future__ import annotations

from pathlib import Path

from vioapr._version import __version__
from vioapr.errors import FileError
from vioapr.files.atomic import replacing, write_atomically
from vioapr.files.digests import digest_of
from vioapr.formats import tum
from vioapr.schemas.base import decode, encode
from vioapr.schemas.written import GroundTruthOrigin, Writer
from vioapr.trajectory import Trajectory

ORIGIN_SUFFIX = ".origin.json"


def origin_path(gt_path: Path) -> Path:
    """Where the note of a ground truth's file is or will be."""
    return gt_path.with_suffix(ORIGIN_SUFFIX)


def read_origin(gt_path: Path) -> GroundTruthOrigin | None:
    """Who wrote a ground truth; None if it is the user's, or there is none."""
    path = origin_path(gt_path)
    try:
        origin = decode(path, path.read_text(encoding="utf-8"), GroundTruthOrigin)
        return origin if digest_of(gt_path) in origin.sha256 else None
    except (OSError, ValueError, FileError):
        return None


def write_gt_file(
    gt_path: Path, world_from_cam: Trajectory, writer: Writer | None, source: str
) -> None:
    """Write ground truth and the note of its origin; what was there is replaced as a whole.

    Args:
        gt_path: The file.
        world_from_cam: Of the frames.
        writer: Who writes it; None for the user, who needs no note.
        source: What it is made from.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    with replacing(gt_path) as partial:
        tum.write(partial, world_from_cam)
        if writer is None:
            origin_path(gt_path).unlink(missing_ok=True)
        else:
            # First, and for the file before too: killed in between, either is still known.
            earlier = read_origin(gt_path)
            before = earlier.sha256[-1:] if earlier and earlier.writer == writer else ()
            digests = tuple(dict.fromkeys((*before, digest_of(partial))))
            origin = GroundTruthOrigin(
                writer=writer, source=source, vioapr=__version__, sha256=digests
            )
            write_atomically(origin_path(gt_path), encode(origin).encode())


def remove_gt_file(gt_path: Path) -> None:
    """Remove ground truth and the note of its origin."""
    gt_path.unlink(missing_ok=True)
    origin_path(gt_path).unlink(missing_ok=True)
