"""The logs of a capture: numbered segments of tables, each with its header, in a browser's terms.

A segment that the phone was writing when it died may end in half a row, and rows may come late,
as pictures are encoded side by side. So rows are sorted by time, and those that cannot be used are
left out and counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.files.append_table import Problem, finite_numbers, read_blocks
from vioapr.geometry.frames import cam_from_arcam
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.device_axes import cam_from_device, view_heading_deg
from vioapr.scene import frames as frame_table
from vioapr.scene import sensors
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.sensors import Gnss, Heading, Imu

FRAMES_HEADER = f"{frame_table.HEADER},world"
"""As `frames.csv`, but poses are vio_from_arcam, and `world` counts the tracker's worlds."""

IMU_HEADER = "timestamp_s,ax_m_s2,ay_m_s2,az_m_s2,gx_deg_s,gy_deg_s,gz_deg_s,screen_deg"
GNSS_HEADER = sensors.GNSS_HEADER
HEADING_HEADER = "timestamp_s,alpha_deg,beta_deg,gamma_deg,sigma_deg"

_FRAME_NUMBERS = [0, *range(3, 17)]
_POSITION, _QUAT, _CAMERA, _WORLD = slice(1, 4), slice(4, 8), slice(8, 14), 14
_GYRO = slice(4, 7)


@dataclass(frozen=True, eq=False)
class CapturedFrames:
    """The frames of a capture, n of them, in order of time.

    Attributes:
        timestamp_s: Shape (n,), increasing, s.
        image: Names in `images/`; "" where a frame has none.
        tracking: Shape (n,), values of `Tracking`; the first frame with a pose of every new world
            says so, whatever became of those before it.
        vio_from_cam: Shape (n,), OpenCV camera axes; NaN where lost.
        intrinsics: Shapes (n,).
    """

    timestamp_s: NDArray[np.float64]
    image: tuple[str, ...]
    tracking: NDArray[np.uint8]
    vio_from_cam: Rigid3
    intrinsics: Intrinsics


def read_captured_frames(folder: Path, problems: list[Problem]) -> CapturedFrames:
    """Read the log `frames`.

    Args:
        folder: The capture.
        problems: Where rows that are left out are appended.

    Raises:
        FileError: A segment cannot be read, or has another header.
    """
    labels = {state.label: int(state) for state in Tracking}
    tables = [np.zeros((0, len(_FRAME_NUMBERS)))]
    images: list[str] = []
    states: list[int] = []
    for path in segments(folder, "frames"):
        for read in read_blocks(path, FRAMES_HEADER, problems):
            block, values = finite_numbers(read, _FRAME_NUMBERS, problems)
            order = np.argsort(values[:, 0], kind="stable")
            block, values = block.at(order.tolist()), values[order]
            tracking = np.array([labels.get(row[2], 255) for row in block.fields])
            found = dict(
                frame_table.find_row_problems(block, values[:, :_WORLD], tracking, -np.inf)
            )
            for row in np.flatnonzero(np.isnan(values[:, _WORLD])).tolist():
                found.setdefault(row, "expected a number of the tracking world, got none")
            problems += [Problem(path, block.lines[row], text) for row, text in found.items()]
            kept = [row for row in range(len(values)) if row not in found]
            tables.append(values[kept])
            images += [block.fields[row][1] for row in kept]
            states += tracking[kept].tolist()
    values = np.concatenate(tables)
    order = np.argsort(values[:, 0], kind="stable")
    is_new = np.diff(values[order, 0], prepend=-np.inf) > 0
    if not is_new.all():  # of segments that say the same
        text = f"{(~is_new).sum()} frames have the timestamp of another: left out"
        problems.append(Problem(folder, None, text))
    order = order[is_new]
    values, tracking = values[order], np.array(states, dtype=np.uint8)[order]
    poses = Rigid3(values[:, _POSITION].copy(), values[:, _QUAT].copy())
    return CapturedFrames(
        values[:, 0].copy(),
        tuple(images[row] for row in order.tolist()),
        mark_worlds(tracking, values[:, _WORLD]),
        cam_from_arcam(poses),
        Intrinsics(*values[:, _CAMERA].T.copy()),
    )


def mark_worlds(tracking: NDArray[np.uint8], world: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Say `reset` of the first frame with a pose in every tracking world but the first.

    Args:
        tracking: Shape (n,), values of `Tracking`; a reset that is said counts too.
        world: Shape (n,), the number of each frame's tracking world.
    """
    marked = tracking.copy()
    rows = np.flatnonzero(tracking != Tracking.LOST)
    marked[rows[1:][np.diff(world[rows]) != 0]] = Tracking.RESET
    return marked


def read_captured_imu(folder: Path, problems: list[Problem], *, is_reversed: bool) -> Imu:
    """Read the log `imu`: `devicemotion` events in device axes, degrees a second.

    Args:
        folder: The capture.
        problems: Where rows that are left out are appended.
        is_reversed: Whether acceleration has the sign of iOS.
    """
    values = _read(folder, "imu", IMU_HEADER, problems, required=(0, 7))
    sign = -1.0 if is_reversed else 1.0
    accel = cam_from_device(sign * values[:, 1:4], values[:, 7])
    gyro = cam_from_device(np.radians(values[:, _GYRO]), values[:, 7])
    # A vector that is known in part cannot be turned.
    for vector in (accel, gyro):
        vector[np.isnan(vector).any(axis=1)] = np.nan
    return Imu(values[:, 0], accel, gyro)


def read_captured_gnss(folder: Path, problems: list[Problem]) -> Gnss:
    """Read the log `gnss`: positions as a browser gives them."""
    limits = {1: 90.0, 2: 180.0}
    return Gnss(*_read(folder, "gnss", GNSS_HEADER, problems, required=(0, 1, 2), limits=limits).T)


def read_captured_heading(folder: Path, problems: list[Problem]) -> Heading:
    """Read the log `heading`: absolute `deviceorientation` events."""
    values = _read(folder, "heading", HEADING_HEADER, problems, required=(0, 1, 2, 3))
    heading = view_heading_deg(values[:, 1:4])
    kept = np.isfinite(heading)
    return Heading(values[kept, 0], heading[kept], values[kept, 4])


def segments(folder: Path, log: str) -> Sequence[Path]:
    """The segments of a log, in order."""
    return sorted(folder.glob(f"{log}-*.csv"))


def _read(
    folder: Path,
    log: str,
    header: str,
    problems: list[Problem],
    *,
    required: Sequence[int],
    limits: dict[int, float] | None = None,
) -> NDArray[np.float64]:
    """All good rows of a log, shape (n, columns), in order of time."""
    names = header.split(",")
    parts = [np.zeros((0, len(names)))]
    for path in segments(folder, log):
        for read in read_blocks(path, header, problems):
            block, values = finite_numbers(read, range(len(names)), problems)
            bad = np.isnan(values[:, list(required)]).any(axis=1)
            for column, limit in (limits or {}).items():
                bad |= np.abs(values[:, column]) > limit
            problems += [
                Problem(path, block.lines[row], f"expected {header} with sound values")
                for row in np.flatnonzero(bad).tolist()
            ]
            parts.append(values[~bad])
    values = np.concatenate(parts)
    return values[np.argsort(values[:, 0], kind="stable")]
