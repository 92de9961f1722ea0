"""Aria MPS trajectories: csv with a header, world_from_device, quaternion xyzw, microseconds."""

from __future__ import annotations

from pathlib import Path

from vioapr.files.tables import format_rows, read_headed_csv, to_ticks
from vioapr.files.text import read_bytes, write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.headed import build_timed
from vioapr.formats.poses import pose_columns, require_times
from vioapr.trajectory import Trajectory

_TIME = "tracking_timestamp_us"
_MICROSECONDS = 1_000_000


def _columns(target: str) -> list[str]:
    return [f"{name}_{target}_device" for name in ("tx", "ty", "tz", "qx", "qy", "qz", "qw")]


def sniff(path: Path, head: bytes) -> float:
    """Sure by the header line."""
    del path
    header = head.split(b"\n")[0]
    return 1.0 if _TIME.encode() in header and b"_device" in header else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read poses of the device: closed loop in the world, open loop in `odometry`.

    The device frame is the glasses', not a camera's.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
    """
    is_open_loop = b"tx_odometry_device" in read_bytes(path, 4096).split(b"\n")[0]
    target = "odometry" if is_open_loop else "world"
    rows = read_headed_csv(path, [_TIME, *_columns(target)])
    return build_timed(
        rows,
        options,
        conventions.world_from_cam,
        pose=slice(1, 8),
        per_second=_MICROSECONDS,
        target=target,
        source="device",
    )


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits of the poses; times are rounded to whole microseconds.

    Raises:
        ParameterError: The trajectory has no timestamps.
        UnwritableError: The file cannot be written.
    """
    require_times(trajectory, "an Aria file")
    target = "odometry" if trajectory.target == "odometry" else "world"
    ticks = to_ticks(trajectory.timestamp_s, _MICROSECONDS)
    columns = pose_columns(trajectory.target_from_source)
    rows = [(tick, *row) for tick, row in zip(ticks, columns, strict=True)]
    write_text(path, ",".join([_TIME, *_columns(target)]) + "\n" + format_rows(rows, ","))


FORMAT = Format(
    name="aria",
    title="Aria MPS trajectory",
    convention=(
        f"{_TIME},tx,ty,tz,qx,qy,qz,qw by header; world_from_device (the glasses), z up, "
        "quaternion xyzw, microseconds, metres"
    ),
    extensions=(".csv",),
    sniff=sniff,
    read=read,
    write=write,
    has_times=True,
    default_for=("open_loop_trajectory.csv", "closed_loop_trajectory.csv"),
)
