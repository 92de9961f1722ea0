"""Fitting cameras to the images as they are: their size, their middle, and what cannot be."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from vioapr.importers.base import Walk
from vioapr.importers.diagnostics import MAX_NAMED
from vioapr.plurals import count_of
from vioapr.scene.frames import Intrinsics

_Size = tuple[int, int]

_SCALES = (1.25, 4 / 3, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)

# A principal point is near the middle, so cameras without size show theirs by it: within some
# per cent, where images were scaled by a common factor.
_NEAR, _ROUNDING = 0.16, 0.05
_MOST_PIXELS = 1e6
_FACTORS = (*_SCALES, *(1 / scale for scale in _SCALES))


class CameraFitter:
    """Fits the cameras of a walk, a block of frames at a time, and says what it did.

    A camera that is said to be of images of another size but the same shape is rescaled. Pixels
    are counted from the edge of the first one, so that all of fx, fy, cx and cy grow with the
    size. Of another shape, it cannot be known what was cut off: the camera is left out.
    """

    def __init__(self, focal_px: float | None = None) -> None:
        """Begin.

        Args:
            focal_px: Of the images as they are, pixels, in place of what is said.
        """
        self.focal_px = focal_px
        self.sizes: Counter[_Size] = Counter()
        self.known = 0
        self._rescaled: Counter[tuple[_Size, _Size]] = Counter()
        self._other_shape: Counter[tuple[_Size, _Size]] = Counter()
        self._off_centre: Counter[tuple[_Size, _Size]] = Counter()
        self._centred = 0

    def fit(self, said: Intrinsics, measured: NDArray[np.float64]) -> Intrinsics:
        """Fit some frames' cameras.

        Args:
            said: By the source, shapes (n,).
            measured: Widths and heights of the images, shape (2, n), pixels; NaN where a frame
                has none.
        """
        table = np.array([np.asarray(column, dtype=np.float64) for column in said])
        if self.focal_px is not None:
            table[:2], table[2:4], table[4:] = measured, self.focal_px, np.nan
        for column in range(table.shape[1]):
            if np.isfinite(measured[0, column]):
                size = int(measured[0, column]), int(measured[1, column])
                self.sizes[size] += 1
                table[:, column] = self._fit_one(table[:, column], size)
        is_open = np.isfinite(table[:4]).all(axis=0) & np.isnan(table[4:]).any(axis=0)
        table[4:, is_open] = table[:2, is_open] / 2
        self._centred += int(is_open.sum())
        # A camera that is known in part cannot be used.
        table[2:, np.isnan(table[2:]).any(axis=0)] = np.nan
        self.known += int(np.isfinite(table[2]).sum())
        return Intrinsics(*table)

    def _fit_one(self, camera: NDArray[np.float64], size: _Size) -> NDArray[np.float64]:
        """Fit one camera, shape (6,), to an image's width and height."""
        pinhole = camera[2:]
        said = _size_of(camera)
        if said is None:
            said = self._size_by_middle(pinhole, size)
        if said is None or said == size:
            return np.array([*size, *pinhole])
        if not np.isfinite(pinhole[0]):
            return np.array([*size, *pinhole])
        if abs(size[0] / said[0] * said[1] - size[1]) > 1:
            self._other_shape[said, size] += 1
            return np.array([*size, *np.full(4, np.nan)])
        self._rescaled[said, size] += 1
        ratio = np.array(size) / np.array(said)
        return np.array([*size, *(pinhole * np.tile(ratio, 2))])

    def _size_by_middle(self, pinhole: NDArray[np.float64], size: _Size) -> _Size | None:
        """The size that a camera without one is of, if its middle is clearly not the image's."""
        ratio = 2 * pinhole[2:] / np.array(size)
        if not np.isfinite(ratio).all() or (np.abs(np.log(ratio.clip(1e-9))) < _NEAR).all():
            return None
        middle = max(round(2 * pinhole[2]), 1), max(round(2 * pinhole[3]), 1)
        if (np.abs(np.array(middle) / np.array(size[::-1]) - 1) < _NEAR).all():
            return middle  # of a turned image
        factor = min(_FACTORS, key=lambda factor: abs(np.log(ratio.clip(1e-9) / factor)).max())
        if (np.abs(ratio / factor - 1) < _ROUNDING).all():
            return round(size[0] * factor), round(size[1] * factor)
        self._off_centre[middle, size] += 1
        pinhole[:] = np.nan
        return None

    def say(self, walk: Walk) -> None:
        """Add findings on what was done, and on the images' sizes."""
        if self._rescaled:
            walk.note(
                f"intrinsics: they are of images of {_pairs(self._rescaled)}: rescaled to the "
                f"images' size ({count_of(self._rescaled.total(), 'frame')})"
            )
        if self._other_shape:
            is_turned = all(
                (said[0] > said[1]) != (found[0] > found[1]) for said, found in self._other_shape
            )
            why = (
                "the one is upright and the other is not, and which way it was turned is not known"
                if is_turned
                else "another shape, and what was cut off is not known"
            )
            walk.warn(
                f"intrinsics: they are of images of {_pairs(self._other_shape)}: {why}; those of "
                f"{count_of(self._other_shape.total(), 'frame')} are left out. "
                "Import the images as they were taken, or give `focal_px`"
            )
        if self._off_centre:
            walk.warn(
                f"intrinsics: their middle is that of images of {_pairs(self._off_centre)}: those "
                f"of {count_of(self._off_centre.total(), 'frame')} are left out; "
                "give `focal_px`"
            )
        if self.focal_px is not None:
            walk.note(f"intrinsics: focal length {self.focal_px:g} pixels, as you say")
        if self._centred:
            walk.note(
                f"intrinsics: the principal point of {count_of(self._centred, 'frame')} is taken "
                "to be the image's middle"
            )
        if self.sizes:
            found = ", ".join(_text(size) for size in sorted(self.sizes)[:MAX_NAMED])
            known = "known" if self.known else "not known"
            walk.note(f"images: {found} pixels; focal length {known}")


def sizes_of(cameras: Intrinsics) -> list[_Size | None]:
    """Widths and heights that cameras are of, None where nobody says."""
    sizes = np.stack([np.asarray(cameras.width), np.asarray(cameras.height)], axis=-1).tolist()
    return [None if width != width else (int(width), int(height)) for width, height in sizes]


def _size_of(camera: NDArray[np.float64]) -> _Size | None:
    width, height = camera[:2].tolist()
    return (int(width), int(height)) if np.isfinite(camera[:2]).all() else None


def _text(size: _Size) -> str:
    return f"{size[0]}x{size[1]}"


def _pairs(counts: Counter[tuple[_Size, _Size]]) -> str:
    """Name sizes that were said and found: 96x72, and the images are 48x36."""
    pairs = [f"{_text(said)}, and the images are {_text(found)}" for said, found in counts]
    return "; ".join(pairs[:MAX_NAMED]) + ("; ..." if len(pairs) > MAX_NAMED else "")


def drop_impossible_intrinsics(walk: Walk) -> None:
    """Mark cameras that cannot be as not known, and warn of them."""
    table = np.array([np.broadcast_to(column, len(walk)) for column in walk.intrinsics])
    size, pinhole = table[:2], table[2:]
    with np.errstate(invalid="ignore"):
        is_size = (size >= 1) & (size <= _MOST_PIXELS) & (size == np.round(size))
        is_odd_size = ~is_size.all(axis=0)
        is_odd = ~((pinhole[:2] > 0) & (pinhole[:2] <= _MOST_PIXELS)).all(axis=0)
        is_odd |= (np.abs(pinhole) > _MOST_PIXELS).any(axis=0)
    is_wrong = np.isfinite(size).any(axis=0) & is_odd_size
    is_wrong |= ~np.isnan(pinhole).all(axis=0) & is_odd
    if is_wrong.any():
        walk.warn(
            f"intrinsics: those of {count_of(is_wrong.sum(), 'frame')} are left out: "
            "sizes must be whole, "
            "focal lengths above 0"
        )
    table[:2, is_odd_size], table[2:, is_odd] = np.nan, np.nan
    walk.intrinsics = Intrinsics(*table)
