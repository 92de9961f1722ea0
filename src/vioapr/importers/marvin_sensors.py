"""MARViN's sensor files, a row an image: GPS, accelerometer and compass of the capture app.

The gyroscope's file holds the device's attitude as a quaternion, not its angular velocity, and
is left out. The accelerometer is Unity's: in g, in axes that turn with the screen. Which way the
screen was held is not written down, so the one of four ways that fits the tracker's gravity is
taken, and none if none does.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.files.tables import parse_rows
from vioapr.files.text import read_text
from vioapr.geometry.vectors import STANDARD_GRAVITY_M_S2
from vioapr.importers.base import Walk
from vioapr.importers.diagnostics import measure_up
from vioapr.scene.frames import Tracking
from vioapr.scene.sensors import Gnss, Heading, Imu

_MAX_OFF_DEG = 15.0
# OpenCV camera axes from the screen's: x right, y up, z towards the person.
_CAM_FROM_SCREEN = np.diag([1.0, -1.0, -1.0])
# About the screen's z.
_QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def add_sensors(walk: Walk, folder: Path, images: Sequence[str]) -> None:
    """Add the measurements of a recording's images.

    Raises:
        FormatError: A sensor's file is broken, naming the line.
    """
    row_of = {name: row for row, name in enumerate(images)}
    if (found := _read(folder, "gps", 3, row_of)) is not None:
        rows, values = found
        nothing = np.full(len(rows), np.nan)
        latitude, longitude, altitude = values.T
        times = walk.timestamp_s[rows]
        walk.gnss = Gnss(times, latitude, longitude, altitude, nothing, nothing)
    if (found := _read(folder, "compass", 1, row_of)) is not None:
        rows, values = found
        nothing = np.full(len(rows), np.nan)
        walk.heading = Heading(walk.timestamp_s[rows], values[:, 0] % 360, nothing)
        walk.note("compass: headings are kept as written; how the phone was held is not known")
    if (found := _read(folder, "accel", 3, row_of)) is not None:
        add_accelerometer(walk, *found)


def _read(
    folder: Path, prefix: str, width: int, row_of: dict[str, int]
) -> tuple[NDArray[np.intp], NDArray[np.float64]] | None:
    """Frames and values of a sensor's file, in order of time; None if there are none."""
    files = [path for path in sorted(folder.iterdir()) if path.name.lower().startswith(prefix)]
    if not files or not files[0].is_file():
        return None
    columns = range(width + 1, width + 2)
    rows = parse_rows(files[0], read_text(files[0]), columns, what=f"name and {width} numbers")
    known = [k for k, name in enumerate(rows.column(0)) if name in row_of]
    if not known:
        return None
    rows = rows.at(known)
    frames = np.array([row_of[name] for name in rows.column(0)], dtype=np.intp)
    order = np.argsort(frames, kind="stable")
    return frames[order], rows.numbers(slice(1, width + 1))[order]


def add_accelerometer(walk: Walk, rows: NDArray[np.intp], accel_g: NDArray[np.float64]) -> None:
    """Add the accelerometer in the one of four turns of the screen that fits the tracker.

    Args:
        walk: With the tracker's poses.
        rows: The frame of each measurement, shape (n,).
        accel_g: By Unity, shape (n, 3), g: at rest it points down, and recordings' points up.
    """
    posed = np.flatnonzero(walk.tracking != Tracking.LOST)
    if not len(posed):
        return
    best: tuple[float, int, Imu | None] = (np.inf, 0, None)
    for quarter in range(4):
        turn = np.linalg.matrix_power(_QUARTER_TURN, quarter)
        force = -STANDARD_GRAVITY_M_S2 * accel_g @ (_CAM_FROM_SCREEN @ turn).T
        walk.imu = Imu(walk.timestamp_s[rows], force, np.full_like(force, np.nan))
        measured = measure_up(walk, posed)
        if measured is not None and measured[0] < best[0]:
            best = measured[0], 90 * quarter, walk.imu
    off_deg, turn_deg, imu = best
    walk.imu = imu if off_deg <= _MAX_OFF_DEG else None
    if walk.imu is None:
        walk.warn(
            "accelerometer: fits the tracker's gravity in no way the phone may be held: left out"
        )
    else:
        walk.note(
            f"accelerometer: taken as turned by {turn_deg} deg on the screen, which fits gravity"
        )
