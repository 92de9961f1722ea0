"""What a trajectory format is, and the reading and writing of files, gzip or not."""

from __future__ import annotations

import gzip
import io
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vioapr.errors import FormatError, ParameterError
from vioapr.trajectory import Trajectory

HEAD_BYTES = 65536
"""How much of a file is read to recognize its format."""


@dataclass(frozen=True)
class ReadOptions:
    """What a file does not say of itself.

    Attributes:
        rate_hz: Frames per second of image names' frame numbers (or of rows, for formats
            without names), for formats without timestamps. None leaves them untimed.
        sequence: For files that hold several sequences, the name of the one to read: the
            folder part of its image names, e.g. "seq-03".
        skipped: Where a list is given, rows whose timestamp is not later than the one before
            are left out and their errors appended to it, rather than raised. `vioapr inspect`
            uses it to look at what else is wrong with a file.
    """

    rate_hz: float | None = None
    sequence: str | None = None
    skipped: list[FormatError] | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ParameterError(f"expected a rate above 0 Hz, got {self.rate_hz}")


@dataclass(frozen=True)
class Format:
    """A foreign file format.

    Attributes:
        name: Short name for the command line, e.g. "tum".
        title: For people, e.g. "TUM RGB-D trajectory".
        convention: Columns, directions, axes and quaternion order, in one line.
        extensions: File name endings it is usually written with, without ".gz".
        sniff: From a path and the first bytes (decompressed; b"" for a directory), how sure
            one can be that it is this format: 0 (it is not) to 1.
        read: Reads a file into our conventions; raises FormatError.
        write: Writes a trajectory in the format's conventions.
        has_times: Whether a file says when each pose was.
        has_names: Whether a file says of which image each pose is.
        default_for: File names and endings, without ".gz", that mean this format when writing.
    """

    name: str
    title: str
    convention: str
    extensions: tuple[str, ...]
    sniff: Callable[[Path, bytes], float]
    read: Callable[[Path, ReadOptions], Trajectory]
    write: Callable[[Path, Trajectory], None]
    has_times: bool = False
    has_names: bool = False
    default_for: tuple[str, ...] = ()


def read_bytes(path: Path, limit: int | None = None) -> bytes:
    """A file's content, decompressed if it is gzip, at most `limit` bytes of it.

    Raises:
        FormatError: It is missing, a directory, unreadable, or a broken gzip file.
    """
    try:
        if path.is_dir():
            raise FormatError(path, "expected a file, got a directory")
        with path.open("rb") as file:
            is_gzip = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            content = gzip.GzipFile(fileobj=file) if is_gzip else file
            return content.read() if limit is None else content.read(limit)
    except FormatError:
        raise
    except FileNotFoundError:
        raise FormatError(path, "expected a file, found none of this name") from None
    except OSError as error:
        raise FormatError(path, f"cannot be read: {error.strerror or error}") from None
    except Exception as error:  # EOFError and zlib.error have no public base class in common
        raise FormatError(path, f"broken gzip content: {error}") from None


def read_text(path: Path) -> str:
    """A text file's content, gzip or not.

    Raises:
        FormatError: As `read_bytes`, or it is not UTF-8 text.
    """
    content = read_bytes(path)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise FormatError(path, "expected text, got binary content", line) from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise FormatError(path, "expected text, got binary content", line)
    return text


def write_text(path: Path, text: str) -> None:
    """Write text, gzipped where the name ends in .gz.

    Raises:
        FormatError: The file cannot be written.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes, gzipped where the name ends in .gz; folders are made as needed.

    Raises:
        FormatError: The file cannot be written.
    """
    if path.suffix == ".gz":
        buffer = io.BytesIO()
        with gzip.GzipFile(fileobj=buffer, mode="wb", mtime=0) as file:
            file.write(content)
        content = buffer.getvalue()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise FormatError(path, f"cannot be written: {error.strerror}") from None


def is_folder(path: Path) -> bool:
    """Whether a path is a folder; false also where it cannot be looked at."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def plain_name(path: Path) -> str:
    """A path's last part in lower case, without ".gz"."""
    return path.name.lower().removesuffix(".gz")


def has_suffix(path: Path, suffix: str) -> bool:
    """Whether a path ends in a suffix, whatever its case and with or without ".gz"."""
    return plain_name(path).endswith(suffix)


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """A sort key in which frame2 comes before frame10."""
    # Digits compare by length, then as text: int() refuses very long ones.
    return tuple(
        (0, len(part.lstrip("0")), part.lstrip("0")) if part.isdecimal() else (1, 0, part)
        for part in re.split(r"(\d+)", name)
        if part
    )
