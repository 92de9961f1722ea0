"""Which image each pose of a trajectory is of: by names, by times, or by order."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.importers.base import is_image_name
from vioapr.importers.reading import Reading
from vioapr.plurals import count_of
from vioapr.trajectory import Trajectory, nearest_rows


class ImageFiles(NamedTuple):
    """Images of a walk.

    Attributes:
        folder: In which they are.
        names: Of the images, as paths below the folder, in natural order.
        others: Images of other kinds beside them, for people; "" if there are none.
    """

    folder: Path
    names: list[str]
    others: str


class Track(NamedTuple):
    """A trajectory of the walk.

    Attributes:
        path: The file.
        reading: As it was read.
        format: The name of its format.
    """

    path: Path
    reading: Reading
    format: str

    @property
    def track(self) -> Trajectory:
        """The poses."""
        return self.reading.trajectory

    def rows_in_file(self) -> tuple[NDArray[np.intp], NDArray[np.float64]] | None:
        """Which row of the file each pose is, and the times of all rows, repeated ones apart.

        None where rows were left out whose place is not known.
        """
        left_out = self.reading.left_out
        if self.track.is_timed:
            others = [row.timestamp_s for row in left_out if row.timestamp_s is not None]
            if len(others) < len(left_out):
                return None
            times = np.unique(np.array([*self.track.timestamp_s.tolist(), *others]))
            return np.searchsorted(times, self.track.timestamp_s), times
        count = len(self.track) + len(left_out)
        lines = {row.line for row in left_out}
        if lines and max(lines) > count:
            return None
        rows = [row for row in range(count) if row + 1 not in lines]
        return np.array(rows, dtype=np.intp), np.arange(count, dtype=np.float64)


def last_of(name: str) -> str:
    """The last part of a path."""
    return name.rpartition("/")[2]


def stem_of(name: str) -> str:
    """A name without its ending."""
    return name.rsplit(".", 1)[0]


def pairs_by_name(images: list[str], track: Trajectory) -> list[tuple[int, int]]:
    """Rows of images and of poses that have one name, in the order of the images."""
    if track.names is None:
        return []
    row_of = rows_by_name(images)
    rows = [(find_row(row_of, name), of) for of, name in enumerate(track.names)]
    return sorted((row, of) for row, of in rows if row is not None)


def pair_images(
    found: ImageFiles, timestamp_s: NDArray[np.float64], of_walk: Track
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which image each pose is of: rows of images, rows of the track.

    By names, else by times (mutually nearest, within half a frame), else by order. Names of a
    trajectory with times are not needed: its images may have been renamed.

    Raises:
        FormatError: No pose is of an image.
    """
    track, images = of_walk.track, found.names
    pairs = pairs_by_name(images, track)
    if not pairs and track.is_timed:
        step_s = float(np.median(np.diff(timestamp_s))) if len(timestamp_s) > 1 else 0.1
        nearest = nearest_rows(timestamp_s, track.timestamp_s)
        back = nearest_rows(track.timestamp_s, timestamp_s)
        off_s = np.abs(timestamp_s - track.timestamp_s[nearest])
        pairs = [
            (row, int(of))
            for row, of in enumerate(nearest)
            if back[of] == row and off_s[row] <= 0.5 * step_s
        ]
    elif (
        not pairs
        and track.names is None
        and (placed := of_walk.rows_in_file()) is not None
        and len(placed[1]) == len(images)
    ):
        pairs = [(int(row), of) for of, row in enumerate(placed[0])]
    if not pairs:
        what = "timestamps" if track.is_timed else "names" if track.names else "number of poses"
        raise FormatError(
            of_walk.path, f"expected {what} that fit the {count_of(len(images), 'image')} of "
            f"{found.folder}, as {images[0]}, got none that do"
        )  # fmt: skip
    rows, of = np.array(pairs, dtype=np.intp).T
    return rows, of


def rows_by_name(images: list[str]) -> dict[str, int | None]:
    """Rows of images by every end of their paths, with and without ending; None if of several."""
    row_of: dict[str, int | None] = {}
    for row, image in enumerate(images):
        parts = image.split("/")
        for first in range(len(parts)):
            end = "/".join(parts[first:])
            for name in (end, stem_of(end)):
                row_of[name] = row if name not in row_of or row_of[name] == row else None
    return row_of


def find_row(row_of: dict[str, int | None], name: str) -> int | None:
    """The image of a name: by the longest end of its path that any image has."""
    parts = name.replace("\\", "/").split("/")
    for first in range(len(parts)):
        end = "/".join(parts[first:])
        if end in row_of:
            return row_of[end]
        if stem_of(end) in row_of and is_image_name(end):
            return row_of[stem_of(end)]
    return None
