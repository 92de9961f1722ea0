"""The first lines of a text table: its delimiter, the names of its columns, its first rows."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.files.tables import is_missing, is_number
from vioapr.formats.base import HEAD_BYTES
from vioapr.formats.columns import Layout, find_layout

COMMENTS = ("#", "%")
_MAX_HEADER_LINES = 5


@dataclass(frozen=True)
class TableHead:
    """What the first lines of a text table tell.

    Attributes:
        delimiter: Between fields; None is white space.
        names: Of the columns, where a line names a pose; "" for a column without a name.
        is_comment: Whether that line is a comment.
        header_lines: Lines to pass over before the rows.
        has_decimal_commas: Whether numbers are written as 0,5.
        rows: The fields of the first rows.
    """

    delimiter: str | None
    names: tuple[str, ...] | None
    is_comment: bool
    header_lines: int
    has_decimal_commas: bool
    rows: tuple[tuple[str, ...], ...]

    @property
    def width(self) -> int:
        """Columns of the first row."""
        return len(self.rows[0])

    @property
    def layout(self) -> Layout | None:
        """The columns of a pose, where they are named."""
        return None if self.names is None else find_layout(self.names)

    def numbers(self) -> NDArray[np.float64]:
        """The first rows as numbers, shape (n, width), NaN for fields that are none."""
        values = np.full((len(self.rows), self.width), np.nan)
        for i, row in enumerate(self.rows):
            for j, field in enumerate(row[: self.width]):
                if is_number(field):
                    values[i, j] = float(field)
        return values


def look_at_text(text: str) -> TableHead | None:
    """Look at a file's content as a table; see `look_at`."""
    return look_at(text[:HEAD_BYTES].encode("utf-8", "replace"))


@functools.lru_cache(maxsize=8)
def look_at(head: bytes) -> TableHead | None:
    """Look at a file's first bytes as a table; None if they hold no rows of text."""
    if b"\0" in head:
        return None
    lines = head.decode("utf-8", "replace").removeprefix("\ufeff").splitlines()
    if len(head) >= HEAD_BYTES:
        lines = lines[:-1]  # cut off by the limit
    comments: list[str] = []
    data: list[tuple[int, str]] = []
    for number, line in enumerate(lines, start=1):
        if line.strip().startswith(COMMENTS):
            if not data:
                comments.append(line)
        elif line.strip():
            data.append((number, line))
    if not data:
        return None
    is_row = [bool(re.search(r"\d", line)) for _, line in data]
    first = is_row.index(True) if any(is_row) else 0
    delimiter = _delimiter_of([line for _, line in data[first:][:6]])
    header, data = _split_header(data, delimiter)
    if not data:
        return None
    names = _names_of([line for _, line in header], comments, delimiter)
    rows = [_split(line, delimiter) for _, line in data]
    has_decimal_commas = delimiter in (";", "\t") and any(
        re.fullmatch(r"-?\d+,\d+", field) for row in rows[:20] for field in row
    )
    if has_decimal_commas:
        rows = [[field.replace(",", ".") for field in row] for row in rows]
    if header and names and len(rows[0]) == len(names) + 1 and not is_missing(rows[0][-1]):
        names = ("", *names)  # an index without a name
    return TableHead(
        delimiter,
        names,
        not header and names is not None,
        header[-1][0] if header else 0,
        has_decimal_commas,
        tuple(map(tuple, rows)),
    )


def _split_header(
    data: list[tuple[int, str]], delimiter: str | None
) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    """Divide numbered lines into those before the first number and the rows."""
    for i, (_, line) in enumerate(data[: _MAX_HEADER_LINES + 1]):
        # Numbers may have decimal commas.
        if any(is_number(field.replace(",", ".")) for field in _split(line, delimiter)):
            return data[:i], data[i:]
    return data, []


def _names_of(
    header: list[str], comments: list[str], delimiter: str | None
) -> tuple[str, ...] | None:
    """The names of the columns: of a header's line, or of a comment that names a pose."""
    tried = [_header(line, delimiter) for line in header]
    if not header:
        texts = [comment.strip().lstrip("#% ") for comment in reversed(comments)]
        tried = [_header(text, mark) for text in texts for mark in (delimiter, ",", None)]
    named = next((names for names in tried if find_layout(names)), None)
    return tried[0] if header and named is None else named


def _delimiter_of(lines: list[str]) -> str | None:
    """The delimiter of most of some lines."""
    for mark in (";", "\t", ","):
        if 2 * sum(mark in line.strip() for line in lines) > len(lines):
            has_spaces = mark == "\t" and any(
                " " in field.strip() for line in lines[1:] for field in line.split(mark)
            )
            return None if has_spaces else mark
    return None


def _split(line: str, delimiter: str | None) -> list[str]:
    stripped = line.strip(" \r\n") if delimiter == "\t" else line.strip()
    return [field.strip().strip("\"'") for field in stripped.split(delimiter)]


def _header(line: str, delimiter: str | None) -> tuple[str, ...]:
    """Names of columns; units in brackets stay with their name where spaces divide."""
    if delimiter is None:
        line = re.sub(r"\s+([\[(][^\])]*[\])])", r"\1", line)
        line = re.sub(r"\(([^)]*)\)|\[([^\]]*)\]", lambda m: m[0].replace(" ", ""), line)
    return tuple(_split(line, delimiter))
