"""Stray Scanner: `odometry.csv`, `camera_matrix.csv`, `imu.csv` and `rgb.mp4` of an iPhone.

Instead of the video, a folder `rgb/` or `images/` of its frames is read too: by their numbers,
which are those of the column `frame`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows, parse_rows, read_headed_csv
from vioapr.files.text import read_text, require_folder
from vioapr.formats import stray
from vioapr.formats.headed import POSE_COLUMNS
from vioapr.geometry.vectors import STANDARD_GRAVITY_M_S2
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
from vioapr.importers.video import count_video_frames, read_video
from vioapr.plurals import count_of
from vioapr.scene.frames import Intrinsics
from vioapr.scene.sensors import Imu
from vioapr.schemas.recording import RecordingInfo

_ODOMETRY, _MATRIX, _IMU, _VIDEO = "odometry.csv", "camera_matrix.csv", "imu.csv", "rgb.mp4"
_IMU_COLUMNS = ("timestamp", "a_x", "a_y", "a_z", "alpha_x", "alpha_y", "alpha_z")
# iOS measures in the device's axes: held upright before one's face, x to the right, y up, z
# towards the person. The camera lies on its side in it.
_CAM_FROM_DEVICE = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_IMAGE_FOLDERS = ("rgb", "images", "color")


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A recording's folder.

    Raises:
        FormatError: It is none.
    """
    require_folder(source, f"a Stray Scanner folder with {_ODOMETRY}")
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read the odometry, cameras, images and sensors of a recording."""
    odometry = source / _ODOMETRY
    reading = read_noted(stray.read, odometry, options)
    lines, numbers, intrinsics = read_cameras(source)
    frames = frames_of_rows(reading, lines)
    numbers, intrinsics = numbers[frames.rows], intrinsics.at(frames.rows)
    names, images, problem = find_images(source, numbers)
    walk = Walk(
        id=options.id or id_of(source.resolve().name),
        split=options.split_or("train"),
        info=RecordingInfo(tracker="ARKit", source="Stray Scanner"),
        source=source,
        timestamp_s=frames.timestamp_s,
        image_names=names,
        images=images,
        vio_from_cam=frames.vio_from_cam,
        tracking=tracking_of(frames.vio_from_cam),
        intrinsics=intrinsics,
        up="definition",
    )
    reading.say(walk)
    if problem:
        walk.warn(problem)
    if (source / _IMU).exists():
        rows = read_headed_csv(source / _IMU, _IMU_COLUMNS)
        values = rows.numbers(slice(0, 7))
        if (np.diff(values[:, 0]) < 0).any():
            walk.warn("imu.csv: rows are not in order of time, and were sorted")
        values = values[np.argsort(values[:, 0], kind="stable")]
        walk.imu = imu_of_device(walk, values[:, 0], values[:, 1:4], values[:, 4:7])
    return walk


def read_cameras(source: Path) -> tuple[list[int], NDArray[np.int64], Intrinsics]:
    """Lines, frame numbers and intrinsics: of every frame, or, in older files, of the last."""
    odometry = source / _ODOMETRY
    try:
        rows = read_headed_csv(odometry, ("frame", "fx", "fy", "cx", "cy", *POSE_COLUMNS))
        values = rows.numbers(slice(0, 5))
        unknown = np.full((2, len(rows)), np.nan)
        return rows.lines, _frame_numbers(rows), Intrinsics(*unknown, *values[:, 1:].T)
    except FormatError:
        table = read_headed_csv(odometry, ("frame",))
    numbers, matrix = _frame_numbers(table), source / _MATRIX
    if not matrix.exists():
        return table.lines, numbers, Intrinsics(*np.full((6, len(table)), np.nan))
    rows = parse_rows(matrix, read_text(matrix), range(3, 4), what="a 3x3 matrix", delimiter=",")
    k = rows.numbers(slice(0, 3))
    if k.shape != (3, 3):
        raise FormatError(matrix, f"expected a 3x3 matrix, got {count_of(len(rows), 'row')}")
    camera = np.array([np.nan, np.nan, k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
    return table.lines, numbers, Intrinsics(*np.repeat(camera[:, None], len(table), axis=1))


def _frame_numbers(rows: Rows) -> NDArray[np.int64]:
    """The first column, whole numbers."""
    for field, line in zip(rows.column(0), rows.lines, strict=True):
        if not field.isdecimal() or len(field) > 15:
            raise FormatError(rows.path, f"expected a frame number, got {field[:40]!r}", line)
    return np.array([int(field) for field in rows.column(0)])


def find_images(
    source: Path, numbers: NDArray[np.int64]
) -> tuple[list[str], Iterator[Image], str | None]:
    """Names and images of the frames, and what does not fit about them."""
    for folder in _IMAGE_FOLDERS:
        if found := list_image_names(source / folder):
            stems = {name.rsplit(".", 1)[0]: name for name in found}
            by_number = {int(stem): name for stem, name in stems.items() if is_frame_number(stem)}
            names = [by_number.get(int(number), "") for number in numbers]
            unused = len(found) - sum(1 for name in names if name)
            problem = f"images: {unused} in {folder}/ belong to no frame" if unused else None
            images = (source / folder / name if name else None for name in names)
            return names, images, problem
    video = source / _VIDEO
    if not video.exists():
        raise FormatError(source, f"expected {_VIDEO}, or a folder rgb/ of its frames, found none")
    count = count_video_frames(video)
    problem = None
    if count is not None and count != len(numbers):
        problem = (
            f"images: the video has {count_of(count, 'frame')} and the odometry {len(numbers)}: "
            "they are paired in order"
        )
    names = [f"{number:06d}.jpg" for number in numbers.tolist()]
    if count is not None:
        names = [name if row < count else "" for row, name in enumerate(names)]
    # A video that ends early leaves the last frames without image.
    decoded = itertools.chain(read_video(video), itertools.repeat(None))
    return names, itertools.islice(decoded, len(numbers)), problem


def imu_of_device(
    walk: Walk,
    timestamp_s: NDArray[np.float64],
    accel: NDArray[np.float64],
    gyro_rad_s: NDArray[np.float64],
) -> Imu:
    """Measurements of an iPhone in the axes and units of recordings; says what the units were.

    Args:
        walk: Where findings go.
        timestamp_s: Shape (n,), s.
        accel: Device axes, shape (n, 3). By Core Motion in g, of the reaction's opposite sign: at
            rest it points down. Some apps write m/s^2; the length tells.
        gyro_rad_s: Device axes, shape (n, 3), rad/s.
    """
    lengths = np.linalg.norm(accel, axis=1)
    length = float(np.median(lengths[np.isfinite(lengths)])) if np.isfinite(lengths).any() else 0.0
    if 0.7 < length < 1.5:
        unit, scale = "g", STANDARD_GRAVITY_M_S2
    elif 7 < length < 15:
        unit, scale = "m/s^2", 1.0
    else:
        walk.warn(
            f"accelerometer: its median is {length:.2f}, neither 1 g nor 9.81 m/s^2: without "
            "gravity? It is left out"
        )
        unit, scale = "", np.nan
    if unit:
        walk.note(f"accelerometer: in {unit} (median {length:.2f}), turned to camera axes")
    return Imu(timestamp_s, -scale * accel @ _CAM_FROM_DEVICE.T, gyro_rad_s @ _CAM_FROM_DEVICE.T)


IMPORTER = Importer(
    name="stray",
    title="Stray Scanner (iPhone)",
    layout="a folder with odometry.csv, camera_matrix.csv and rgb.mp4 or rgb/",
    read=read,
)
