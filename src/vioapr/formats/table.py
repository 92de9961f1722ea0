"""Text tables: splitting, checking and writing rows."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.text import read_text
from vioapr.geometry.rigid import Rigid3

_PART_ROWS, _PART_CHARACTERS = 4096, 1 << 20


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
            for field in row:
                if not is_number(field):
                    raise FormatError(self.path, f"expected a number, got {field[:40]!r}", line)
        raise FormatError(self.path, "expected a table of numbers")

    def column(self, index: int) -> list[str]:
        """One column as text."""
        return [row[index] for row in self.fields]

    def ticks(self, index: int, per_second: int) -> NDArray[np.float64]:
        """A column of whole ticks of a clock in seconds, rounded once."""
        values = self.numbers([index])[:, 0] / per_second
        for row, field in enumerate(self.column(index)):
            # Nanoseconds since 1970 do not fit a double; an int divided by an int does.
            if field.isdecimal() and len(field) < 20:
                values[row] = int(field) / per_second
        return values

    def at(self, keep: Sequence[int]) -> Rows:
        """Some of the rows."""
        return Rows(self.path, [self.fields[i] for i in keep], [self.lines[i] for i in keep])


def is_number(field: str) -> bool:
    """Whether a field reads as a number."""
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
    for number, row in _split(path, text, columns, what, delimiter, comment, skip):
        fields.append(row)
        lines.append(number)
    if not fields:
        raise FormatError(path, f"expected rows of {what}, got none: the file is empty")
    return Rows(path, fields, lines)


def parse_numbers(
    path: Path, text: str, columns: range, *, what: str
) -> tuple[Rows, NDArray[np.float64]]:
    """As `parse_rows`, of a table of numbers: text takes ten times their room, and is not kept.

    Returns:
        The rows without their fields, for messages, and the numbers, shape (rows, columns).

    Raises:
        FormatError: As `parse_rows`, or a field is not a number.
    """
    lines: list[int] = []
    parts: list[NDArray[np.float64]] = []
    rows = _split(path, text, columns, what, None, "#", 0)
    while part := list(itertools.islice(rows, _PART_ROWS)):
        numbers, fields = zip(*part, strict=True)
        parts.append(Rows(path, list(fields), list(numbers)).numbers(slice(None)))
        lines += numbers
    if not lines:
        raise FormatError(path, f"expected rows of {what}, got none: the file is empty")
    return Rows(path, [[]] * len(lines), lines), np.concatenate(parts)


def _split(
    path: Path,
    text: str,
    columns: range,
    what: str,
    delimiter: str | None,
    comment: str,
    skip: int,
) -> Iterator[tuple[int, list[str]]]:
    """Line number and fields of each row."""
    for number, line in enumerate(_lines(text), start=1):
        stripped = line.strip()
        if number <= skip or not stripped or (comment and stripped.startswith(comment)):
            continue
        row = [field.strip() for field in stripped.split(delimiter)]
        if len(row) not in columns:
            expected = f"{columns[0]}" if len(columns) == 1 else f"{columns[0]} to {columns[-1]}"
            raise FormatError(path, f"expected {expected} columns ({what}), got {len(row)}", number)
        yield number, row


def _lines(text: str) -> Iterator[str]:
    """The lines of a text, some at a time."""
    start = 0
    while start < len(text):
        end = text.find("\n", start + _PART_CHARACTERS) + 1 or len(text)
        yield from text[start:end].splitlines()
        start = end


def read_headed_csv(path: Path, required: Sequence[str]) -> Rows:
    """Read a comma-separated table whose first line names its columns.

    Returns:
        Rows of the required columns, in the order asked for.

    Raises:
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
    return Rows(path, [[row[i] for i in order] for row in rows.fields], rows.lines)


def to_ticks(timestamp_s: NDArray[np.float64], per_second: int) -> list[int]:
    """Seconds as whole ticks of a clock, without the rounding of a product of doubles."""
    ticks = []
    for time in timestamp_s.tolist():
        numerator, denominator = time.as_integer_ratio()
        ticks.append((2 * numerator * per_second + denominator) // (2 * denominator))
    return ticks


def format_rows(rows: Iterable[Iterable[object]], separator: str) -> str:
    """Lines of text, floats with all their digits so that reading gives the same doubles."""
    return "".join(
        separator.join(repr(v) if isinstance(v, float) else str(v) for v in row) + "\n"
        for row in rows
    )


def pose_columns(poses: Rigid3, order: Sequence[int] = (0, 1, 2, 3)) -> list[list[float]]:
    """Position and quaternion of each pose as plain floats, 7 a pose.

    Args:
        poses: Shape (n,).
        order: The quaternion's components in the file, as indices of xyzw: wxyz is
            (3, 0, 1, 2).
    """
    quats = poses.quat_xyzw[:, list(order)]
    return np.column_stack([poses.translation_m, quats]).tolist()


def head_rows(head: bytes, delimiter: str | None = None, comment: str = "#") -> list[list[str]]:
    """The first few complete rows of a file's first bytes, for sniffing; [] if not text."""
    if b"\0" in head:
        return []
    lines = head[:16384].decode("utf-8", "replace").splitlines()
    # The last line may be cut off by the limit.
    lines = lines[:-1] if len(head) > 16384 else lines
    rows = [[field.strip() for field in line.split(delimiter)] for line in lines if line.strip()]
    return [row for row in rows if not (comment and row and row[0].startswith(comment))][:20]


def all_numbers(rows: list[list[str]], widths: range) -> bool:
    """Whether there are rows, all of them numbers and as wide as allowed."""
    return bool(rows) and all(
        len(row) in widths and all(is_number(field) for field in row) for row in rows
    )
