"""Images on disk: their size and whether they are whole, from a few bytes; and writing them."""

from __future__ import annotations

import io
import os
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import (
    AlreadyExistsError,
    FileMissingError,
    FormatError,
    ParameterError,
    UnreadableError,
    UnwritableError,
)
from vioapr.files.append_table import write_all

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")

MAX_MEGAPIXELS = 400.0
"""The largest image that is decoded: its pixels take 1.2 GB."""

JPEG_QUALITY = 92
"""Of images that are given as arrays; few features are lost and a frame stays small."""

_PNG_MAGIC, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_SHORT, _TWO_SHORTS = struct.Struct(">H"), struct.Struct(">HH")
_JPEG_MAGIC = b"\xff\xd8"
_HEAD_BYTES, _LONG_HEAD_BYTES, _TAIL_BYTES = 4096, 1 << 18, 64
# Start-of-frame markers: C0 to CF but the tables DHT, JPG and DAC.
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


class ImageProbe(NamedTuple):
    """Size and wholeness of an image, from a few of its bytes.

    Attributes:
        width: Pixels, 0 if not known.
        height: Pixels, 0 if not known.
        problem: What was expected and found, or None if it is whole.
    """

    width: int
    height: int
    problem: str | None


def probe_image(path: Path | str) -> ImageProbe:
    """Probe a JPEG or PNG by its head and its end, without decoding it.

    A hundred times faster than decoding, and finds what crashes leave: empty, truncated and
    foreign files.
    """
    # Plain system calls: a scene has a hundred thousand images.
    try:
        file = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return ImageProbe(0, 0, "expected an image, found no file of this name")
    except OSError as error:
        return ImageProbe(0, 0, f"cannot be read: {error.strerror}")
    try:
        head = os.read(file, _HEAD_BYTES)
        if len(head) < _HEAD_BYTES:
            return probe_bytes(head)
        # Phones put a thumbnail of many kilobytes before the size.
        if head.startswith(_JPEG_MAGIC) and not _jpeg_size(head)[0]:
            head += os.read(file, _LONG_HEAD_BYTES)
        os.lseek(file, -_TAIL_BYTES, os.SEEK_END)
        return _probe(head, os.read(file, _TAIL_BYTES))
    except OSError as error:
        return ImageProbe(0, 0, f"cannot be read: {error.strerror}")
    finally:
        os.close(file)


def find_image_problem(path: Path) -> str | None:
    """Find a problem of an image by its head and its end, or None."""
    return probe_image(path).problem


def probe_bytes(content: bytes) -> ImageProbe:
    """Probe an image in memory; see `probe_image`."""
    return _probe(content, content[-_TAIL_BYTES:])


def _probe(head: bytes, tail: bytes) -> ImageProbe:
    if not head:
        return ImageProbe(0, 0, "expected an image, got an empty file")
    if head.startswith(_PNG_MAGIC):
        width, height = (int.from_bytes(head[i : i + 4], "big") for i in (16, 20))
        is_whole = _PNG_END in tail
    elif head.startswith(_JPEG_MAGIC):
        width, height = _jpeg_size(head)
        # Some cameras pad the end with zeros.
        is_whole = tail.rstrip(b"\0\r\n").endswith(b"\xff\xd9")
    else:
        return ImageProbe(0, 0, "expected a JPEG or PNG image, got something else")
    if not width or not height:
        return ImageProbe(0, 0, "expected an image, got one without size: is it truncated?")
    return ImageProbe(width, height, None if is_whole else "truncated: the image's end is missing")


def _jpeg_size(head: bytes) -> tuple[int, int]:
    """Width and height in a JPEG's frame header; 0, 0 if the bytes end before it."""
    at = 2
    while at + 9 <= len(head) and head[at] == 0xFF:
        marker = head[at + 1]
        if marker == 0xFF:
            at += 1  # fill bytes are allowed between segments
        elif marker in _JPEG_FRAMES:
            height, width = _TWO_SHORTS.unpack_from(head, at + 5)
            return width, height
        else:
            at += 2 + _SHORT.unpack_from(head, at + 2)[0]
    return 0, 0


def decode_problem(path: Path) -> str | None:
    """Decode an image whole and find its problem, or None; slow."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        return f"cannot be decoded: {error}"
    return None


def read_rgb(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """Decode an image, as the sensor gave it: not turned upright.

    Args:
        path: The file.
        size: Width and height to resize to, whatever the image's shape, or None. Bilinear with
            antialiasing: a triangle filter over the source's pixels.

    Returns:
        RGB, shape (height, width, 3).

    Raises:
        FileMissingError: It is missing.
        FormatError: It is broken.
    """
    from PIL import Image

    try:
        with Image.open(path) as image:
            pixels = image.convert("RGB")
            if size is not None:
                pixels = pixels.resize(size, Image.Resampling.BILINEAR)
            return np.asarray(pixels)
    except FileNotFoundError:
        raise FileMissingError(path, "expected an image, found no file of this name") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        problem = (
            f"expected an image that can be decoded: {error}; "
            f"vioapr scene check --decode finds all such images of a scene"
        )
        raise FormatError(path, problem) from None


def encode_image(name: str, pixels: NDArray[np.uint8]) -> bytes:
    """Pixels as JPEG or, under a name ending in .png, as PNG.

    Args:
        name: The file's name.
        pixels: Shape (height, width, 3) RGB or (height, width) grey.

    Raises:
        ParameterError: Another shape or type.
    """
    from PIL import Image

    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3) or pixels.shape[2:] not in ((), (3,)):
        raise ParameterError(
            f"expected an image of shape (height, width, 3) or (height, width) and type uint8, "
            f"got {pixels.shape} {pixels.dtype}"
        )
    buffer = io.BytesIO()
    is_png = name.lower().endswith(".png")
    options = {"compress_level": 3} if is_png else {"quality": JPEG_QUALITY}
    Image.fromarray(pixels).save(buffer, format="png" if is_png else "jpeg", **options)
    return buffer.getvalue()


def copy_image(source: Path | str, target: Path | str, *, link: bool) -> None:
    """Copy an image, or hard-link it where that is asked for and possible.

    Raises:
        FileMissingError: The source is missing.
        UnreadableError: The source cannot be read.
        AlreadyExistsError: The target exists.
        UnwritableError: The target cannot be written.
    """
    if link:
        try:
            os.link(source, target)
            return
        except OSError:
            pass  # another file system, or one without links
    try:
        write_image(target, Path(source).read_bytes())
    except FileNotFoundError:
        raise FileMissingError(source, "expected an image, found no file of this name") from None
    except OSError as error:
        raise UnreadableError.of(source, error) from None


def write_image(path: Path | str, content: bytes) -> None:
    """Write an image whole, or, if the disk is full, not at all.

    Raises:
        AlreadyExistsError: It exists.
        UnwritableError: It cannot be written.
    """
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        raise AlreadyExistsError(path, "expected to write a new image, but it exists") from None
    except OSError as error:
        raise UnwritableError.of(path, error) from None
    try:
        write_all(file, content)
    except OSError as error:
        Path(path).unlink(missing_ok=True)
        raise UnwritableError.of(path, error) from None
    finally:
        os.close(file)
