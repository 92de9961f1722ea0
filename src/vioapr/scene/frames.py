"""Frames of a recording: what the tracker said of every image, as columns and as `frames.csv`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.files.append_table import Problem, finite_numbers, read_blocks
from vioapr.files.tables import Rows
from vioapr.formats.poses import MAX_DISTANCE_M, MAX_TIME_S
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import UNIT_TOLERANCE, Trajectory

HEADER = "timestamp_s,image,tracking,x_m,y_m,z_m,qx,qy,qz,qw,width,height,fx,fy,cx,cy"
_TIME, _IMAGE, _TRACKING, _POSE, _INTRINSICS = 0, 1, 2, range(3, 10), range(10, 16)
_NUMBERS = [_TIME, *_POSE, *_INTRINSICS]


class Tracking(IntEnum):
    """What a tracker says of a frame."""

    NORMAL = 0
    LIMITED = 1
    """It has a pose, and doubts it."""
    LOST = 2
    """It has no pose."""
    RESET = 3
    """The first frame of a new tracking world: poses before and after are not related."""

    @property
    def label(self) -> str:
        """As in files."""
        return self.name.lower()


_TRACKING_OF_LABEL = {tracking.label: tracking.value for tracking in Tracking}


class Intrinsics(NamedTuple):
    """Pinhole cameras, in pixels of the image as stored; each a number or shape (n,).

    Attributes:
        width: Image width, pixels; NaN if not known.
        height: Image height.
        fx: Focal length along the width, pixels; NaN if not known.
        fy: Focal length along the height.
        cx: Principal point from the left edge of the left pixel; the image's middle is width/2.
        cy: Principal point from the top edge of the top pixel.
    """

    width: ArrayLike = np.nan
    height: ArrayLike = np.nan
    fx: ArrayLike = np.nan
    fy: ArrayLike = np.nan
    cx: ArrayLike = np.nan
    cy: ArrayLike = np.nan

    def at(self, rows: Any) -> Intrinsics:
        """The cameras of some rows."""
        return Intrinsics(*(np.asarray(column)[rows] for column in self))


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a recording, n of them, in order of time.

    Attributes:
        timestamp_s: Shape (n,), strictly increasing, s.
        image: File names in `images/`; "" where a frame has no image.
        tracking: Shape (n,), values of `Tracking`.
        vio_from_cam: Shape (n,); y-up tracking world, OpenCV camera axes, m. NaN where lost.
        intrinsics: Of each frame, shapes (n,).
        lines: Line of each frame in `frames.csv`, shape (n,).
    """

    timestamp_s: NDArray[np.float64]
    image: tuple[str, ...]
    tracking: NDArray[np.uint8]
    vio_from_cam: Rigid3
    intrinsics: Intrinsics
    lines: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.timestamp_s)

    @property
    def has_pose(self) -> NDArray[np.bool_]:
        """Shape (n,), the frames with a VIO pose."""
        return self.vio_from_cam.is_known

    @property
    def has_image(self) -> NDArray[np.bool_]:
        """Shape (n,), the frames with an image."""
        return np.array([bool(name) for name in self.image], dtype=bool)

    @property
    def tracking_world(self) -> NDArray[np.int64]:
        """Shape (n,), which tracking world a frame is in: 0, and one more after every reset."""
        return np.cumsum(self.tracking == Tracking.RESET)

    def at_rows(self, rows: NDArray[np.integer] | NDArray[np.bool_] | slice) -> Frames:
        """Some of the frames, in order."""
        kept = np.asarray(np.arange(len(self))[rows], dtype=np.intp)
        return Frames(
            self.timestamp_s[kept],
            tuple(self.image[int(row)] for row in kept),
            self.tracking[kept],
            self.vio_from_cam.at(kept),
            self.intrinsics.at(kept),
            self.lines[kept],
        )

    def to_trajectory(self) -> Trajectory:
        """The poses vio_from_cam of the frames that have one; names are those of images.

        Raises:
            ParameterError: No frame has a pose.
        """
        rows = np.flatnonzero(self.has_pose)
        names = tuple(self.image[row] for row in rows)
        poses = self.vio_from_cam.at(rows)
        return Trajectory(
            self.timestamp_s[rows],
            poses.translation_m,
            poses.quat_xyzw,
            names=names if all(names) else None,
            target="vio",
        )


def read_frames(path: Path, problems: list[Problem]) -> Frames:
    """Read `frames.csv`.

    Args:
        path: The file.
        problems: Where what is wrong is appended; such frames are left out.

    Raises:
        FormatError: It cannot be read at all, or has another header.
    """
    blocks = list(read_frame_blocks(path, problems))
    if not blocks:
        nothing = np.zeros(0, dtype=np.int64)
        return _build(np.zeros((0, len(_NUMBERS))), (), nothing, nothing)
    if len(blocks) == 1:
        return blocks[0]
    return join_frames(blocks)


def join_frames(parts: list[Frames]) -> Frames:
    """One after the other."""
    columns = {
        field.name: [getattr(part, field.name) for part in parts] for field in fields(Frames)
    }
    return Frames(
        np.concatenate(columns["timestamp_s"]),
        tuple(name for names in columns["image"] for name in names),
        np.concatenate(columns["tracking"]),
        Rigid3(*map(np.concatenate, zip(*columns["vio_from_cam"], strict=True))),
        Intrinsics(*map(np.concatenate, zip(*columns["intrinsics"], strict=True))),
        np.concatenate(columns["lines"]),
    )


def read_frame_blocks(path: Path, problems: list[Problem]) -> Iterator[Frames]:
    """As `read_frames`, some thousand frames at a time, so that memory does not grow.

    Images that come twice are not looked for.
    """
    latest_s = -np.inf
    for block in read_blocks(path, HEADER, problems):
        block, values = finite_numbers(block, _NUMBERS, problems)
        labels = [row[_TRACKING] for row in block.fields]
        tracking = np.array([_TRACKING_OF_LABEL.get(label, 255) for label in labels])
        found = find_row_problems(block, values, tracking, latest_s)
        bad = np.zeros(len(values), dtype=bool)
        for row, text in found:
            problems.append(Problem(path, block.lines[row], text))
            bad[row] = True
        kept = np.flatnonzero(~bad)
        if not len(kept):
            continue
        latest_s = values[kept[-1], 0]
        names = tuple(block.fields[row][_IMAGE] for row in kept)
        yield _build(values[kept], names, tracking[kept], np.array(block.lines)[kept])


def _build(
    values: NDArray[np.float64],
    names: tuple[str, ...],
    tracking: NDArray[np.integer],
    lines: NDArray[np.int64],
) -> Frames:
    return Frames(
        values[:, 0].copy(),
        names,
        tracking.astype(np.uint8),
        Rigid3(values[:, 1:4].copy(), values[:, 4:8].copy()),
        Intrinsics(*values[:, 8:].T.copy()),
        lines,
    )


def find_row_problems(
    block: Rows, values: NDArray[np.float64], tracking: NDArray[np.integer], latest_s: float
) -> list[tuple[int, str]]:
    """Find the rows of a block that cannot be frames, with at most one problem a row.

    Args:
        block: Rows of `frames.csv` as text.
        values: Their numbers, shape (n, 14), NaN where a field is empty.
        tracking: Values of `Tracking`, shape (n,); 255 for other words.
        latest_s: The last good timestamp before the block.

    Returns:
        Rows and problems, in order.
    """
    found: dict[int, str] = {}

    def report(bad: Any, text: str) -> None:
        for row in np.flatnonzero(bad):
            found.setdefault(int(row), text)

    times, poses, cameras = values[:, 0], values[:, 1:8], values[:, 8:]
    report(np.isnan(times), "expected a timestamp in seconds, got none")
    report(np.abs(times) > MAX_TIME_S, "expected a timestamp in seconds, got a larger unit")
    report(tracking == 255, f"expected tracking to be one of {', '.join(_TRACKING_OF_LABEL)}")
    has_some, has_all = np.isfinite(poses).any(axis=1), np.isfinite(poses).all(axis=1)
    is_lost = tracking == Tracking.LOST
    report(has_some & ~has_all, "expected all of x_m,y_m,z_m,qx,qy,qz,qw or none of them")
    report(~has_all & ~is_lost, "expected a pose, as tracking is not lost, got none")
    report(has_all & is_lost, "expected no pose, as tracking is lost, got one")
    report((np.abs(poses[:, :3]) > MAX_DISTANCE_M).any(axis=1), "expected a position in metres")
    norms = np.sqrt(np.square(np.clip(poses[:, 3:], -1e6, 1e6)).sum(axis=1))
    report(np.abs(norms - 1) > UNIT_TOLERANCE, "expected a unit quaternion qx,qy,qz,qw")
    size, focal = cameras[:, :2], cameras[:, 2:4]
    is_partial = np.isfinite(size).any(axis=1) & ~np.isfinite(size).all(axis=1)
    is_partial |= np.isfinite(cameras[:, 2:]).any(axis=1) & ~np.isfinite(cameras[:, 2:]).all(axis=1)
    report(is_partial, "expected width,height and fx,fy,cx,cy, each all or none")
    with np.errstate(invalid="ignore"):
        is_odd_size = (size <= 0).any(axis=1) | (size != np.round(size)).any(axis=1)
        report(is_odd_size & np.isfinite(size).all(axis=1), "expected width,height above 0, whole")
        report((focal <= 0).any(axis=1), "expected focal lengths fx,fy above 0, pixels")
    names = [row[_IMAGE] for row in block.fields]
    is_odd = [find_name_problem(name) is not None for name in names]
    report(np.array(is_odd, dtype=bool), "expected a plain file name in images/, or none")
    # Last, as a row need only be later than the good ones before it.
    usable = np.array([row not in found for row in range(len(times))], dtype=bool)
    seen = np.maximum.accumulate(np.concatenate([[latest_s], np.where(usable, times, -np.inf)]))
    for row in np.flatnonzero(usable & (times <= seen[:-1])):
        found[int(row)] = (
            f"expected a timestamp later than the one before ({seen[row]:.6f} s), "
            f"got {times[row]:.6f} s"
        )
    return sorted(found.items())


def find_name_problem(name: str) -> str | None:
    """What keeps a name from being that of an image; "" is none and is fine."""
    if not name:
        return None
    if re.search(r'[/\\,"\x00-\x1f�]', name) or name != name.strip() or name.startswith("."):
        return f'expected a plain file name without / \\ , " and spaces at its ends, got {name!r}'
    return None
