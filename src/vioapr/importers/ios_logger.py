"""ios_logger: `ARposes.txt`, `Frames.txt` with `Frames.m4v`, `Accel.txt`, `Gyro.txt`, `GPS.txt`.

The tracker gives 60 poses a second and the video fewer frames, on one clock: seconds since 1970.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import parse_rows
from vioapr.files.text import read_text, require_folder
from vioapr.formats import ios_logger
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import (
    Image,
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    list_image_names,
    one_walk,
    tracking_of,
)
from vioapr.importers.reading import read_noted
from vioapr.importers.stray import imu_of_device
from vioapr.importers.video import count_video_frames, read_video
from vioapr.plurals import count_of
from vioapr.scene.frames import Intrinsics
from vioapr.scene.sensors import Gnss, Imu
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import nearest_rows

_POSES, _FRAMES, _VIDEO = "ARposes.txt", "Frames.txt", "Frames.m4v"
_ACCEL, _GYRO, _GPS = "Accel.txt", "Gyro.txt", "GPS.txt"
_IMAGE_FOLDERS = ("images", "rgb", "color", "Frames")
_MOST_OFF_S = 0.01
"""A pose that is farther from a frame is another's; ARKit gives one every 0.017 s."""


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A recording's folder.

    Raises:
        FormatError: It is none.
    """
    require_folder(source, f"an ios_logger folder with {_POSES} and {_FRAMES}")
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read poses, frames and sensors, and give each frame the pose of its time.

    Raises:
        FileError: A file is missing or malformed.
    """
    reading = read_noted(ios_logger.read, source / _POSES, options)
    times, intrinsics = read_frames(source / _FRAMES)
    track = reading.trajectory
    nearest = nearest_rows(times, track.timestamp_s)
    is_near = np.abs(track.timestamp_s[nearest] - times) <= _MOST_OFF_S
    poses = Rigid3.unknown((len(times),))
    poses.translation_m[is_near] = track.position_m[nearest[is_near]]
    poses.quat_xyzw[is_near] = track.quat_xyzw[nearest[is_near]]
    names, images, problem = find_images(source, len(times))
    walk = Walk(
        id=options.id or id_of(source.resolve().name),
        split=options.split_or("train"),
        info=RecordingInfo(tracker="ARKit", source="ios_logger"),
        source=source,
        timestamp_s=times,
        image_names=names,
        images=images,
        vio_from_cam=poses,
        tracking=tracking_of(poses),
        intrinsics=intrinsics,
        up="definition",
    )
    reading.say(walk)
    if problem:
        walk.warn(problem)
    walk.imu = read_imu(walk, source)
    if (source / _GPS).exists():
        walk.gnss = read_gnss(walk, source / _GPS)
    return walk


def read_frames(path: Path) -> tuple[NDArray[np.float64], Intrinsics]:
    """Times of the video's frames, and their intrinsics, which older files lack.

    Raises:
        FileError: It cannot be read, or times do not increase.
    """
    what = "time,number,fx,fy,cx,cy"
    rows = parse_rows(path, read_text(path), range(2, 7), what=what, delimiter=",")
    times = rows.numbers([0])[:, 0]
    is_late = np.diff(times) <= 0
    if is_late.any() or not np.isfinite(times).all():
        row = int(np.argmax(is_late)) + 1
        raise FormatError(path, "expected increasing times", rows.lines[row])
    unknown = np.full((len(rows), 6), np.nan)
    if all(len(fields) >= 6 for fields in rows.fields):
        unknown[:, 2:] = rows.numbers(slice(2, 6))
    return times, Intrinsics(*unknown.T)


def find_images(source: Path, count: int) -> tuple[list[str], Iterator[Image], str | None]:
    """Names and images of the frames, from the video or a folder, and what does not fit.

    Raises:
        FormatError: There are none.
    """
    for folder in _IMAGE_FOLDERS:
        if found := list_image_names(source / folder):
            problem = None
            if len(found) != count:
                problem = (
                    f"images: {folder}/ has {len(found)} and {_FRAMES} {count_of(count, 'row')}: "
                    "they are paired in order"
                )
            kept = found[:count] + [""] * (count - len(found))
            return kept, (source / folder / name if name else None for name in kept), problem
    video = source / _VIDEO
    if not video.exists():
        raise FormatError(source, f"expected {_VIDEO}, or a folder images/, found none")
    frames = count_video_frames(video)
    problem = None
    if frames is not None and frames != count:
        problem = (
            f"images: the video has {count_of(frames, 'frame')} and {_FRAMES} "
            f"{count_of(count, 'row')}: they are paired in order"
        )
    known = count if frames is None else frames
    names = [f"{row:06d}.jpg" if row < known else "" for row in range(count)]
    # A video that ends early leaves the last frames without image.
    decoded = itertools.chain(read_video(video), itertools.repeat(None))
    return names, itertools.islice(decoded, count), problem


def read_imu(walk: Walk, source: Path) -> Imu | None:
    """Both sensors in one table, each with times of its own; None if there is neither."""
    parts = [
        (number, read_sensor(walk, source / name))
        for number, name in enumerate((_ACCEL, _GYRO))
        if (source / name).exists()
    ]
    if not parts:
        return None
    times = np.concatenate([values[:, 0] for _, values in parts])
    readings = np.full((2, len(times), 3), np.nan)
    start = 0
    for number, values in parts:
        readings[number, start : start + len(values)] = values[:, 1:4]
        start += len(values)
    order = np.argsort(times, kind="stable")
    accel, gyro = readings[:, order]
    if not np.isfinite(accel).any():
        walk.note(f"accelerometer: no {_ACCEL}")
        return None
    return imu_of_device(walk, times[order], accel, gyro)


def read_sensor(walk: Walk, path: Path) -> NDArray[np.float64]:
    """Rows of time, x, y, z; those without a time are left out."""
    rows = parse_rows(path, read_text(path), range(4, 6), what="time,x,y,z", delimiter=",")
    values = rows.numbers(slice(0, 4))
    if (np.diff(values[:, 0]) < 0).any():
        walk.warn(f"{path.name}: rows are not in order of time, and were sorted")
    return values[np.isfinite(values[:, 0])]


def read_gnss(walk: Walk, path: Path) -> Gnss | None:
    """Satellite positions; accuracies below 0 mean none, as Core Location has it."""
    text = read_text(path)
    if not text.strip():
        return None
    what = "time,latitude,longitude,accuracy,altitude,accuracy"
    rows = parse_rows(path, text, range(3, 12), what=what, delimiter=",")
    width = min(len(fields) for fields in rows.fields)
    values = np.full((len(rows), 6), np.nan)
    values[:, : min(width, 6)] = rows.numbers(slice(0, min(width, 6)))
    values = values[np.argsort(values[:, 0], kind="stable")]
    times, latitude, longitude, horizontal_m, altitude_m, vertical_m = values.T
    known = np.isfinite(values[:, :3]).all(axis=1) & ~(horizontal_m < 0)
    if not known.all():
        walk.warn(
            f"{path.name}: {count_of(int((~known).sum()), 'row has', 'rows have')} no position: "
            "left out"
        )
    vertical_m = np.where(vertical_m > 0, vertical_m, np.nan)
    altitude_m = np.where(np.isfinite(vertical_m), altitude_m, np.nan)
    columns = (times, latitude, longitude, altitude_m, horizontal_m, vertical_m)
    return Gnss(*(column[known] for column in columns))


IMPORTER = Importer(
    name="ios-logger",
    title="ios_logger (iPhone, iPad)",
    layout="a folder with ARposes.txt, Frames.txt and Frames.m4v or images/",
    read=read,
)
