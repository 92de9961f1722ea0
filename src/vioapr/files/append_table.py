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

from vioapr.errors import AlreadyExistsError, FormatError, UnreadableError, UnwritableError
from vioapr.files.tables import Rows, is_number

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
            AlreadyExistsError: It exists already.
            UnwritableError: It cannot be written.
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
            UnwritableError: It cannot be written.
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


def read_blocks(path: Path, header: str, problems: list[Problem]) -> Iterator[Rows]:
    """Read a table in blocks of rows that have as many fields as the header.

    Args:
        path: The file.
        header: Its first line; further columns may follow it.
        problems: Where what is wrong is appended: rows with another number of fields and a
            torn last line, which are left out.

    Yields:
        At most `BLOCK_ROWS` consecutive rows.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It has another header.
    """
    try:
        with path.open("rb") as file:
            found = [f.strip() for f in file.readline().decode("utf-8", "replace").split(",")]
            wanted = header.split(",")
            if found[: len(wanted)] != wanted:
                shown = ",".join(found)[:200]
                raise FormatError(path, f"expected the header {header}, got {shown!r}", 1)
            block = Rows(path, [], [])
            for number, raw in enumerate(file, start=2):
                if not raw.endswith(b"\n"):
                    text = "the last line is cut off and is passed over: was writing interrupted?"
                    problems.append(Problem(path, number, text, is_error=False))
                    break
                row = raw.decode("utf-8", "replace").rstrip("\r\n").split(",")
                if len(row) != len(found):
                    text = f"expected {len(found)} fields, got {len(row)}"
                    problems.append(Problem(path, number, text))
                    continue
                block.fields.append(row)
                block.lines.append(number)
                if len(block) == BLOCK_ROWS:
                    yield block
                    block = Rows(path, [], [])
            if len(block):
                yield block
    except OSError as error:
        raise UnreadableError.of(path, error) from None


def finite_numbers(
    rows: Rows, columns: Sequence[int], problems: list[Problem]
) -> tuple[Rows, NDArray[np.float64]]:
    """Some columns as numbers; empty fields are NaN.

    Args:
        rows: As read by `read_blocks`.
        columns: Which fields of each row.
        problems: Where rows that hold something that is no finite number are appended.

    Returns:
        The other rows, and their numbers, shape (rows, columns).
    """
    texts = [[row[i] or "nan" for i in columns] for row in rows.fields]
    try:
        values = np.array(texts, dtype=np.float64)
    except ValueError:
        values = np.array([[float(x) if is_number(x) else np.inf for x in row] for row in texts])
    values = values.reshape(len(texts), len(columns))
    bad = np.zeros(len(values), dtype=bool)
    for row, column in np.argwhere(~np.isfinite(values)).tolist():
        field = rows.fields[row][columns[column]]
        if field and not bad[row]:
            text = f"expected a finite number, got {field[:40]!r}"
            problems.append(Problem(rows.path, rows.lines[row], text))
            bad[row] = True
    if bad.any():
        rows = rows.at(np.flatnonzero(~bad).tolist())
    return rows, values[~bad]
