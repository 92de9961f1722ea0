"""nerfstudio, instant-ngp or Polycam: `transforms.json` with images and intrinsics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vioapr.files.images import IMAGE_SUFFIXES
from vioapr.files.text import read_text
from vioapr.formats import nerfstudio
from vioapr.formats.base import ReadOptions
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    flat_names,
    id_of,
    one_walk,
    tracking_of,
)
from vioapr.importers.diagnostics import turn_y_up
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.foreign_json import as_numbers, get_list, load_object
from vioapr.schemas.recording import RecordingInfo

_FILE = "transforms.json"
_DEFAULT_RATE_HZ = 1.0
_KEYS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A transforms.json or the folder that holds it."""
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read the poses, cameras and paths of images."""
    path = source / _FILE if source.is_dir() else source
    poses = nerfstudio.read(path, ReadOptions())
    content = load_object(path, read_text(path))
    assert poses.names is not None  # every frame has a file_path
    entries = {frame["file_path"]: frame for frame in get_list(path, content, "frames")}
    images = [find_image(path.parent, name) for name in poses.names]
    rate_hz = options.rate_hz or _DEFAULT_RATE_HZ
    world, vio_from_cam = turn_y_up(poses)
    walk = Walk(
        id=options.id or id_of(path.resolve().parent.name),
        split=options.split_or("train"),
        info=RecordingInfo(
            tracker="transforms.json",
            source="nerfstudio transforms.json",
            clock="frame-rate",
            is_metric=not any("colmap_im_id" in entry for entry in entries.values()),
        ),
        source=path,
        timestamp_s=np.arange(len(poses)) / rate_hz,
        image_names=flat_names([image.as_posix() for image in images]),
        images=images,
        vio_from_cam=vio_from_cam,
        tracking=tracking_of(vio_from_cam),
        intrinsics=read_cameras(path, content, [entries[name] for name in poses.names]),
    )
    walk.note(f"world: {world}")
    walk.warn(f"no timestamps: counted at {rate_hz:g} frames per second in the order of the names")
    if not walk.info.is_metric:
        walk.warn("scale: the poses are COLMAP's, not metric: marked so")
    if any(content.get(key) for key in _DISTORTION):
        walk.warn("intrinsics: lens distortion is left out, recordings hold pinhole cameras")
    return walk


def find_image(folder: Path, name: str) -> Path:
    """An image by its path in the file, which some tools write without the ending."""
    path = folder / name
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return path
    for suffix in IMAGE_SUFFIXES:
        if (found := path.with_name(path.name + suffix)).exists():
            return found
    return path.with_name(path.name + ".png")  # as instant-ngp takes it


def read_cameras(path: Path, content: dict[str, Any], frames: list[dict[str, Any]]) -> Intrinsics:
    """Of every frame, else of the file, else not known."""
    rows = []
    for entry, frame in enumerate(frames, start=1):
        given = {key: frame.get(key, content.get(key)) for key in _KEYS}
        known = {key: value for key, value in given.items() if value is not None}
        numbers = as_numbers(path, list(known.values()), (len(known),), "intrinsics", entry)
        camera = dict(zip(known, numbers.tolist(), strict=True))
        if "fl_x" not in camera and {"w", "camera_angle_x"} <= camera.keys():
            camera["fl_x"] = camera["w"] / (2 * np.tan(camera["camera_angle_x"] / 2))
        camera.setdefault("fl_y", camera.get("fl_x", np.nan))
        rows.append([camera.get(key, np.nan) for key in _KEYS[:6]])
    table = np.array(rows)
    # A camera that is known in part cannot be used.
    table[np.isnan(table[:, 2:]).any(axis=1), 2:] = np.nan
    table[np.isnan(table[:, :2]).any(axis=1), :2] = np.nan
    return Intrinsics(*table.T)


IMPORTER = Importer(
    name="nerfstudio",
    title="nerfstudio, instant-ngp or Polycam transforms.json",
    layout="transforms.json, or the folder that holds it, with its images",
    read=read,
    uses=frozenset({"rate_hz"}),
)
