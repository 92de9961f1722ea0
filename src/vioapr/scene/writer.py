"""Writing a recording frame by frame, so that a crash loses at most the frame being written."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.errors import ParameterError, UnwritableError
from vioapr.files.append_table import AppendTable
from vioapr.files.images import copy_image, encode_image, write_image
from vioapr.files.paths import AnyPath
from vioapr.files.tables import format_field
from vioapr.geometry.rigid import Rigid3
from vioapr.scene import sensors
from vioapr.scene.frames import HEADER, Frames, Intrinsics, Tracking, find_name_problem
from vioapr.scene.recording import (
    FRAMES_FILE,
    GNSS_FILE,
    HEADING_FILE,
    IMAGES_FOLDER,
    IMU_FILE,
    INFO_FILE,
    write_info,
)
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import UNIT_TOLERANCE


class RecordingWriter:
    """A recording being written, for use in a `with` statement.

    An image is on disk before the line of its frame is, and every line is handed to the system
    at once. After a crash of the program all that was added is there, but perhaps the last.
    """

    def __init__(self, folder: AnyPath, info: RecordingInfo, *, link_images: bool = False) -> None:
        """Begin a recording.

        Args:
            folder: Made if needed; must hold no recording yet. Its name is the recording's id.
            info: What made it.
            link_images: Whether images given as paths are hard-linked rather than copied,
                where the file system can.

        Raises:
            FormatError: The folder holds a recording, or cannot be written.
        """
        self.folder = Path(folder)
        self._link = link_images
        self._images = str(self.folder / IMAGES_FOLDER)
        self._tables: dict[str, AppendTable] = {}
        self._latest_s: dict[str, float] = {}
        try:
            (self.folder / IMAGES_FOLDER).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnwritableError.of(self.folder, error) from None
        self._table(FRAMES_FILE, HEADER)
        self.set_info(info)

    def add_frame(
        self,
        timestamp_s: float,
        image_name: str,
        image: bytes | NDArray[np.uint8] | AnyPath | None,
        tracking: Tracking,
        vio_from_cam: Rigid3 | None,
        intrinsics: Intrinsics | None = None,
    ) -> None:
        """Add a frame.

        Args:
            timestamp_s: Later than the frame before, s.
            image_name: File name in `images/`; "" for a frame without image.
            image: An encoded JPEG or PNG, pixels (RGB or grey, encoded by the name's ending),
                or a file to copy. None if the file is there already, or there is no image.
            tracking: The tracker's state.
            vio_from_cam: Its pose: y-up tracking world, OpenCV camera axes, m. None if, and
                only if, tracking is lost.
            intrinsics: The camera; None if not known.

        Raises:
            ParameterError: Something of it cannot be; nothing is written.
            FormatError: It cannot be written; the frames before stay whole.
        """
        problem = find_name_problem(image_name)
        if problem or (image is not None and not image_name):
            raise ParameterError(problem or "an image needs a name")
        pose = pose_fields(tracking, vio_from_cam)
        self._check_time(FRAMES_FILE, timestamp_s, strictly=True)
        if image is not None:
            self.write_image(image_name, image)
        camera = [_pixels(value) for value in intrinsics or Intrinsics()]
        fields = [float(timestamp_s), image_name, Tracking(tracking).label, *pose, *camera]
        self._append(FRAMES_FILE, fields)

    def add_imu(self, timestamp_s: float, accel_m_s2: ArrayLike, gyro_rad_s: ArrayLike) -> None:
        """Add a measurement in `cam` axes; of a phone at rest, accel points up. NaN: none."""
        self._add(
            IMU_FILE, sensors.IMU_HEADER, timestamp_s, [*_three(accel_m_s2), *_three(gyro_rad_s)]
        )

    def add_gnss(
        self,
        timestamp_s: float,
        latitude_deg: float,
        longitude_deg: float,
        altitude_m: float = np.nan,
        horizontal_sigma_m: float = np.nan,
        vertical_sigma_m: float = np.nan,
    ) -> None:
        """Add a position, WGS 84; NaN is not known."""
        values = [latitude_deg, longitude_deg, altitude_m, horizontal_sigma_m, vertical_sigma_m]
        self._add(GNSS_FILE, sensors.GNSS_HEADER, timestamp_s, values)

    def add_heading(
        self, timestamp_s: float, heading_deg: float, sigma_deg: float = np.nan
    ) -> None:
        """Add a heading of the camera's view, clockwise from true north, 0 to 360."""
        self._add(HEADING_FILE, sensors.HEADING_HEADER, timestamp_s, [heading_deg, sigma_deg])

    def add_frames(self, frames: Frames) -> None:
        """Add many frames at once: much faster than one by one.

        Args:
            frames: In order of time; their images are written already, by `write_image`.

        Raises:
            ParameterError: They are not later than those before.
            FormatError: They cannot be written; none of them is, then.
        """
        if not len(frames):
            return
        times = frames.timestamp_s
        self._check_time(FRAMES_FILE, float(times[0]), strictly=True)
        if not (np.diff(times) > 0).all():
            raise ParameterError(f"{FRAMES_FILE}: expected increasing timestamps")
        self._tables[FRAMES_FILE].append("\n".join(lines_of(frames)))
        self._latest_s[FRAMES_FILE] = float(times[-1])

    def write_image(self, name: str, image: bytes | NDArray[np.uint8] | AnyPath) -> None:
        """Write an image; see `add_frame`, which does so itself.

        Raises:
            FormatError: It cannot be written, or there is one of this name.
        """
        path = f"{self._images}/{name}"
        if isinstance(image, str | os.PathLike):
            copy_image(os.fspath(image), path, link=self._link)
        else:
            write_image(path, image if isinstance(image, bytes) else encode_image(name, image))

    def set_info(self, info: RecordingInfo) -> None:
        """Replace what is said of the recording, e.g. by notes of what was found on the way."""
        write_info(self.folder / INFO_FILE, info)

    def close(self) -> None:
        """Close all tables."""
        for table in self._tables.values():
            table.close()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _add(self, file: str, header: str, timestamp_s: float, values: Sequence[float]) -> None:
        self._check_time(file, timestamp_s, strictly=False)
        self._table(file, header)
        self._append(file, [float(timestamp_s), *(float(value) for value in values)])

    def _append(self, file: str, fields: Sequence[object]) -> None:
        self._tables[file].append(",".join(format_field(field) for field in fields))
        self._latest_s[file] = float(fields[0])  # type: ignore[arg-type]

    def _table(self, file: str, header: str) -> None:
        if file not in self._tables:
            self._tables[file] = AppendTable(self.folder / file, header)

    def _check_time(self, file: str, timestamp_s: float, *, strictly: bool) -> None:
        latest_s = self._latest_s.get(file, -np.inf)
        is_later = timestamp_s > latest_s if strictly else timestamp_s >= latest_s
        if not np.isfinite(timestamp_s) or not is_later:
            raise ParameterError(
                f"{file}: expected a timestamp later than {latest_s:.6f} s, got {timestamp_s:.6f} s"
            )


_LABELS = {int(state): state.label for state in Tracking}


def lines_of(frames: Frames) -> Iterator[str]:
    """Format frames as lines of `frames.csv`."""
    cameras = np.stack([np.asarray(column) for column in frames.intrinsics], axis=1)
    # Mostly one camera took all: its text is made once.
    is_one = np.array_equal(cameras, np.broadcast_to(cameras[:1], cameras.shape), equal_nan=True)
    texts = [
        ",".join(format_field(_pixels(value)) for value in camera)
        for camera in (cameras[:1] if is_one else cameras)
    ]
    texts = texts * len(frames) if is_one else texts
    labels = [_LABELS[value] for value in frames.tracking.tolist()]
    poses = np.concatenate(frames.vio_from_cam, axis=1).tolist()
    columns = zip(frames.timestamp_s.tolist(), frames.image, labels, poses, texts, strict=True)
    for time, name, label, pose, text in columns:
        numbers = "," * 6 if pose[0] != pose[0] else ",".join(map(repr, pose))
        yield f"{time!r},{name},{label},{numbers},{text}"


def _three(vector: ArrayLike) -> list[float]:
    values = np.asarray(vector, dtype=np.float64)
    if values.shape != (3,):
        raise ParameterError(f"expected 3 numbers, got shape {values.shape}")
    return values.tolist()


def _pixels(value: ArrayLike) -> object:
    """Whole numbers without a point."""
    number = float(np.asarray(value))
    return int(number) if number.is_integer() else number


def pose_fields(tracking: Tracking, vio_from_cam: Rigid3 | None) -> list[float | None]:
    """Check a frame's pose; give position and quaternion, or nothing where tracking is lost.

    Raises:
        ParameterError: It is no pose, or there is one although tracking is lost.
    """
    if (tracking == Tracking.LOST) != (vio_from_cam is None):
        raise ParameterError(
            f"expected a pose if and only if tracking is not lost, got tracking "
            f"{Tracking(tracking).label} {'without' if vio_from_cam is None else 'with'} pose"
        )
    if vio_from_cam is None:
        return [None] * 7
    position, quat = (np.asarray(part, dtype=np.float64) for part in vio_from_cam)
    if position.shape != (3,) or quat.shape != (4,):
        raise ParameterError(f"expected one pose, got shapes {position.shape}, {quat.shape}")
    is_unit = abs(float(np.linalg.norm(quat)) - 1) <= UNIT_TOLERANCE
    if not np.isfinite(position).all() or not is_unit:
        raise ParameterError(
            f"expected a finite position and a unit quaternion, got {vio_from_cam}"
        )
    return [*position.tolist(), *quat.tolist()]
