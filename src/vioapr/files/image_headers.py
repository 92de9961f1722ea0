"""What the first bytes of a JPEG or PNG say: size, kind, orientation, and where it ends."""

from __future__ import annotations

import struct
from typing import Literal, NamedTuple

MAX_MEGAPIXELS = 400.0
"""The largest image that is decoded: its pixels take 1.2 GB."""

DEEP = (
    "expected 8 bits a channel, got 16: import the images, which converts them "
    "(vioapr import images)"
)
"""The obstacle of images with 16 bits, whose range one image alone does not tell."""

Channels = Literal["grey", "grey-alpha", "palette", "rgb", "rgba", "cmyk"]

PNG_MAGIC, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_SHORT, _TWO_SHORTS = struct.Struct(">H"), struct.Struct(">HH")
JPEG_MAGIC, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
TRUNCATED = "truncated: the image's end is missing"
_PNG_CHANNELS: dict[int, Channels] = {
    0: "grey", 2: "rgb", 3: "palette", 4: "grey-alpha", 6: "rgba"
}  # fmt: skip
_JPEG_CHANNELS: dict[int, Channels] = {1: "grey", 3: "rgb", 4: "cmyk"}
_EXIF, _ORIENTATION_TAG = b"Exif\0\0", 0x0112
_HEIF_BRANDS = (b"heic", b"heix", b"mif1", b"msf1", b"hevc", b"avif", b"avis")
_OTHER_MAGIC = {
    b"RIFF": "WebP", b"II*\0": "TIFF", b"MM\0*": "TIFF", b"GIF8": "GIF", b"BM": "BMP",
    b"P5": "PGM", b"P6": "PPM", b"\0\0\0\x0cjP  ": "JPEG 2000", b"\xff\x0a": "JPEG XL",
    b"v/1\x01": "OpenEXR",
}  # fmt: skip
# Start-of-frame markers: C0 to CF but the tables DHT, JPG and DAC.
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


class ImageProbe(NamedTuple):
    """Size, kind and wholeness of an image, from a few of its bytes.

    Attributes:
        width: Pixels, 0 if not known.
        height: Pixels, 0 if not known.
        problem: What was expected and found, or None if it is whole.
        bits: Of each channel.
        channels: What a pixel holds.
        orientation: EXIF's, 1 to 8: how a viewer turns the stored pixels; 1 leaves them.
    """

    width: int
    height: int
    problem: str | None
    bits: int = 8
    channels: Channels = "rgb"
    orientation: int = 1

    @property
    def megapixels(self) -> float:
        """Number of pixels in millions."""
        return self.width * self.height / 1e6

    @property
    def obstacle(self) -> str | None:
        """What keeps its pixels from being read, or None: a problem, 16 bits, or its size."""
        if self.problem:
            return self.problem
        if self.bits > 8:
            return DEEP
        if self.megapixels > MAX_MEGAPIXELS:
            return (
                f"{self.megapixels:.0f} megapixels, and at most {MAX_MEGAPIXELS:.0f} are read: "
                "scale it down"
            )
        return None


def probe_ends(head: bytes, tail: bytes) -> ImageProbe:
    """Probe an image by its first bytes, with all of its header, and its last."""
    if not head:
        return ImageProbe(0, 0, "expected an image, got an empty file")
    if head.startswith(PNG_MAGIC):
        probe = _png_header(head)
        is_whole = _PNG_END in tail
    elif head.startswith(JPEG_MAGIC):
        probe = jpeg_header(head)
        # Some cameras pad the end with zeros.
        is_whole = tail.rstrip(b"\0\r\n").endswith(_JPEG_END)
    else:
        return ImageProbe(0, 0, f"expected a JPEG or PNG image, got {_kind_of(head)}")
    if not probe.width or not probe.height:
        return ImageProbe(0, 0, "expected an image, got one without size: is it truncated?")
    return probe if is_whole else probe._replace(problem=TRUNCATED)


def _kind_of(head: bytes) -> str:
    """What a file is that is no image we read, with what to do about it."""
    if head[4:8] == b"ftyp" and head[8:12] in _HEIF_BRANDS:
        return "HEIC or AVIF: convert it to JPEG first"
    for magic, name in _OTHER_MAGIC.items():
        if head.startswith(magic):
            return f"{name}: convert it to JPEG or PNG first"
    return "something else"


def _png_header(head: bytes) -> ImageProbe:
    """Size and kind by a PNG's header chunk, orientation by an `eXIf` chunk near the start."""
    if len(head) < 26:
        return ImageProbe(0, 0, None)
    width, height = (int.from_bytes(head[i : i + 4], "big") for i in (16, 20))
    channels = _PNG_CHANNELS.get(head[25], "rgb")
    orientation, at = 1, 8
    while at + 8 <= len(head) and head[at + 4 : at + 8] != b"IDAT":
        length = int.from_bytes(head[at : at + 4], "big")
        if head[at + 4 : at + 8] == b"eXIf":
            orientation = _find_orientation(head[at + 8 : at + 8 + length])[0]
        at += 12 + length
    return ImageProbe(width, height, None, head[24], channels, orientation)


def jpeg_header(head: bytes) -> ImageProbe:
    """Size, kind and orientation by a JPEG's segments; without size if the bytes end before."""
    at, orientation = 2, 1
    while at + 10 <= len(head) and head[at] == 0xFF:
        marker = head[at + 1]
        if marker == 0xFF:
            at += 1  # fill bytes are allowed between segments
        elif marker in _JPEG_FRAMES:
            height, width = _TWO_SHORTS.unpack_from(head, at + 5)
            channels = _JPEG_CHANNELS.get(head[at + 9], "rgb")
            return ImageProbe(width, height, None, head[at + 4], channels, orientation)
        else:
            length = _SHORT.unpack_from(head, at + 2)[0]
            if marker == 0xE1 and head[at + 4 : at + 10] == _EXIF:
                orientation = _find_orientation(head[at + 10 : at + 2 + length])[0]
            at += 2 + length
    return ImageProbe(0, 0, None)


def _find_orientation(tiff: bytes) -> tuple[int, int]:
    """The orientation in EXIF's TIFF structure, and where its two bytes are; 1, -1 without."""
    order: Literal["big", "little"] = "big" if tiff[:2] == b"MM" else "little"
    if tiff[:2] not in (b"MM", b"II") or len(tiff) < 8:
        return 1, -1
    start = int.from_bytes(tiff[4:8], order)
    count = int.from_bytes(tiff[start : start + 2], order)
    for entry in range(start + 2, start + 2 + 12 * min(count, 512), 12):
        if int.from_bytes(tiff[entry : entry + 2], order) == _ORIENTATION_TAG:
            value = int.from_bytes(tiff[entry + 8 : entry + 10], order)
            return (value, entry + 8) if 1 <= value <= 8 else (1, -1)
    return 1, -1


def without_orientation(content: bytes) -> bytes:
    """A JPEG whose EXIF says that it is not turned; its pixels are as they were."""
    at = 2
    while at + 10 <= len(content) and content[at] == 0xFF and content[at + 1] != 0xDA:
        length = _SHORT.unpack_from(content, at + 2)[0]
        if content[at + 1] == 0xE1 and content[at + 4 : at + 10] == _EXIF:
            tiff = content[at + 10 : at + 2 + length]
            value_at = _find_orientation(tiff)[1]
            if value_at >= 0:
                one = (1).to_bytes(2, "big" if tiff[:2] == b"MM" else "little")
                start = at + 10 + value_at
                return content[:start] + one + content[start + 2 :]
        at += 2 + length
    return content


def cut_after_jpeg(content: bytes) -> bytes | None:
    """A JPEG without what follows it in the file, as a phone's short film; None if it has no end.

    Args:
        content: The whole file.
    """
    at = 2
    while at + 4 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if marker == 0xD9:
            return content[: at + 2]
        at += 2 + _SHORT.unpack_from(content, at + 2)[0]
        if marker != 0xDA:
            continue
        # Coded pixels: a marker ends them, but for stuffed zeros and restarts.
        while (at := content.find(b"\xff", at)) >= 0 and at + 1 < len(content):
            if content[at + 1] != 0 and not 0xD0 <= content[at + 1] <= 0xD7:
                break
            at += 2
        if at < 0:
            return None
    return None
