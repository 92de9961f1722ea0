"""Text tables: splitting and checking rows, their fields as numbers, and writing them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.text import read_text

_MISSING = frozenset({"", "nan", "null", "none", "na", "n/a"})
CUT_OFF = "ends early"
"""The summary of a last row that was cut off."""

_PART_CHARACTERS = 1 << 20
_SNIFFED_ROWS, _SNIFFED_BYTES = 20, 16384


@dataclass(frozen=True)
class RowProblem:
    """What is wrong with one row of a file.

    Attributes:
        error: For an error about this row: what was expected, and what it has.
        summary: For a list of such rows, after "line 5: ", e.g. "position is 3.1e9 m away".
    """

    error: str
    summary: str


@dataclass(frozen=True)
class Rows:
    """Rows of a file, with the place of each for messages.

    Attributes:
        path: The file.
        fields: The fields of each row as text.
        lines: The 1-based line number of each row.
        problems: By line, what was found wrong with rows. Selections of rows share it.
    """

    path: Path
    fields: list[list[str]]
    lines: list[int]
    problems: dict[int, RowProblem] = field(default_factory=dict[int, RowProblem])

    @staticmethod
    def numbered(path: Path, count: int) -> Rows:
        """Entries of a file that is no table, counted from 1; they have no fields."""
        return Rows(path, [[] for _ in range(count)], list(range(1, count + 1)))

    def __len__(self) -> int:
        return len(self.lines)

    def numbers(self, columns: slice | Sequence[int]) -> NDArray[np.float64]:
        """Some columns as numbers, shape (rows, columns).

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
            for text in row:
                if not is_number(text) and not is_missing(text):
                    raise FormatError(self.path, f"expected a number, got {text[:40]!r}", line)
        try:
            filled = [["nan" if is_missing(text) else text for text in row] for row in picked]
            return np.array(filled, dtype=np.float64).reshape(len(picked), -1)
        except ValueError:
            raise FormatError(self.path, "expected a table of numbers") from None

    def column(self, index: int) -> list[str]:
        """One column as text."""
        return [row[index] for row in self.fields]

    def ticks(self, index: int) -> list[int | float]:
        """A column of a clock's ticks: whole ones exact, as nanoseconds do not fit a double."""
        ticks: list[int | float] = self.numbers([index])[:, 0].tolist()
        for row, text in enumerate(self.column(index)):
            if text.isdecimal() and len(text) < 20:
                ticks[row] = int(text)
        return ticks

    def at(self, keep: Iterable[int]) -> Rows:
        """Some of the rows, by index."""
        keep = list(keep)
        fields, lines = [self.fields[i] for i in keep], [self.lines[i] for i in keep]
        return Rows(self.path, fields, lines, self.problems)


def is_number(field: str) -> bool:
    """Whether a field reads as a number."""
    try:
        float(field)
    except ValueError:
        return False
    return True


def is_missing(field: str) -> bool:
    """Whether a field stands for a number that is not there, as pandas and JSON write it."""
    return field.lower() in _MISSING


def split_rows(
    path: Path,
    text: str,
    columns: range,
    *,
    what: str,
    delimiter: str | None = None,
    comment: str | tuple[str, ...] = "#",
    skip: int = 0,
    cut_off: dict[int, RowProblem] | None = None,
) -> Iterator[tuple[int, list[str]]]:
    """Split a text table row by row, checking the number of columns; see `parse_rows`.

    A last line without an end and without all its columns was cut off while it was written: it
    is noted in `cut_off`, where that is given.

    Yields:
        The 1-based line number and the fields of each row.

    Raises:
        FormatError: A row has another number of columns, naming its line.
    """
    number = start = 0
    while start < len(text):
        # Some of the text at a time: its lines would take as much room again.
        end = text.find("\n", start + _PART_CHARACTERS) + 1 or len(text)
        lines = text[start:end].splitlines()
        last_number = number + len(lines)
        for line in lines:
            number += 1
            stripped = line.strip(" \r\n" if delimiter == "\t" else None)
            if number <= skip or not stripped or (comment and stripped.startswith(comment)):
                continue
            row = [field.strip() for field in stripped.split(delimiter)]
            if len(row) not in columns:
                wanted = f"{columns[0]}" if len(columns) == 1 else f"{columns[0]} to {columns[-1]}"
                problem = f"expected {wanted} columns ({what}), got {len(row)}"
                is_last = end == len(text) and number == last_number and text[-1] not in "\r\n"
                if cut_off is not None and is_last and len(row) < columns[0]:
                    cut_off[number] = RowProblem(problem, CUT_OFF)
                    return
                raise FormatError(path, problem, number)
            yield number, row
        start = end


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
    rows = Rows(path, [], [])
    for number, row in split_rows(
        path,
        text,
        columns,
        what=what,
        delimiter=delimiter,
        comment=comment,
        skip=skip,
        cut_off=rows.problems,
    ):
        rows.fields.append(row)
        rows.lines.append(number)
    if not len(rows):
        raise FormatError(path, f"expected rows of {what}, got none: the file is empty")
    return rows


def read_headed_csv(path: Path, required: Sequence[str]) -> Rows:
    """Read a comma-separated table whose first line names its columns.

    Returns:
        Rows of the required columns, in the order asked for.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: As `parse_rows`, or a required column is missing.
    """
    text = read_text(path)
    if not text.strip():
        raise FormatError(path, f"expected a header with {','.join(required)}: the file is empty")
    header = [field.strip() for field in text.splitlines()[0].lstrip("# ").split(",")]
    missing = [name for name in required if name not in header]
    if missing:
        raise FormatError(path, f"expected a header with the columns {', '.join(missing)}", 1)
    width = len(header)
    rows = parse_rows(
        path, text, range(width, width + 1), what=",".join(header), delimiter=",", skip=1
    )
    order = [header.index(name) for name in required]
    fields = [[row[i] for i in order] for row in rows.fields]
    return Rows(path, fields, rows.lines, rows.problems)


def to_ticks(timestamp_s: NDArray[np.float64], per_second: int) -> list[int]:
    """Seconds as whole ticks of a clock, without the rounding of a product of doubles."""
    ticks: list[int] = []
    for time_s in timestamp_s.tolist():
        numerator, denominator = time_s.as_integer_ratio()
        ticks.append((2 * numerator * per_second + denominator) // (2 * denominator))
    return ticks


def format_field(value: object) -> str:
    """A value as a field: floats with all their digits, None and NaN as nothing."""
    if isinstance(value, float):
        return "" if value != value else float.__repr__(value)
    return "" if value is None else str(value)


def format_rows(rows: Iterable[Iterable[object]], separator: str) -> str:
    """Lines of text, floats with all their digits so that reading gives the same doubles."""
    return "".join(separator.join(map(format_field, row)) + "\n" for row in rows)


def head_rows(head: bytes, delimiter: str | None = None, comment: str = "#") -> list[list[str]]:
    """The first few complete rows of a file's first bytes, for sniffing; [] if not text."""
    if b"\0" in head:
        return []
    lines = head[:_SNIFFED_BYTES].decode("utf-8", "replace").splitlines()
    # The last line may be cut off by the limit.
    lines = lines[:-1] if len(head) > _SNIFFED_BYTES else lines
    rows = [[field.strip() for field in line.split(delimiter)] for line in lines if line.strip()]
    rows = [row for row in rows if not (comment and row and row[0].startswith(comment))]
    return rows[:_SNIFFED_ROWS]


def all_numbers(rows: list[list[str]], widths: range) -> bool:
    """Whether there are rows, all of them numbers and as wide as allowed."""
    return bool(rows) and all(
        len(row) in widths and all(is_number(field) or is_missing(field) for field in row)
        for row in rows
    )
