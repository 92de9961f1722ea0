"""Images on disk: their size and whether they are whole, from a few bytes; and writing them."""

from __future__ import annotations

import io
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

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
from vioapr.files.image_headers import (
    JPEG_MAGIC,
    PNG_MAGIC,
    ImageProbe,
    jpeg_header,
    probe_ends,
)

if TYPE_CHECKING:
    from PIL import ImageFile

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")

JPEG_QUALITY = 92
"""Of images that are given as arrays; few features are lost and a frame stays small."""

_HEAD_BYTES, _LONG_HEAD_BYTES, _TAIL_BYTES = 4096, 1 << 18, 64


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
        if head.startswith(JPEG_MAGIC) and not jpeg_header(head).width:
            head += os.read(file, _LONG_HEAD_BYTES)
        os.lseek(file, -_TAIL_BYTES, os.SEEK_END)
        return probe_ends(head, os.read(file, _TAIL_BYTES))
    except OSError as error:
        return ImageProbe(0, 0, f"cannot be read: {error.strerror}")
    finally:
        os.close(file)


def probe_bytes(content: bytes) -> ImageProbe:
    """Probe an image in memory; see `probe_image`."""
    return probe_ends(content, content[-_TAIL_BYTES:])


@contextmanager
def open_image(source: Path | str | bytes) -> Generator[ImageFile.ImageFile, None, None]:
    """Open a JPEG or PNG for decoding, however large: who calls looks at its size first.

    Args:
        source: A file, or its bytes.

    Raises:
        OSError: It cannot be read or decoded; also ValueError and SyntaxError.
    """
    from PIL import JpegImagePlugin, PngImagePlugin

    with io.BytesIO(source) if isinstance(source, bytes) else Path(source).open("rb") as file:
        is_png = file.read(8) == PNG_MAGIC
        file.seek(0)
        # Not Image.open: its limit of pixels is one for the whole process.
        kind = PngImagePlugin.PngImageFile if is_png else JpegImagePlugin.JpegImageFile
        try:
            image = kind(file)
        except UserWarning as warning:  # of broken metadata, where warnings are errors
            raise OSError(str(warning)) from None
        with image:
            yield image


def decode_problem(path: Path) -> str | None:
    """Decode an image whole and find its problem, or None; slow."""
    try:
        with open_image(path) as image:
            image.load()
    except (OSError, SyntaxError, ValueError) as error:
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
        FormatError: It is broken, has 16 bits a channel, or more than `MAX_MEGAPIXELS`.
    """
    from PIL.Image import Resampling

    with _decoding(path) as image:
        pixels = image.convert("RGB")
        if size is not None:
            pixels = pixels.resize(size, Resampling.BILINEAR)
        return np.asarray(pixels)


class GreyImage(NamedTuple):
    """A decoded image that may have been scaled down.

    Attributes:
        pixels: Shape (height, width).
        scale: Pixels of the file by pixels of these, along x and y, shape (2,).
    """

    pixels: NDArray[np.uint8]
    scale: NDArray[np.float64]


def read_grey(path: Path, longest_px: int) -> GreyImage:
    """Decode an image as grey, as the sensor gave it: not turned upright.

    Args:
        path: The file.
        longest_px: It is scaled down if its longer side has more pixels.

    Raises:
        FileMissingError: It is missing.
        FormatError: It is broken, has 16 bits a channel, or more than `MAX_MEGAPIXELS`.
    """
    from PIL.Image import Resampling

    with _decoding(path) as image:
        whole = np.array(image.size)
        shrunk = np.maximum(np.rint(whole * min(longest_px / whole.max(), 1.0)).astype(int), 1)
        size = (int(shrunk[0]), int(shrunk[1]))
        image.draft("L", size)  # a JPEG is decoded at no more than it takes
        grey = image.convert("L")
        if grey.size != size:
            grey = grey.resize(size, Resampling.BILINEAR)
        return GreyImage(np.asarray(grey), whole / shrunk)


@contextmanager
def _decoding(path: Path) -> Generator[ImageFile.ImageFile, None, None]:
    """Open an image that may be decoded; what is wrong with it comes as an error of ours."""
    try:
        with open_image(path) as image:
            probe = ImageProbe(*image.size, None, 16 if _is_deep(image) else 8)
            if probe.obstacle:
                raise FormatError(path, probe.obstacle)
            yield image
    except FileNotFoundError:
        raise FileMissingError(path, "expected an image, found no file of this name") from None
    except (OSError, SyntaxError, ValueError) as error:
        problem = (
            f"expected an image that can be decoded: {error}; "
            f"vioapr scene check --decode finds all such images of a scene"
        )
        raise FormatError(path, problem) from None


def _is_deep(image: ImageFile.ImageFile) -> bool:
    """Whether a PNG that was opened has 16 bits a channel; some are given with 8 of them."""
    return image.mode[0] in "IF" or any(";16" in str(tile) for tile in image.tile)


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
            # A link to a link would lead elsewhere from the new folder.
            os.link(os.path.realpath(source), target)
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
