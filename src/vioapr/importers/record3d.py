"""Record3D: an `.r3d` zip, or the folder that it was unpacked to: `metadata` and `rgbd/N.jpg`."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.images import IMAGE_SUFFIXES
from vioapr.files.text import natural_key
from vioapr.formats import record3d
from vioapr.importers.base import (
    Image,
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    is_frame_number,
    list_image_names,
    one_walk,
    tracking_of,
)
from vioapr.importers.reading import frames_of_rows, read_noted
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.foreign_json import as_numbers, load_object
from vioapr.schemas.recording import RecordingInfo

_METADATA = ("metadata", "metadata.json")
_IMAGE_FOLDERS = ("rgbd", "rgb")
_DEFAULT_RATE_HZ = 30.0
_MAX_IMAGE_BYTES = 1 << 28


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """An `.r3d` file or an unpacked folder."""
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read the metadata, and find the images that belong to its poses."""
    metadata = source
    if source.is_dir():
        found = [source / name for name in _METADATA if (source / name).exists()]
        if not found:
            raise FormatError(source, f"expected a file {' or '.join(_METADATA)}, found none")
        metadata = found[0]
    rate_hz = options.rate_hz or _DEFAULT_RATE_HZ
    reading = read_noted(record3d.read, metadata, options, rate_hz=rate_hz)
    count = len(reading.trajectory) + len(reading.left_out)
    frames = frames_of_rows(reading, range(1, count + 1))
    content = load_object(metadata, record3d.read_metadata(metadata))
    images = find_images(source)
    suffixes = {row: Path(image).suffix.lower() for row, image in images.items()}
    rows: list[int] = frames.rows.tolist()
    has_clock = "frameTimestamps" in content
    walk = Walk(
        id=options.id or id_of(source.resolve().stem),
        split=options.split_or("train"),
        info=RecordingInfo(
            tracker="ARKit", source="Record3D", clock="device" if has_clock else "frame-rate"
        ),
        source=source,
        timestamp_s=frames.timestamp_s,
        image_names=[f"{row:06d}{suffixes[row]}" if row in suffixes else "" for row in rows],
        images=read_images(source, images, rows),
        vio_from_cam=frames.vio_from_cam,
        tracking=tracking_of(frames.vio_from_cam),
        intrinsics=read_intrinsics(metadata, content, count).at(frames.rows),
        up="first-pose",
    )
    reading.say(walk)
    if not has_clock:
        walk.warn("no timestamps: counted from the frame rate")
    unused = len(images) - sum(1 for name in walk.image_names if name)
    if unused:
        walk.warn(f"images: {unused} belong to no pose")
    return walk


def find_images(source: Path) -> dict[int, str]:
    """Paths of the images, in the folder or in the zip, by the frame's number."""
    if source.is_dir():
        found = [
            str(source / folder / name)
            for folder in _IMAGE_FOLDERS
            for name in list_image_names(source / folder)
        ]
    elif zipfile.is_zipfile(source):
        with zipfile.ZipFile(source) as archive:
            found = [
                name
                for name in archive.namelist()
                if name.rpartition("/")[0] in _IMAGE_FOLDERS
                and name.lower().endswith(IMAGE_SUFFIXES)
            ]
    else:
        found = []
    if not found:
        raise FormatError(source, "expected images rgbd/0.jpg, rgbd/1.jpg and so on, found none")
    found.sort(key=natural_key)
    return {int(Path(name).stem): name for name in found if is_frame_number(Path(name).stem)}


def read_images(source: Path, images: dict[int, str], rows: list[int]) -> Iterator[Image]:
    """The images of some frames in order, as paths or bytes; None where there is none."""
    if source.is_dir():
        yield from (Path(images[row]) if row in images else None for row in rows)
        return
    with zipfile.ZipFile(source) as archive:
        for row in rows:
            try:
                yield read_member(archive, images[row]) if row in images else None
            except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError):
                yield b""  # damaged or encrypted: reported as an empty image


def read_member(archive: zipfile.ZipFile, name: str) -> bytes:
    """An image in a zip; b"" if it unpacks to more than any image has."""
    with archive.open(name) as member:
        content = member.read(_MAX_IMAGE_BYTES + 1)
    return content if len(content) <= _MAX_IMAGE_BYTES else b""


def read_intrinsics(path: Path, content: dict[str, Any], count: int) -> Intrinsics:
    """Of every frame, else of all, else not known.

    Raises:
        FormatError: They are no numbers.
    """
    width, height = (
        float(as_numbers(path, content[key], (), f'"{key}"', 1)) if key in content else np.nan
        for key in ("w", "h")
    )
    per_frame = content.get("perFrameIntrinsicCoeffs")
    sizes = np.full(count, width), np.full(count, height)
    if isinstance(per_frame, list) and len(per_frame) == count:
        rows = [as_numbers(path, row, (4,), "intrinsics", n) for n, row in enumerate(per_frame, 1)]
        return Intrinsics(*sizes, *np.array(rows).T)
    if "K" not in content:
        return Intrinsics(*sizes, *np.full((4, count), np.nan))
    k = as_numbers(path, content["K"], (9,), '"K"', 1).reshape(3, 3)
    # Written column by column, but some tools that rewrite the file do so row by row.
    k = k.T if k[0, 2] == 0 and k[1, 2] == 0 else k
    pinhole = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
    return Intrinsics(*sizes, *np.repeat(pinhole[:, None], count, axis=1))


IMPORTER = Importer(
    name="record3d",
    title="Record3D (iPhone)",
    layout="an .r3d file, or a folder with metadata and rgbd/",
    read=read,
    uses=frozenset({"rate_hz"}),
)
