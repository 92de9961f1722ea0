"""All formats, and reading a file of any of them."""

from __future__ import annotations

from pathlib import Path

from vioapr.errors import FormatError, ParameterError
from vioapr.files.text import has_suffix, is_folder, plain_name, read_bytes
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
from vioapr.formats.base import HEAD_BYTES, Format, ReadOptions
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
    """Find the format of a name.

    Raises:
        ParameterError: There is none; the message lists them.
    """
    if name not in FORMATS:
        raise ParameterError(f"unknown format {name!r}: expected one of {', '.join(FORMATS)}")
    return FORMATS[name]


def rank_formats(path: Path) -> list[tuple[Format, float]]:
    """Rank the formats that a file may be, likeliest first, each with a confidence of 0 to 1.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is empty.
    """
    if is_folder(path):
        return _rank(path, b"")
    head = read_bytes(path, HEAD_BYTES)
    if not head.strip():
        raise FormatError(path, "expected a trajectory, got an empty file")
    if ranked := _rank(path, head):
        return ranked
    # Formats that most of the first rows fit: their readers can then say which row is wrong.
    rows = [row for row in head.splitlines() if row.strip() and not row.startswith(b"#")][:20]
    votes: dict[str, float] = {}
    for row in rows:
        for format_, confidence in _rank(path, row + b"\n"):
            votes[format_.name] = votes.get(format_.name, 0.0) + confidence / len(rows)
    ranked = [(FORMATS[name], share / 2) for name, share in votes.items() if share > 0.3]
    if ranked or b"\0" in head:
        return sorted(ranked, key=lambda r: -r[1])
    # The format that the name promises, for text that looks like none.
    return [
        (format_, 0.1)
        for format_ in FORMATS.values()
        if any(has_suffix(path, suffix) for suffix in format_.default_for)
    ]


def _rank(path: Path, head: bytes) -> list[tuple[Format, float]]:
    ranked = [(format_, format_.sniff(path, head)) for format_ in FORMATS.values()]
    return sorted((r for r in ranked if r[1] > 0), key=lambda r: -r[1])


def read_trajectory(
    path: Path, format_name: str | None = None, options: ReadOptions | None = None
) -> Trajectory:
    """Read a trajectory of a given format, or of the likeliest one.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is malformed, or its format is not recognized.
        ParameterError: There is no format of that name.
    """
    format_ = recognize(path) if format_name is None else get_format(format_name)
    return format_.read(path, options or ReadOptions())


def write_trajectory(path: Path, trajectory: Trajectory, format_name: str | None = None) -> None:
    """Write a trajectory in a given format, or in the one that the file's name means.

    Raises:
        ParameterError: There is no such format, the name means none, or the format needs what
            the trajectory does not have.
        UnwritableError: The file cannot be written.
    """
    format_ = format_of_name(path) if format_name is None else get_format(format_name)
    format_.write(path, trajectory)


def format_of_name(path: Path, parameter: str = "format_name") -> Format:
    """Find the format that a file's name means: a whole name before an ending.

    Args:
        path: The file or folder to write.
        parameter: The caller's, with which a user can choose a format.

    Raises:
        ParameterError: It means none; the message lists those that fit.
    """
    name = plain_name(path)
    for matches in (name.__eq__, name.endswith):
        for format_ in FORMATS.values():
            if any(matches(known) for known in format_.default_for):
                return format_
    ending = Path(name).suffix or "/"
    fitting = ", ".join(f.name for f in FORMATS.values() if ending in f.extensions)
    raise ParameterError(
        f"{path}: the name does not tell which format to write: choose one with `{parameter}`: "
        + (fitting or ", ".join(FORMATS))
    )


def recognize(path: Path) -> Format:
    """Find the format that a file most likely has.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It looks like none.
    """
    if ranked := rank_formats(path):
        return ranked[0][0]
    if is_folder(path):
        found = "a folder that is of no format"
    else:
        is_binary = b"\0" in read_bytes(path, HEAD_BYTES)
        found = "binary content" if is_binary else "text of no known format"
    raise FormatError(
        path, f"expected a trajectory, got {found}; vioapr knows {', '.join(FORMATS)}"
    )
