"""Tables as text for people, Markdown, CSV and JSON; nothing in them is ever cut.

The columns of a table that is wider than the terminal come in bands below each other, in each of
which the columns that name a row are repeated. These wrap between words if they must. On a
terminal too narrow even for that, every row is a paragraph.
"""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro
from rich.cells import cell_len

from vioapr.cli.console import emit, explain, say, send_messages_aside, width
from vioapr.files.tables import format_field
from vioapr.schemas.base import Record, encode

Format = Annotated[Literal["table", "csv", "json", "markdown"], tyro.conf.arg(name="format")]
"""The type of a verb's flag --format."""

Value = str | float | int | bool | None
"""Of a row, for programs."""

_GAP = 2


@dataclass(frozen=True)
class Column:
    """A column for people.

    Attributes:
        header: Above it.
        is_figure: Whether it holds figures: set to the right, and never broken. Columns of
            words before the first figure name the row.
        stays_with_last: Whether it makes no sense without the column before it.
    """

    header: str
    is_figure: bool = True
    stays_with_last: bool = False


@dataclass(frozen=True)
class Row:
    """A row: for people a text for each column, for programs values by name, if it has any."""

    cells: tuple[str, ...]
    values: Mapping[str, Value]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: Above it.
        columns: For people.
        sections: Rows, in sections; a line is left free around those of several rows.
    """

    title: str
    columns: tuple[Column, ...]
    sections: Sequence[Sequence[Row]]

    @property
    def rows(self) -> list[Row]:
        """All rows."""
        return [row for section in self.sections for row in section]


def show(
    tables: Sequence[Table], form: str, record: Record | Sequence[Record], notes: Sequence[str] = ()
) -> None:
    """Print tables in one of the forms; with CSV and JSON, messages go to standard error.

    Args:
        tables: In order.
        form: table, csv, json or markdown.
        record: What JSON is made of: more than is in the tables, as documented in schema/.
        notes: How to read the tables, for people.
    """
    if form in ("csv", "json"):
        send_messages_aside()
        emit(to_csv(tables) if form == "csv" else encode(record, indent=1))
        return
    for table in tables:
        if form == "markdown":
            say(to_markdown(table))
        else:
            draw(table)
    for text in notes:
        if form == "markdown":
            say(text + "\n")
        else:
            explain(text)


def draw(table: Table) -> None:
    """Print a table for people at the terminal's width."""
    if table.title:
        explain(table.title, style="bold")
    bands = arrange(table, width())
    for number, band in enumerate(bands):
        if number:
            say("")
        for line, style in _lines(table, band):
            say(line, style)
    if not bands:
        for line, style in _stacked_lines(table):
            say(line, style)
    if table.title:
        say("")


def arrange(table: Table, columns: int) -> list[dict[int, int]]:
    """Arrange a table's columns in bands that are not wider than a terminal.

    Args:
        table: To arrange.
        columns: Of the terminal.

    Returns:
        For each band, the widths of its columns by their number; nothing where not even one
        column fits beside those that name a row.
    """
    least, most = _widths(table)
    first = next((i for i, c in enumerate(table.columns) if c.is_figure), len(table.columns))
    keys, units = list(range(first)), _units(table, first)
    room = columns - max((_total(least, unit) + _GAP for unit in units), default=0)
    least[:first] = _shrink(least[:first], most[:first], room)
    if _total(least, keys) > room:
        return []
    bands: list[list[int]] = [list(keys)]
    for unit in units:
        if bands[-1] != keys and _total(least, [*bands[-1], *unit]) > columns:
            bands.append(list(keys))
        bands[-1] += unit
    return [_stretch(band, least, most, columns) for band in bands]


def _widths(table: Table) -> tuple[list[int], list[int]]:
    """Least and natural widths of all columns."""
    least: list[int] = []
    most: list[int] = []
    for number, column in enumerate(table.columns):
        cells = [row.cells[number] for row in table.rows]
        words = [word for text in (column.header, *cells) for word in text.split()]
        whole = max(map(cell_len, cells), default=0)
        longest = max(map(cell_len, words), default=0)
        least.append(max(longest, whole) if column.is_figure else longest)
        most.append(max(whole, cell_len(column.header)))
    return least, most


def _units(table: Table, first: int) -> list[list[int]]:
    """Columns from a first one, together with those that stay with them."""
    units: list[list[int]] = []
    for number in range(first, len(table.columns)):
        is_empty = not table.columns[number].header and not any(r.cells[number] for r in table.rows)
        if is_empty:
            continue
        if units and table.columns[number].stays_with_last:
            units[-1].append(number)
        else:
            units.append([number])
    return units


def _total(widths: Sequence[int], columns: Sequence[int]) -> int:
    return sum(widths[i] for i in columns) + _GAP * max(len(columns) - 1, 0)


def _shrink(least: Sequence[int], most: Sequence[int], room: int) -> list[int]:
    """Take width from columns of words, the widest first, until they fit or words would break."""
    widths = list(most)
    while _total(widths, range(len(widths))) > room:
        wider = [i for i, width in enumerate(widths) if width > least[i]]
        if not wider:
            break
        widths[max(wider, key=widths.__getitem__)] -= 1
    return widths


def _stretch(
    band: list[int], least: Sequence[int], most: Sequence[int], columns: int
) -> dict[int, int]:
    """Give columns that wrap what is left of the width, from the left."""
    widths = {i: least[i] for i in band}
    spare = columns - _total(least, band)
    for i in band:
        more = min(max(spare, 0), max(most[i] - least[i], 0))
        widths[i] += more
        spare -= more
    return widths


def _lines(table: Table, widths: Mapping[int, int]) -> list[tuple[str, str]]:
    """The lines of a band, each with its style."""
    lines: list[tuple[str, str]] = []
    if any(table.columns[i].header for i in widths):
        headers = {i: table.columns[i].header for i in widths}
        lines += [(line, "bold") for line in _join(table, headers, widths)]
        lines.append(((" " * _GAP).join("─" * w for w in widths.values()), "dim"))
    for number, section in enumerate(table.sections):
        if number and len(section) + len(table.sections[number - 1]) > 2:
            lines.append(("", ""))
        for row in section:
            cells = {i: row.cells[i] for i in widths}
            lines += [(line, "") for line in _join(table, cells, widths)]
    return lines


def _stacked_lines(table: Table) -> list[tuple[str, str]]:
    """A paragraph a row, for a terminal too narrow for columns; each line with its style."""
    lines: list[tuple[str, str]] = []
    names = [column.header for column in table.columns if not column.is_figure]
    seen = [""] * len(names)
    for row in table.rows:
        # An empty cell is as the one above.
        seen = [cell or above for cell, above in zip(row.cells, seen, strict=False)]
        lines.append((" ".join(filter(None, seen)), "bold"))
        for column, cell in zip(table.columns, row.cells, strict=True):
            if column.is_figure and cell:
                lines.append((f"  {column.header} {cell}".rstrip(), ""))
    return lines


def _join(table: Table, cells: Mapping[int, str], widths: Mapping[int, int]) -> list[str]:
    """One row as lines: cells that wrap go on below."""
    wrapped = {
        i: textwrap.wrap(text, widths[i], break_on_hyphens=False) or [""]
        for i, text in cells.items()
    }
    lines: list[str] = []
    for number in range(max(map(len, wrapped.values()))):
        parts: list[str] = []
        for i, texts in wrapped.items():
            text = texts[number] if number < len(texts) else ""
            padding = " " * (widths[i] - cell_len(text))
            parts.append(padding + text if table.columns[i].is_figure else text + padding)
        lines.append((" " * _GAP).join(parts).rstrip())
    return lines


def to_markdown(table: Table) -> str:
    """A table for a Markdown page."""
    rows = [
        [column.header for column in table.columns],
        ["---:" if column.is_figure else "---" for column in table.columns],
        *(row.cells for row in table.rows),
    ]
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join([*([f"**{table.title}**", ""] if table.title else []), *lines, ""])


def to_csv(tables: Sequence[Table]) -> str:
    """Tables of one kind below one header; those of other columns after an empty line."""
    text = io.StringIO()
    header: list[str] | None = None
    writer = csv.writer(text, lineterminator="\n")
    for row in (row for table in tables for row in table.rows if row.values):
        if list(row.values) != header:
            if header is not None:
                text.write("\n")
            header = list(row.values)
            writer.writerow(header)
        writer.writerow(map(format_field, row.values.values()))
    return text.getvalue()
