"""kapture's and LaMAR's `trajectories.txt`: `timestamp, device_id, qw, qx, qy, qz, tx, ty, tz`.

The columns are the same and the poses are each other's inverse: kapture has device_from_world
(naver/kapture, kapture_format.adoc: "same as in colmap"), LaMAR's Capture world_from_device
(microsoft/lamar-benchmark, CAPTURE.md: "the pose convention is reverted"). OpenCV axes. A device
may be a rig; `rigs.txt` beside it then says where its cameras are, in the same direction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError, VioAprError
from vioapr.files.tables import Rows, format_rows, head_rows, is_number, parse_rows, to_ticks
from vioapr.files.text import is_folder, natural_key, read_bytes, read_text, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, poses_of, require_times
from vioapr.formats.times import find_time_unit, seconds_of
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import UNIT_TOLERANCE, Trajectory

_COLUMNS = "timestamp, device_id, qw, qx, qy, qz, tx, ty, tz"
_WIDTHS = range(9, 100)  # LaMAR may add a covariance
_FILE = "trajectories.txt"
_VERSION_LINE, _UNIT_LINE = "# kapture format: 1.1", "# timestamps: microseconds"
_MICROSECONDS = 1_000_000
_MAX_NUMBER, _MAX_NUMBER_STEP = 1e6, 10.0


@dataclass(frozen=True)
class _Dialect:
    """What differs between the two.

    Attributes:
        convert: From the file's poses to world_from_device, and from those of `rigs.txt` to
            rig_from_camera.
        images: Name of the table of images.
    """

    convert: Callable[[Rigid3], Rigid3]
    images: str

    def read(self, path: Path, options: ReadOptions) -> Trajectory:
        """Read world_from_cam poses of one device, in the order of their timestamps.

        Timestamps that count frames (0, 1, 2 ...) give no times, unless a rate is given.

        Args:
            path: The table, its folder, or a kapture folder.
            options: `sequence` is the device, or a camera of a rig.

        Raises:
            FileError: It cannot be read or is malformed, naming file and line.
            ParameterError: There are several devices, or not the one that is asked for.
        """
        path = _file_of(path)
        rows = _parse(path, _COLUMNS)
        cameras = self._rig_cameras(path.parent)
        device, camera = _choose_device(path, rows.column(1), cameras, options)
        rows = rows.at(k for k, name in enumerate(rows.column(1)) if name == device)
        ticks = rows.ticks(0)
        order = sorted(range(len(rows)), key=lambda k: ticks[k])
        rows, ticks = rows.at(order), [ticks[k] for k in order]
        poses = self.convert(_poses(rows))
        is_rig = any(rig == device for rig, _ in cameras)
        if camera is not None:
            poses = poses @ cameras[device, camera]
        elif is_rig:
            listed = ", ".join(name for rig, name in cameras if rig == device)
            text = f"poses are of the rig {device!r}: choose a camera with `sequence`: {listed}"
            options.note(path, text, is_warning=True)
        times, is_timed = _times(path, ticks, options)
        return build_trajectory(
            rows,
            times,
            poses,
            options,
            names=self._image_names(path.parent, rows.column(0), (camera, device)),
            is_timed=is_timed,
            source="rig" if is_rig and camera is None else "cam",
        )

    def _rig_cameras(self, folder: Path) -> dict[tuple[str, str], Rigid3]:
        """rig_from_camera by rig and camera; none where there is no table of rigs."""
        path = folder / "rigs.txt"
        if not path.is_file() or not head_rows(read_bytes(path, 16384), ","):
            return {}
        rows = _parse(path, f"rig_device_id, sensor_{_COLUMNS[11:]}")
        kinds = _sensor_kinds(folder)
        poses = self.convert(_poses(rows))
        return {
            (rig, sensor): poses.at(k)
            for k, (rig, sensor) in enumerate(zip(rows.column(0), rows.column(1), strict=True))
            if kinds.get(sensor, "camera") == "camera" and poses.at(k).is_known
        }

    def _image_names(
        self, folder: Path, stamps: list[str], devices: tuple[str | None, ...]
    ) -> list[str] | None:
        """An image for each timestamp, if the table of images has them all for a device."""
        path = folder / self.images
        if not path.is_file():
            return None
        what = "timestamp, device_id, image_path"
        rows = parse_rows(path, read_text(path), range(3, 100), what=what, delimiter=",")
        for device in devices:
            image_of = {row[0]: row[2] for row in rows.fields if row[1] == device}
            names = [image_of.get(stamp, "") for stamp in stamps]
            if all(names) and len(set(names)) == len(names):
                return names
        return None


def _file_of(path: Path) -> Path:
    if not is_folder(path):
        return path
    inner = path / "sensors" / _FILE
    return inner if inner.is_file() else path / _FILE


def _parse(path: Path, what: str) -> Rows:
    """The rows of a table; a pose that is not known may be blank."""
    return parse_rows(path, read_text(path), _WIDTHS, what=what, delimiter=",")


def _poses(rows: Rows) -> Rigid3:
    values = rows.numbers(slice(2, 9)).reshape(-1, 7)
    return poses_of(rows, values[:, 4:7], values[:, [1, 2, 3, 0]])


def _sensor_kinds(folder: Path) -> dict[str, str]:
    path = folder / "sensors.txt"
    if not path.is_file():
        return {}
    lines = [line.split(",") for line in read_text(path).splitlines() if not line.startswith("#")]
    return {fields[0].strip(): fields[2].strip() for fields in lines if len(fields) > 2}


def _choose_device(
    path: Path,
    devices: list[str],
    cameras: dict[tuple[str, str], Rigid3],
    options: ReadOptions,
) -> tuple[str, str | None]:
    """The device to read, and the camera if the device is a rig and that is clear."""
    available = sorted(set(devices), key=natural_key)
    wanted = options.sequence
    rigs_of = [(rig, camera) for rig, camera in cameras if rig in available]
    if wanted is None and len(available) > 1:
        listed = ", ".join([*available[:20], *(["..."] if len(available) > 20 else [])])
        raise ParameterError(f"{path} holds several devices: choose one with `sequence`: {listed}")
    if wanted is None or wanted in available:
        device = wanted or available[0]
        of_rig = [camera for rig, camera in rigs_of if rig == device]
        return device, of_rig[0] if len(of_rig) == 1 else None
    for rig, camera in rigs_of:
        if camera == wanted:
            return rig, camera
    listed = ", ".join([*available, *(camera for _, camera in rigs_of)])
    raise ParameterError(f"{path} holds no device {wanted!r}: expected one of {listed}")


def _times(
    path: Path, ticks: list[int | float], options: ReadOptions
) -> tuple[NDArray[np.float64], bool]:
    """Seconds, and whether they are: a timestamp may be any number that tells frames apart."""
    values = np.array(ticks, dtype=np.float64)
    if any(line.strip() == _UNIT_LINE for line in read_text(path)[:500].split("\n")):
        return seconds_of(path, ticks, options, fixed="us"), True
    with np.errstate(all="ignore"):  # any numbers of a file, inf too
        steps = np.diff(values)
    counts = np.abs(values).max() < _MAX_NUMBER and not (steps > _MAX_NUMBER_STEP).any()
    if counts and options.time_unit is None and not find_time_unit(values).is_date:
        if options.rate_hz is not None:
            return values / options.rate_hz, True
        return np.arange(len(values), dtype=np.float64), False
    return seconds_of(path, ticks, options), True


def _fits(head: bytes) -> bool:
    """Whether the first rows have the columns, with a unit quaternion where there is one."""
    rows = head_rows(head, ",")
    if not rows or any(len(row) not in _WIDTHS or not row[0].isdecimal() for row in rows):
        return False
    known = [row[2:9] for row in rows if all(row[2:9])]
    if not all(is_number(field) for row in known for field in row):
        return False
    quats = np.array(known, dtype=np.float64).reshape(-1, 7)[:, :4]
    with np.errstate(all="ignore"):
        return bool((np.abs(np.linalg.norm(quats, axis=1) - 1) <= UNIT_TOLERANCE).all())


def _head_of(path: Path, head: bytes) -> bytes:
    if head:
        return head
    try:
        return read_bytes(_file_of(path), 16384) if _file_of(path).is_file() else b""
    except VioAprError:
        return b""


def sniff_kapture(path: Path, head: bytes) -> float:
    """Sure by the columns and kapture's first line; without it, the poses may be inverted."""
    head = _head_of(path, head)
    if not _fits(head):
        return 0.0
    return 0.98 if b"# kapture format" in head[:200] else 0.1 if b"*covar" in head[:400] else 0.5


def sniff_lamar(path: Path, head: bytes) -> float:
    """Sure by the columns and LaMAR's header; without it, the poses may be inverted."""
    head = _head_of(path, head)
    if not _fits(head):
        return 0.0
    return 0.95 if b"*covar" in head[:400] else 0.0 if b"# kapture" in head[:200] else 0.5


def _write(path: Path, trajectory: Trajectory, poses: Rigid3, first: str) -> None:
    require_times(trajectory, "a trajectories.txt")
    columns = pose_columns(poses, (3, 0, 1, 2))
    ticks = to_ticks(trajectory.timestamp_s, _MICROSECONDS)
    rows = [(tick, "cam", *row[3:], *row[:3]) for tick, row in zip(ticks, columns, strict=True)]
    write_text(path, f"{first}\n{_UNIT_LINE}\n" + format_rows(rows, ", "))


def write_kapture(path: Path, trajectory: Trajectory) -> None:
    """Write all digits of the poses of one device, "cam"; times are rounded to microseconds.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    first = f"{_VERSION_LINE}\n# {_COLUMNS}"
    _write(path, trajectory, conventions.cam_from_world(trajectory.target_from_source), first)


def write_lamar(path: Path, trajectory: Trajectory) -> None:
    """Write all digits of the poses of one device, "cam"; times are rounded to microseconds.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    _write(path, trajectory, trajectory.target_from_source, f"# {_COLUMNS}, *covar")


_NOTE = "OpenCV axes, quaternion wxyz, metres"

FORMAT = Format(
    name="kapture",
    title="kapture trajectories.txt",
    convention=f"{_COLUMNS}; device_from_world (T is not the camera's position), {_NOTE}",
    extensions=(".txt", "/"),
    sniff=sniff_kapture,
    read=_Dialect(conventions.cam_from_world, "records_camera.txt").read,
    write=write_kapture,
    has_times=True,
    default_for=(_FILE,),
)

LAMAR_FORMAT = Format(
    name="lamar",
    title="LaMAR Capture trajectories.txt",
    convention=f"{_COLUMNS}; world_from_device, {_NOTE}",
    extensions=(".txt", "/"),
    sniff=sniff_lamar,
    read=_Dialect(conventions.world_from_cam, "images.txt").read,
    write=write_lamar,
    has_times=True,
)
