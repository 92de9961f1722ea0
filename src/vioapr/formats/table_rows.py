"""Columns of text tables as numbers, whatever the delimiter."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import Rows, is_missing, is_number, split_rows
from vioapr.files.text import read_text
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.columns import names_degrees
from vioapr.formats.poses import poses_of
from vioapr.formats.table_head import COMMENTS, TableHead, look_at_text
from vioapr.formats.tracking_states import mark_lost_rows
from vioapr.geometry.rigid import Rigid3

_PART_ROWS = 4096
_MAX_NAMED = 12


@dataclass(frozen=True)
class Columns:
    """Some columns of a table.

    Attributes:
        rows: Where each row came from; without fields.
        values: The columns asked for as numbers, shape (n, columns).
        ticks: The first of them, whole numbers exact.
        texts: The columns asked for as text, one list each.
        time_unit: Unit of the times, where the header names it.
    """

    rows: Rows
    values: NDArray[np.float64]
    ticks: list[int | float]
    texts: tuple[list[str], ...] = ()
    time_unit: TimeUnit | None = None


def read_columns(
    path: Path,
    head: TableHead,
    text: str,
    numbers: Sequence[int],
    what: str,
    texts: Sequence[int] = (),
) -> Columns:
    """Read some columns of a table as numbers, and some as text.

    Text takes ten times the room of numbers, so it is read a part at a time.

    Args:
        path: For messages.
        head: Of the file.
        text: The content.
        numbers: Columns to read as numbers.
        what: The columns, for messages.
        texts: Columns to read as text.

    Raises:
        FormatError: No rows, one with another number of columns, or a field that is no number.
    """
    last = max(*numbers, *texts)
    if last >= head.width:
        problem = f"expected at least {last + 1} columns, as the header names, got {head.width}"
        raise FormatError(path, f"{problem}: expected {what}")
    out = Rows(path, [], [])
    parts: list[NDArray[np.float64]] = []
    ticks: list[int | float] = []
    kept: tuple[list[str], ...] = tuple([] for _ in texts)
    rows = split_rows(
        path,
        text,
        range(head.width, head.width + 1),
        what=what,
        delimiter=head.delimiter,
        comment=COMMENTS,
        skip=head.header_lines,
        cut_off=out.problems,
    )
    while part := list(itertools.islice(rows, _PART_ROWS)):
        lines = [line for line, _ in part]
        picked = [[row[i].strip("\"'") for i in numbers] for _, row in part]
        if head.has_decimal_commas:
            picked = [[field.replace(",", ".") for field in row] for row in picked]
        selected = Rows(path, picked, lines)
        _replace_dates(selected)
        parts.append(selected.numbers(slice(None)))
        ticks += selected.ticks(0)
        for column, fields in zip(texts, kept, strict=True):
            fields += [row[column].strip("\"'") for _, row in part]
        out.lines.extend(lines)
    if not out.lines:
        raise FormatError(path, f"expected rows of {what}, got none: the file is empty")
    out.fields.extend([] for _ in out.lines)
    return Columns(out, np.concatenate(parts), ticks, kept)


def _replace_dates(rows: Rows) -> None:
    """Make dates in the first column seconds since 1970, UTC where they do not say."""
    for row in rows.fields:
        if not is_number(row[0]) and re.match(r"\d{4}-\d\d-\d\d", row[0]):
            try:
                date = datetime.fromisoformat(row[0])
            except ValueError:
                return
            date = date if date.tzinfo else date.replace(tzinfo=UTC)
            row[0] = repr(date.timestamp())


def read_ordered(
    path: Path, options: ReadOptions, what: str, quat_order: str
) -> tuple[Columns, Rigid3]:
    """Read a table of time, x, y, z and a quaternion in this order; more columns may follow.

    Args:
        path: The file.
        options: Where notes go.
        what: The columns, for messages.
        quat_order: "xyzw" or "wxyz".

    Raises:
        FileError: It cannot be read or is malformed, naming file and line, or its header names
            another order.
    """
    text = read_text(path)
    head = look_at_text(text)
    if head is None:
        raise FormatError(path, f"expected rows of {what}, got none")
    layout = head.layout
    if layout is not None and not layout.is_in_order(quat_order):
        named = ", ".join(name for name in head.names or () if name)
        raise FormatError(path, f"expected columns {what}, but its header names them {named}")
    if layout is None and names_degrees(head.names or ()):
        named = ", ".join(name for name in head.names or () if name)
        raise FormatError(
            path, f"expected positions in metres, but its header names degrees: {named}"
        )
    if head.width < 8:
        line = head.header_lines + 1
        raise FormatError(path, f"expected 8 columns ({what}), got {head.width}", line)
    tracking = None if layout is None else layout.tracking
    states = () if tracking is None or tracking >= head.width else (tracking,)
    columns = read_columns(path, head, text, range(8), what, states)
    if layout is not None:
        columns = replace(columns, time_unit=layout.time_unit)
    names = layout.passed_over if layout is not None else ()
    further = [i for i, field in enumerate(head.rows[0][8:], 8) if not is_missing(field)]
    say_passed_over(path, options, len({*further} - {*states}), names)
    order = slice(4, 8) if quat_order == "xyzw" else [5, 6, 7, 4]
    poses = poses_of(columns.rows, columns.values[:, 1:4], columns.values[:, order])
    for i, fields in zip(states, columns.texts, strict=True):
        mark_lost_rows(path, columns.rows, (head.names or ())[i], fields, options)
    return columns, poses


def say_passed_over(
    path: Path, options: ReadOptions, count: int, names: Sequence[str] = ()
) -> None:
    """Note how many columns were not used, if any, and their names where they are all known."""
    if count:
        were = "column was" if count == 1 else "columns were"
        listed = ", ".join(names[:_MAX_NAMED]) if len(names) == count and all(names) else ""
        rest = f" and {count - _MAX_NAMED} more" if listed and count > _MAX_NAMED else ""
        text = f"{count} further {were} passed over" + (f": {listed}{rest}" if listed else "")
        options.note(path, text, is_warning=False)
