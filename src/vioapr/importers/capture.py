"""A capture of a phone's browser, as the server received it: `capture.json`, logs and images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vioapr.errors import FormatError
from vioapr.files.append_table import Problem
from vioapr.files.text import read_text, require_folder
from vioapr.importers.base import ImportedScene, Importer, ImportOptions, Walk, id_of, one_walk
from vioapr.importers.capture_logs import (
    read_captured_frames,
    read_captured_gnss,
    read_captured_heading,
    read_captured_imu,
)
from vioapr.plurals import count_of
from vioapr.scene.frames import Tracking
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.schemas.base import decode
from vioapr.schemas.capture import CaptureDocument
from vioapr.schemas.recording import RecordingInfo

CAPTURE_FILE = "capture.json"


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A capture's folder.

    Raises:
        FormatError: It is none.
    """
    require_folder(source, f"a capture's folder with {CAPTURE_FILE}")
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read a capture's logs, and find its images.

    Raises:
        FileError: Something cannot be read, or no frame can be used.
    """
    path = source / CAPTURE_FILE
    said = decode(path, read_text(path), CaptureDocument)
    problems: list[Problem] = []
    frames = read_captured_frames(source, problems)
    if not len(frames.timestamp_s):
        why = f": {problems[0]}" if problems else ""
        raise FormatError(source, f"expected frames in its logs, found none that can be used{why}")
    if (frames.tracking == Tracking.LOST).all():
        raise FormatError(source, "tracking was lost throughout: no frame has a pose")
    names, twice = first_uses(frames.image)
    walk = Walk(
        id=options.id or id_of(source.resolve().name),
        split=options.split_or("train"),
        info=RecordingInfo(device=said.device, tracker=said.tracker),
        source=source,
        timestamp_s=frames.timestamp_s,
        image_names=names,
        images=[source / IMAGES_FOLDER / name if name else None for name in names],
        vio_from_cam=frames.vio_from_cam,
        tracking=frames.tracking,
        intrinsics=frames.intrinsics,
        up="definition",
        imu=read_captured_imu(source, problems, is_reversed=said.is_acceleration_reversed),
        gnss=read_captured_gnss(source, problems),
        heading=read_captured_heading(source, problems),
    )
    if twice:
        walk.warn(f"images: {count_of(twice, 'frame names', 'frames name')} another frame's image")
    worlds = 1 + int((frames.tracking[1:] == Tracking.RESET).sum())
    if worlds > 1:
        walk.note(f"tracking: {worlds} worlds, as the tracker began again")
    if walk.heading is not None and len(walk.heading):
        walk.note("heading: from the browser's north, which is magnetic on most phones")
    _say_problems(walk, problems)
    drop_empty_tables(walk)
    return walk


def first_uses(names: Sequence[str]) -> tuple[list[str], int]:
    """Image names, without those that an earlier frame has; and how many these are."""
    seen: set[str] = set()
    kept: list[str] = []
    for name in names:
        kept.append("" if name in seen else name)
        seen.add(name)
    seen.discard("")
    return kept, sum(1 for name, one in zip(names, kept, strict=True) if name and not one)


def drop_empty_tables(walk: Walk) -> None:
    """A table without rows is none."""
    walk.imu = walk.imu if walk.imu is not None and len(walk.imu) else None
    walk.gnss = walk.gnss if walk.gnss is not None and len(walk.gnss) else None
    walk.heading = walk.heading if walk.heading is not None and len(walk.heading) else None


def _say_problems(walk: Walk, problems: Sequence[Problem]) -> None:
    """Say how many rows are left out, and why the first of them is."""
    torn = [problem for problem in problems if not problem.is_error]
    wrong = [problem for problem in problems if problem.is_error]
    if torn:
        ends = count_of(len(torn), "log ends", "logs end")
        walk.note(f"{ends} in half a row, as the phone stopped while it wrote")
    if wrong:
        first = str(wrong[0]).removeprefix(f"{walk.source}/")
        walk.warn(f"{count_of(len(wrong), 'row')} of the logs left out, the first: {first}")


IMPORTER = Importer(
    "capture",
    "a capture",
    f"a capture's folder with {CAPTURE_FILE}, logs as frames-00000.csv, and {IMAGES_FOLDER}/",
    read,
)
