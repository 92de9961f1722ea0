"""What a trajectory format is, and helpers that the readers share."""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError
from vioapr.trajectory import Trajectory, find_problem

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
    """

    rate_hz: float | None = None
    sequence: str | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
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
        write: Writes a trajectory in the format's conventions, or None if it cannot.
    """

    name: str
    title: str
    convention: str
    extensions: tuple[str, ...]
    sniff: Callable[[Path, bytes], float]
    read: Callable[[Path, ReadOptions], Trajectory]
    write: Callable[[Path, Trajectory], None] | None


def read_bytes(path: Path, limit: int | None = None) -> bytes:
    """A file's content, decompressed if it is gzip, at most `limit` bytes of it.

    Raises:
        FormatError: It is missing, a directory, unreadable, or a broken gzip file.
    """
    if path.is_dir():
        raise FormatError(path, "expected a file, got a directory")
    try:
        with path.open("rb") as file:
            is_gzip = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            content = gzip.GzipFile(fileobj=file) if is_gzip else file
            return content.read() if limit is None else content.read(limit)
    except FileNotFoundError:
        raise FormatError(path, "expected a file, found none of this name") from None
    except (EOFError, gzip.BadGzipFile, OSError, ValueError) as error:
        raise FormatError(path, f"cannot be read: {error}") from None
    except Exception as error:  # zlib.error has no public base class of its own
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
    content = text.encode()
    if path.suffix == ".gz":
        buffer = io.BytesIO()
        with gzip.GzipFile(fileobj=buffer, mode="wb", mtime=0) as file:
            file.write(content)
        content = buffer.getvalue()
    try:
        path.write_bytes(content)
    except OSError as error:
        raise FormatError(path, f"cannot be written: {error.strerror}") from None


@dataclass(frozen=True)
class Rows:
    """Rows of a text table, with the place of each for messages.

    Attributes:
        path: The file.
        fields: The fields of each row.
        lines: The 1-based line number of each row.
    """

    path: Path
    fields: list[list[str]]
    lines: list[int]

    def numbers(self, columns: slice | Sequence[int]) -> NDArray[np.float64]:
        """Some columns as finite numbers, shape (rows, columns).

        Raises:
            FormatError: A field is not a number, naming its line.
        """
        picked = [
            row[columns] if isinstance(columns, slice) else [row[i] for i in columns]
            for row in self.fields
        ]
        try:
            return np.array(picked, dtype=np.float64).reshape(len(picked), -1)
        except ValueError:
            pass
        for row, line in zip(picked, self.lines, strict=True):
            for field in row:
                if not _is_number(field):
                    raise FormatError(self.path, f"expected a number, got {field[:40]!r}", line)
        raise FormatError(self.path, "expected a table of numbers")

    def column(self, index: int) -> list[str]:
        """One column as text."""
        return [row[index] for row in self.fields]


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def parse_rows(
    path: Path,
    text: str,
    columns: range,
    *,
    what: str,
    delimiter: str | None = None,
    comment: str = "#",
    skip: int = 0,
) -> Rows:
    """Split a text table, checking the number of columns of every row.

    Args:
        path: For messages.
        text: The content.
        columns: Numbers of columns that are allowed.
        what: The columns, for messages, e.g. "t x y z qx qy qz qw".
        delimiter: Field separator; None is any white space.
        comment: Lines that start with it are passed over.
        skip: Header lines to pass over.

    Raises:
        FormatError: No rows, or a row with another number of columns, naming its line.
    """
    fields, lines = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if number <= skip or not stripped or (comment and stripped.startswith(comment)):
            continue
        row = [field.strip() for field in stripped.split(delimiter)]
        if len(row) not in columns:
            expected = f"{columns[0]}" if len(columns) == 1 else f"{columns[0]} or more"
            raise FormatError(path, f"expected {expected} columns ({what}), got {len(row)}", number)
        fields.append(row)
        lines.append(number)
    if not fields:
        raise FormatError(path, f"expected rows of {what}, got none: the file is empty")
    return Rows(path, fields, lines)


def build_trajectory(
    rows: Rows,
    timestamps_s: NDArray[np.float64],
    positions_m: NDArray[np.float64],
    quats_xyzw: NDArray[np.float64],
    *,
    names: Sequence[str] | None = None,
    is_timed: bool = True,
    target: str = "world",
    source: str = "cam",
) -> Trajectory:
    """A trajectory, or a FormatError that names the line of the row that is wrong."""
    problem = find_problem(timestamps_s, positions_m, quats_xyzw, names=names)
    if problem is not None:
        row, what = problem
        raise FormatError(rows.path, what, None if row is None else rows.lines[row])
    return Trajectory.from_arrays(
        timestamps_s,
        positions_m,
        quats_xyzw,
        names,
        is_timed=is_timed,
        target=target,
        source=source,
    )


def natural_key(name: str) -> tuple[object, ...]:
    """A sort key in which frame2 comes before frame10."""
    return tuple(
        (0, int(part), part) if part.isdecimal() else (1, 0, part)
        for part in re.split(r"(\d+)", name)
        if part
    )
