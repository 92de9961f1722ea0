"""Comma-separated tables that only ever grow: appending whole lines, and reading what a crash left.

A line is complete when it ends in a newline. What follows the last newline was cut off while it
was written, and is passed over: its numbers may lack digits.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import (
    AlreadyExistsError,
    FileMissingError,
    FormatError,
    UnreadableError,
    UnwritableError,
)
from vioapr.formats.table import is_number

BLOCK_ROWS = 4096
"""Rows that are held as text at a time."""


@dataclass
class Problem:
    """What is wrong with a file.

    Attributes:
        path: The file or folder.
        line: 1-based line, or None where the problem has none.
        text: What was expected and what was found.
        is_error: Whether something is broken; otherwise it only should be known.
    """

    path: Path
    line: int | None
    text: str
    is_error: bool = True

    def __str__(self) -> str:
        place = str(self.path) if self.line is None else f"{self.path}:{self.line}"
        return f"{place}: {self.text}"

    def to_error(self) -> FormatError:
        """The problem as an exception."""
        return FormatError(self.path, self.text, self.line)


class AppendTable:
    """A table open for appending; every line reaches the file system before the next begins."""

    def __init__(self, path: Path, header: str) -> None:
        """Create the table with its header line.

        Raises:
            FormatError: It exists already, or cannot be written.
        """
        self._path = path
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o666)
        except FileExistsError:
            raise AlreadyExistsError(path, "expected to write a new file, but it exists") from None
        except OSError as error:
            raise UnwritableError.of(path, error) from None
        self._end = 0
        self.append(header)

    def append(self, line: str) -> None:
        """Write one line, or several, whole, or, if the disk is full, nothing of it.

        Raises:
            FormatError: It cannot be written.
        """
        content = line.encode() + b"\n"
        try:
            write_all(self._file, content)
        except OSError as error:
            os.ftruncate(self._file, self._end)
            raise UnwritableError.of(self._path, error) from None
        self._end += len(content)

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def __enter__(self) -> AppendTable:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def write_all(file: int, content: bytes) -> None:
    """Write bytes to a file descriptor; a system call may take only some of them."""
    written = os.write(file, content)
    while written < len(content):
        written += os.write(file, content[written:])


@dataclass
class Block:
    """Some consecutive rows of a table as text.

    Attributes:
        fields: The fields of each row.
        lines: The 1-based line number of each.
    """

    fields: list[list[str]]
    lines: list[int]

    def drop(self, bad: NDArray[np.bool_]) -> Block:
        """The rows that are not bad."""
        if not bad.any():
            return self
        keep = np.flatnonzero(~bad)
        return Block([self.fields[i] for i in keep], [self.lines[i] for i in keep])


def read_blocks(path: Path, header: str, problems: list[Problem]) -> Iterator[Block]:
    """Read a table in blocks of rows that have as many fields as the header.

    Args:
        path: The file.
        header: Its first line; further columns may follow it.
        problems: Where what is wrong is appended: rows with another number of fields (they are
            left out), a torn last line (likewise).

    Raises:
        FormatError: It cannot be read, or has another header.
    """
    try:
        with path.open("rb") as file:
            first = file.readline()
            width = _check_header(path, first, header)
            yield from _split(path, file, width, problems)
    except FileNotFoundError:
        raise FileMissingError(path, "expected a file, found none of this name") from None
    except OSError as error:
        raise UnreadableError.of(path, error) from None


def _check_header(path: Path, first: bytes, header: str) -> int:
    found = [field.strip() for field in first.decode("utf-8", "replace").split(",")]
    wanted = header.split(",")
    if found[: len(wanted)] != wanted:
        shown = ",".join(found)[:200]
        raise FormatError(path, f"expected the header {header}, got {shown!r}", 1)
    return len(found)


def _split(path: Path, file, width: int, problems: list[Problem]) -> Iterator[Block]:
    fields: list[list[str]] = []
    lines: list[int] = []
    for number, raw in enumerate(file, start=2):
        if not raw.endswith(b"\n"):
            text = "the last line is cut off and is passed over: was writing interrupted?"
            problems.append(Problem(path, number, text, is_error=False))
            break
        row = raw.decode("utf-8", "replace").rstrip("\r\n").split(",")
        if len(row) != width:
            text = f"expected {width} fields, got {len(row)}"
            problems.append(Problem(path, number, text))
            continue
        fields.append(row)
        lines.append(number)
        if len(lines) == BLOCK_ROWS:
            yield Block(fields, lines)
            fields, lines = [], []
    if lines:
        yield Block(fields, lines)


def to_numbers(
    path: Path, block: Block, columns: Sequence[int], problems: list[Problem]
) -> tuple[Block, NDArray[np.float64]]:
    """Some columns of a block as numbers; empty fields are NaN.

    Returns:
        The block without rows that hold something that is no finite number, and the numbers,
        shape (rows, columns). Such rows are appended to the problems.
    """
    texts = [[row[i] or "nan" for i in columns] for row in block.fields]
    try:
        values = np.array(texts, dtype=np.float64)
    except ValueError:
        numbers = [[float(text) if is_number(text) else np.inf for text in row] for row in texts]
        values = np.array(numbers)
    values = values.reshape(len(texts), len(columns))
    bad = np.zeros(len(values), dtype=bool)
    for row, column in np.argwhere(~np.isfinite(values)):
        field = block.fields[row][columns[column]]
        if field and not bad[row]:
            text = f"expected a finite number, got {field[:40]!r}"
            problems.append(Problem(path, block.lines[row], text))
            bad[row] = True
    return block.drop(bad), values[~bad]


def format_field(value: object) -> str:
    """A value as a field: floats with all their digits, what is not known empty."""
    if value is None:
        return ""
    if isinstance(value, float):
        return "" if value != value else repr(value)
    return str(value)
