"""Pictures as recordings hold them: 8 bits of grey or colour, with pixels as the sensor gave them.

What else people have is converted, and counted, so that nothing is read wrongly later.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.files.image_headers import (
    JPEG_MAGIC,
    TRUNCATED,
    ImageProbe,
    cut_after_jpeg,
    without_orientation,
)
from vioapr.files.images import encode_image, open_image, probe_bytes, probe_image
from vioapr.importers.base import DEFAULT_MAX_MEGAPIXELS, Image, Walk

NO_FILE = "no file of this name"

_Size = tuple[int, int]

_SAMPLES = 16
_BITS = (8, 9, 10, 12, 14, 16)
# Thermal cameras use a narrow window far from 0.
_NARROW = 0.25
_DARK_8_BIT = 31
# What undoes the orientations that exchange width and height.
_TURNS = {5: "TRANSPOSE", 6: "ROTATE_270", 7: "TRANSVERSE", 8: "ROTATE_90"}


class Picture(NamedTuple):
    """An image to be written.

    Attributes:
        image: A path, bytes or pixels; None if it cannot be used, or there is none.
        size: Width and height, pixels, of what is written; None without an image.
        problem: What is wrong with it, or None.
    """

    image: Image
    size: _Size | None = None
    problem: str | None = None


class GreyRange(NamedTuple):
    """The values of 16-bit images that become black and white.

    Attributes:
        black: Becomes 0.
        white: Becomes 255.
        lowest: The lowest value found.
        highest: The highest value found.
    """

    black: int
    white: int
    lowest: int
    highest: int


class PictureReader:
    """Makes a walk's images such as recordings hold, one at a time, and says what it did."""

    def __init__(
        self,
        images: Sequence[Image] = (),
        *,
        link: bool = False,
        max_megapixels: float = DEFAULT_MAX_MEGAPIXELS,
    ) -> None:
        """Begin.

        Args:
            images: Those of the walk, where they are at hand: the range of 16-bit ones is found
                from some of all.
            link: Leave a path a path where nothing is to be done.
            max_megapixels: The largest image to take.
        """
        self._images = images
        self._link = link
        self._max_megapixels = max_megapixels
        self._range: GreyRange | None = None
        self._clipped = 0
        self._done: Counter[str] = Counter()

    def read(self, image: Image, said: _Size | None = None) -> Picture:
        """Read an image, and convert what a recording does not hold.

        Args:
            image: In any form.
            said: Width and height that the source's intrinsics are of.
        """
        if image is None:
            return Picture(None)
        if isinstance(image, np.ndarray):
            return Picture(image, (image.shape[1], image.shape[0]))
        if isinstance(image, bytes):
            return self._convert(image, probe_bytes(image), said)
        if self._link:
            probe = probe_image(image)
            if not probe.problem and not _is_odd(probe) and not self._is_turned(probe, said):
                if probe.orientation != 1:
                    self._done["have an EXIF orientation, which does not count"] += 1
                return self._checked(image, probe)
        try:
            content = Path(image).read_bytes()
        except FileNotFoundError:
            return Picture(None, None, NO_FILE)
        except OSError as error:
            return Picture(None, None, f"cannot be read: {error.strerror}")
        return self._convert(content, probe_bytes(content), said)

    def _convert(self, content: bytes, probe: ImageProbe, said: _Size | None) -> Picture:
        """Convert an image in memory where that is needed."""
        if probe.problem == TRUNCATED and content.startswith(JPEG_MAGIC):
            whole = cut_after_jpeg(content)
            if whole is not None:
                self._done["have other data after their end, which was cut off"] += 1
                content, probe = whole, probe_bytes(whole)
        picture = self._checked(content, probe)
        if picture.problem:
            return picture
        is_turned = self._is_turned(probe, said)
        if not _is_odd(probe) and not is_turned:
            if probe.orientation != 1:
                self._done["have an EXIF orientation: pixels are kept as the sensor gave them"] += 1
                if content.startswith(JPEG_MAGIC):
                    content = without_orientation(content)
            return Picture(content, picture.size)
        try:
            pixels = self._decode(content, probe, is_turned)
        except (OSError, SyntaxError, ValueError) as error:
            return Picture(None, None, f"cannot be decoded: {error}")
        if pixels is None:
            return Picture(content, picture.size)
        suffix = ".jpg" if content.startswith(JPEG_MAGIC) else ".png"
        encoded = encode_image(suffix, pixels)
        return Picture(encoded, (pixels.shape[1], pixels.shape[0]))

    def _checked(self, image: Image, probe: ImageProbe) -> Picture:
        """An image with its size, unless it is broken or too large."""
        if probe.problem:
            return Picture(None, None, probe.problem)
        if probe.megapixels > self._max_megapixels:
            problem = (
                f"{probe.megapixels:.3g} megapixels, and images up to {self._max_megapixels:g} are "
                "imported: scale it down, or raise `max_megapixels`"
            )
            return Picture(None, None, problem)
        return Picture(image, (probe.width, probe.height))

    def _is_turned(self, probe: ImageProbe, said: _Size | None) -> bool:
        """Whether the source's intrinsics are of the image as a viewer turns it, not as stored."""
        if said is None or probe.orientation not in _TURNS:
            return False
        stored, turned = probe.width / probe.height, probe.height / probe.width
        ratio = said[0] / said[1]
        return abs(turned / ratio - 1) < abs(stored / ratio - 1)

    def _decode(
        self, content: bytes, probe: ImageProbe, is_turned: bool
    ) -> NDArray[np.uint8] | None:
        """Pixels of an image that is to be converted; None if it may stay as it is.

        Raises:
            ValueError: Its values cannot be told, or it is broken; also OSError and SyntaxError.
        """
        from PIL.Image import Image as PillowImage
        from PIL.Image import Transpose

        with open_image(content) as opened:
            opened.load()
            image: PillowImage = opened
            if is_turned:
                self._done["were turned as their EXIF orientation says, to fit the intrinsics"] += 1
                image = opened.transpose(Transpose[_TURNS[probe.orientation]])
            if image.mode[0] == "I":
                return self._to_8_bits(np.asarray(image).astype(np.int64))
            if probe.bits > 8:
                pixels = np.asarray(image.convert("RGB"))
                if pixels.max() <= _DARK_8_BIT:
                    raise ValueError("its 16 bits are hardly used: convert it to 8 bits first")
                self._done["have 16 bits a channel: the upper 8 were kept"] += 1
                return pixels
            if "A" in image.getbands() or "transparency" in image.info:
                layered = image.convert("RGBA")
                alpha = np.asarray(layered)[..., 3:]
                if alpha.min() == 255 and probe.channels != "palette":
                    return None if not is_turned else np.asarray(layered)[..., :3]
                self._done["are partly transparent: there they became black"] += 1
                mixed = np.asarray(layered)[..., :3].astype(np.uint16) * alpha // 255
                return mixed.astype(np.uint8)
            if probe.channels in ("cmyk", "palette"):
                name = "CMYK" if probe.channels == "cmyk" else "palette"
                self._done[f"were {name} images, and became RGB"] += 1
            is_grey = image.mode in ("1", "L")
            return np.asarray(image.convert("L" if is_grey else "RGB"))

    def _to_8_bits(self, values: NDArray[np.int64]) -> NDArray[np.uint8]:
        if self._range is None:
            self._range = find_range([values, *self._sample()])
        black, white = self._range.black, self._range.white
        self._clipped += bool((values > white).any() or (values < black).any())
        self._done[_DEEP_GREY] += 1
        scaled = (values - black) * (255.0 / max(white - black, 1))
        return np.clip(np.round(scaled), 0, 255).astype(np.uint8)

    def _sample(self) -> list[NDArray[np.int64]]:
        """The values of some 16-bit images of the walk, evenly chosen."""
        rows = np.unique(np.linspace(0, max(len(self._images) - 1, 0), _SAMPLES).astype(int))
        found: list[NDArray[np.int64]] = []
        for row in rows.tolist() if self._images else ():
            image = self._images[row]
            if not isinstance(image, Path | str):
                continue
            probe = probe_image(image)
            if probe.problem or probe.bits <= 8 or probe.megapixels > self._max_megapixels:
                continue
            try:
                with open_image(image) as opened:
                    if opened.mode[0] == "I":
                        found.append(np.asarray(opened).astype(np.int64))
            except (OSError, SyntaxError, ValueError):
                continue  # it is looked at again, and then counted as broken
        return found

    def say(self, walk: Walk) -> None:
        """Add findings on what was done."""
        for text, count in self._done.items():
            if text != _DEEP_GREY:
                walk.note(f"images: {count} {text}")
        if self._range is not None:
            black, white, lowest, highest = self._range
            walk.note(
                f"images: {self._done[_DEEP_GREY]} are 16-bit grey with values from {lowest} to "
                f"{highest}: {black} to {white} became 0 to 255"
            )
            if self._clipped:
                walk.warn(
                    f"images: {self._clipped} 16-bit ones hold values beyond {black} to {white}, "
                    "which were clipped"
                )


_DEEP_GREY = "16-bit grey"


def _is_odd(probe: ImageProbe) -> bool:
    """Whether an image is of a kind that may have to be converted."""
    return probe.bits != 8 or probe.channels not in ("grey", "rgb")


def find_range(samples: Sequence[NDArray[np.int64]]) -> GreyRange:
    """Find which values of 16-bit images are to become black and white, the same for all images.

    Cameras of 10, 12 or 14 bits fill the lower bits of 16, so white is the largest value of as
    few bits as hold all; and black is 0, but for thermal cameras, whose values fill a narrow
    window.

    Args:
        samples: The values of some images.
    """
    lowest = min(int(values.min()) for values in samples)
    highest = max(int(values.max()) for values in samples)
    if highest - lowest < _NARROW * highest and lowest > 0:
        return GreyRange(lowest, max(highest, lowest + 1), lowest, highest)
    white = next(2**bits - 1 for bits in _BITS if highest < 2**bits)
    return GreyRange(0, white, lowest, highest)
