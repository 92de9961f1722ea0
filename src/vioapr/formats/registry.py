"""All formats, and reading a file of any of them."""

from __future__ import annotations

from pathlib import Path

from vioapr.errors import FormatError, ParameterError
from vioapr.formats import (
    ace,
    advio,
    aria,
    cambridge,
    colmap,
    colmap_binary,
    euroc,
    hloc,
    hrapr,
    kitti,
    marvin,
    mstransformer,
    nerfstudio,
    record3d,
    scancapture,
    sevenscenes,
    stray,
    tum,
)
from vioapr.formats.base import HEAD_BYTES, Format, ReadOptions, is_folder, read_bytes
from vioapr.trajectory import Trajectory

_ALL = (
    tum.FORMAT,
    euroc.FORMAT,
    kitti.FORMAT,
    colmap.FORMAT,
    colmap_binary.FORMAT,
    hloc.FORMAT,
    ace.FORMAT,
    marvin.FORMAT,
    marvin.VIO_FORMAT,
    hrapr.FORMAT,
    mstransformer.FORMAT,
    cambridge.FORMAT,
    sevenscenes.FORMAT,
    nerfstudio.FORMAT,
    advio.FORMAT,
    advio.VIO_FORMAT,
    stray.FORMAT,
    record3d.FORMAT,
    scancapture.FORMAT,
    aria.FORMAT,
)

FORMATS: dict[str, Format] = {format_.name: format_ for format_ in _ALL}


def get_format(name: str) -> Format:
    """The format of a name.

    Raises:
        ParameterError: There is none; the message lists them.
    """
    if name not in FORMATS:
        raise ParameterError(f"unknown format {name!r}: expected one of {', '.join(FORMATS)}")
    return FORMATS[name]


def rank_formats(path: Path) -> list[tuple[Format, float]]:
    """Formats that a file may be, likeliest first, each with a confidence of 0 to 1.

    Raises:
        FormatError: It cannot be read at all.
    """
    head = b"" if is_folder(path) else read_bytes(path, HEAD_BYTES)
    ranked = [(format_, format_.sniff(path, head)) for format_ in FORMATS.values()]
    return sorted((r for r in ranked if r[1] > 0), key=lambda r: -r[1])


def read_trajectory(
    path: Path, format_name: str | None = None, options: ReadOptions | None = None
) -> Trajectory:
    """Read a trajectory of a given format, or of the likeliest one.

    Raises:
        FormatError: It cannot be read, or its format is not recognized.
        ParameterError: There is no format of that name.
    """
    options = options or ReadOptions()
    if format_name is not None:
        return get_format(format_name).read(path, options)
    ranked = rank_formats(path)
    if not ranked:
        raise FormatError(
            path,
            "not recognized as any known trajectory format; name it as one of: "
            + ", ".join(FORMATS),
        )
    return ranked[0][0].read(path, options)
