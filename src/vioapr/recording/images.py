"""Images on disk: their size and whether they are whole, from a few bytes; and writing them."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")

JPEG_QUALITY = 92
"""Of images that are given as arrays; few features are lost and a frame stays small."""

_PNG_MAGIC, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_JPEG_HEAD_BYTES, _TAIL_BYTES = 65536, 64
# Start-of-frame markers: C0 to CF but the tables DHT, JPG and DAC.
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


class ImageProbe(NamedTuple):
    """What a few bytes of an image tell.

    Attributes:
        width: Pixels, 0 if not known.
        height: Pixels, 0 if not known.
        problem: What is wrong with it, or None.
    """

    width: int
    height: int
    problem: str | None


def probe_image(path: Path) -> ImageProbe:
    """Size and wholeness of a JPEG or PNG by its head and its end; it is not decoded.

    A hundred times faster than decoding, and finds what crashes leave: empty, truncated and
    foreign files.
    """
    try:
        with path.open("rb") as file:
            head = file.read(4096)
            size = os.fstat(file.fileno()).st_size
            # Phones put a thumbnail of many kilobytes before the size.
            if head.startswith(b"\xff\xd8") and size > len(head) and not _jpeg_size(head)[0]:
                head += file.read(_JPEG_HEAD_BYTES * 4)
            file.seek(max(size - _TAIL_BYTES, 0))
            return _probe(head, file.read(_TAIL_BYTES))
    except FileNotFoundError:
        return ImageProbe(0, 0, "expected an image, found no file of this name")
    except OSError as error:
        return ImageProbe(0, 0, f"cannot be read: {error.strerror}")


def find_image_problem(path: Path) -> str | None:
    """What is wrong with an image, by its head and its end, or None."""
    return probe_image(path).problem


def probe_bytes(content: bytes) -> ImageProbe:
    """As `probe_image`, of an image in memory."""
    return _probe(content, content[-_TAIL_BYTES:])


def _probe(head: bytes, tail: bytes) -> ImageProbe:
    if not head:
        return ImageProbe(0, 0, "expected an image, got an empty file")
    if head.startswith(_PNG_MAGIC):
        width, height = (int.from_bytes(head[i : i + 4], "big") for i in (16, 20))
        is_whole = _PNG_END in tail
    elif head.startswith(b"\xff\xd8"):
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
            height, width = (int.from_bytes(head[i : i + 2], "big") for i in (at + 5, at + 7))
            return width, height
        else:
            at += 2 + int.from_bytes(head[at + 2 : at + 4], "big")
    return 0, 0


def decode_problem(path: Path) -> str | None:
    """What is wrong with an image that is decoded whole, or None; slow."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        return f"cannot be decoded: {error}"
    return None


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


def copy_image(source: Path, target: Path, *, link: bool) -> None:
    """Copy an image, or hard-link it where that is asked for and possible.

    Raises:
        FormatError: It cannot be written.
    """
    try:
        if link:
            try:
                os.link(source, target)
                return
            except OSError:
                pass  # another file system, or one without links
        write_image(target, source.read_bytes())
    except FileNotFoundError:
        raise FormatError(source, "expected an image, found no file of this name") from None
    except OSError as error:
        raise FormatError(source, f"cannot be read: {error.strerror}") from None


def write_image(path: Path, content: bytes) -> None:
    """Write an image whole, or, if the disk is full, not at all.

    Raises:
        FormatError: It cannot be written.
    """
    try:
        with path.open("xb", buffering=0) as file:
            written = 0
            while written < len(content):
                written += file.write(content[written:]) or 0
    except FileExistsError:
        raise FormatError(path, "expected to write a new image, but it exists") from None
    except OSError as error:
        path.unlink(missing_ok=True)
        raise FormatError(path, f"cannot be written: {error.strerror}") from None
