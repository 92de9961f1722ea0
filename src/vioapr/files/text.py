"""Text and bytes of files, gzip or not, and the names of files."""

from __future__ import annotations

import gzip
import io
import re
import zlib
from pathlib import Path

from vioapr.errors import FileMissingError, FormatError, UnreadableError
from vioapr.files.atomic import write_atomically


def read_bytes(path: Path, limit: int | None = None) -> bytes:
    """A file's content, decompressed if it is gzip, at most `limit` bytes of it.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is a directory, or a broken gzip file.
    """
    try:
        if path.is_dir():
            raise FormatError(path, "expected a file, got a directory")
        with path.open("rb") as file:
            is_gzip = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            content = gzip.GzipFile(fileobj=file) if is_gzip else file
            return content.read() if limit is None else content.read(limit)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise FormatError(path, f"broken gzip content: {error}") from None
    except OSError as error:
        raise UnreadableError.of(path, error) from None


def read_head(path: Path, limit: int) -> bytes:
    """The first bytes of a file, decompressed; as UTF-8 where it is text in UTF-16.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is a directory, or a broken gzip file.
    """
    head = read_bytes(path, 2 * limit)
    if _is_utf16(head):
        head = head.decode("utf-16", "ignore").encode()
    return head[:limit]


def _is_utf16(content: bytes) -> bool:
    """Whether a mark says UTF-16, as Excel and PowerShell write text."""
    return content[:2] in (b"\xff\xfe", b"\xfe\xff") and b"\0\0" not in content[2:4]


def read_text(path: Path) -> str:
    """A text file's content, gzip or not, in UTF-8, or in UTF-16 with its mark.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is a directory, a broken gzip file, or not such text.
    """
    content = read_bytes(path)
    try:
        text = content.decode("utf-16" if _is_utf16(content) else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise FormatError(path, "expected text, got binary content", line) from None
    if "\0" in text:
        if looks_utf16(content):
            raise FormatError(path, "expected UTF-8 text, got UTF-16 without a mark: save as UTF-8")
        line = text[: text.index("\0")].count("\n") + 1
        raise FormatError(path, "expected text, got binary content", line)
    return text


def looks_utf16(content: bytes) -> bool:
    """Whether every other byte is 0 at the start, as of plain text in UTF-16."""
    start = content[:64]
    return len(start) >= 8 and any(not any(s) and all(t) for s, t in _halves(start))


def _halves(start: bytes) -> tuple[tuple[bytes, bytes], tuple[bytes, bytes]]:
    even, odd = start[::2], start[1::2]
    return (even, odd), (odd, even)


def write_text(path: Path, text: str, *, overwrite: bool = True) -> None:
    """Write text in one step, gzipped where the name ends in .gz.

    Raises:
        AlreadyExistsError: It exists, without `overwrite`.
        UnwritableError: It cannot be written; what was there stays.
    """
    write_bytes(path, text.encode(), overwrite=overwrite)


def write_bytes(path: Path, content: bytes, *, overwrite: bool = True) -> None:
    """Write bytes in one step, gzipped where the name ends in .gz; folders are made as needed.

    Raises:
        AlreadyExistsError: It exists, without `overwrite`.
        UnwritableError: It cannot be written; what was there stays.
    """
    if path.suffix == ".gz":
        buffer = io.BytesIO()
        with gzip.GzipFile(fileobj=buffer, mode="wb", mtime=0) as file:
            file.write(content)
        content = buffer.getvalue()
    write_atomically(path, content, overwrite=overwrite)


def is_folder(path: Path) -> bool:
    """Whether a path is a folder; false also where it cannot be looked at."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def require_folder(path: Path, what: str) -> None:
    """See that a folder is there.

    Args:
        path: The folder.
        what: Its content, for messages.

    Raises:
        FileMissingError: There is nothing of this name.
        FormatError: It is a file.
    """
    if not path.exists():
        raise FileMissingError(path, f"expected {what}, found none of this name")
    if not path.is_dir():
        raise FormatError(path, f"expected {what}, found a file")


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
