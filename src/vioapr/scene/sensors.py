"""IMU, GNSS and compass of a recording: tables beside the frames, on the same clock."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.files.append_table import Problem, finite_numbers, read_blocks

IMU_HEADER = "timestamp_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s"
GNSS_HEADER = (
    "timestamp_s,latitude_deg,longitude_deg,altitude_m,horizontal_sigma_m,vertical_sigma_m"
)
HEADING_HEADER = "timestamp_s,heading_deg,sigma_deg"


@dataclass(frozen=True, eq=False)
class Imu:
    """Inertial measurements in the axes of `cam`, n of them.

    Attributes:
        timestamp_s: Shape (n,), s.
        accel_m_s2: Specific force, shape (n, 3), m/s^2: of a phone at rest it points up, 9.81.
            NaN where the device gave none.
        gyro_rad_s: Angular velocity, shape (n, 3), rad/s. NaN where the device gave none.
    """

    timestamp_s: NDArray[np.float64]
    accel_m_s2: NDArray[np.float64]
    gyro_rad_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.timestamp_s)


@dataclass(frozen=True, eq=False)
class Gnss:
    """Satellite positions, WGS 84, n of them.

    Attributes:
        timestamp_s: Shape (n,), s.
        latitude_deg: Shape (n,).
        longitude_deg: Shape (n,).
        altitude_m: Above the ellipsoid, or what the device calls altitude; NaN if none.
        horizontal_sigma_m: The device's own accuracy, m; NaN if none.
        vertical_sigma_m: Likewise.
    """

    timestamp_s: NDArray[np.float64]
    latitude_deg: NDArray[np.float64]
    longitude_deg: NDArray[np.float64]
    altitude_m: NDArray[np.float64]
    horizontal_sigma_m: NDArray[np.float64]
    vertical_sigma_m: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.timestamp_s)


@dataclass(frozen=True, eq=False)
class Heading:
    """Compass headings, n of them.

    Attributes:
        timestamp_s: Shape (n,), s.
        heading_deg: Of the camera's view, clockwise from true north, 0 to 360.
        sigma_deg: The device's own accuracy; NaN if none.
    """

    timestamp_s: NDArray[np.float64]
    heading_deg: NDArray[np.float64]
    sigma_deg: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.timestamp_s)


def read_imu(path: Path, problems: list[Problem]) -> Imu:
    """Read `imu.csv`; what is wrong is appended to the problems, and its rows left out.

    Raises:
        FormatError: It cannot be read at all, or has another header.
    """
    values = _read(path, IMU_HEADER, problems, required=1)
    return Imu(values[:, 0], values[:, 1:4], values[:, 4:7])


def read_gnss(path: Path, problems: list[Problem]) -> Gnss:
    """As `read_imu`, of `gnss.csv`."""
    limits = {1: 90.0, 2: 180.0}
    return Gnss(*_read(path, GNSS_HEADER, problems, required=3, limits=limits).T)


def read_heading(path: Path, problems: list[Problem]) -> Heading:
    """As `read_imu`, of `heading.csv`."""
    return Heading(*_read(path, HEADING_HEADER, problems, required=2, limits={1: 360.0}).T)


def _read(
    path: Path,
    header: str,
    problems: list[Problem],
    *,
    required: int,
    limits: dict[int, float] | None = None,
) -> NDArray[np.float64]:
    """All good rows, shape (n, columns).

    Args:
        path: The file.
        header: Its first line.
        problems: Where what is wrong is appended.
        required: How many of the first columns must not be empty.
        limits: Largest magnitude of single columns.
    """
    names = header.split(",")
    parts, latest_s = [np.zeros((0, len(names)))], -np.inf
    for block in read_blocks(path, header, problems):
        block, values = finite_numbers(block, range(len(names)), problems)
        found = find_row_problems(values, names, required, limits or {}, latest_s)
        problems += [Problem(path, block.lines[row], text) for row, text in sorted(found.items())]
        values = np.delete(values, list(found), axis=0)
        parts.append(values)
        latest_s = max(latest_s, values[:, 0].max(initial=-np.inf))
    return np.concatenate(parts)


def find_row_problems(
    values: NDArray[np.float64],
    names: list[str],
    required: int,
    limits: dict[int, float],
    latest_s: float,
) -> dict[int, str]:
    """Find the first problem of every row that cannot be a measurement.

    Args:
        values: Numbers, shape (n, columns), time first; NaN where a field is empty.
        names: The columns'.
        required: How many of the first columns must not be empty.
        limits: Largest magnitude of single columns.
        latest_s: The last good timestamp before these rows.

    Returns:
        Problems by row.
    """
    found: dict[int, str] = {}

    def report(bad: Any, text: str) -> None:
        for row in np.flatnonzero(bad):
            found.setdefault(int(row), text)

    is_missing = np.isnan(values[:, :required]).any(axis=1)
    report(is_missing, f"expected a value for {','.join(names[:required])}")
    for column, limit in limits.items():
        is_beyond = np.abs(values[:, column]) > limit
        report(is_beyond, f"expected {names[column]} within {limit:g}")
    usable = np.array([row not in found for row in range(len(values))], dtype=bool)
    times = np.concatenate([[latest_s], np.where(usable, values[:, 0], -np.inf)])
    is_early = values[:, 0] < np.maximum.accumulate(times)[:-1]
    report(is_early, "expected a timestamp not earlier than the one before")
    return found
