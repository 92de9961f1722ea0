import os
from pathlib import Path

import numpy as np
import pytest

from vioapr.errors import (
    AlreadyExistsError,
    DiskFullError,
    FileMissingError,
    FormatError,
)
from vioapr.files import append_table, tables
from vioapr.files.append_table import AppendTable, finite_numbers, read_blocks
from vioapr.files.tables import (
    all_numbers,
    format_field,
    format_rows,
    head_rows,
    parse_rows,
    read_headed_csv,
    to_ticks,
)
from vioapr.formats import table_rows
from vioapr.formats.base import ReadOptions
from vioapr.formats.table_head import look_at
from vioapr.formats.table_rows import read_columns
from vioapr.formats.times import seconds_of

PATH = Path("walk.txt")


def test_rows_know_their_lines():
    rows = parse_rows(PATH, "# head\n\n1 2\n  3\t4 \n", range(2, 3), what="a b")
    assert rows.lines == [3, 4]
    assert rows.column(1) == ["2", "4"]
    np.testing.assert_array_equal(rows.numbers([1, 0]), [[2, 1], [4, 3]])
    assert rows.at([1]).lines == [4]


def test_fields_between_commas_are_stripped_and_headers_skipped():
    rows = parse_rows(PATH, "x, y\n1, 2\n", range(2, 3), what="x,y", delimiter=",", skip=1)
    assert rows.fields == [["1", "2"]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "walk.txt: expected rows of a b, got none"),
        ("# only a comment\n", "expected rows of a b, got none"),
        ("1 2\n3\n", "walk.txt:2: expected 2 columns .a b., got 1"),
        ("1 2\n3 x\n", "walk.txt:2: expected a number, got 'x'"),
    ],
)
def test_a_bad_table_is_named_with_its_line(text, message):
    with pytest.raises(FormatError, match=message):
        parse_rows(PATH, text, range(2, 3), what="a b").numbers(slice(None))


def test_missing_numbers_are_nan():
    rows = parse_rows(PATH, "1,,NaN\nnull,None,n/a\n", range(3, 4), what="a", delimiter=",")
    np.testing.assert_array_equal(rows.numbers(slice(None)), [[1, *[np.nan] * 2], [np.nan] * 3])


def test_a_last_row_that_was_cut_off_is_a_problem():
    rows = parse_rows(PATH, "1 2\n1 2\n3", range(2, 3), what="a b")
    assert rows.lines == [1, 2]
    assert rows.problems[3].error == "expected 2 columns (a b), got 1"
    for complete in ("1 2\n3\n", "3\n1 2\n3", "1 2\n3 4 5"):
        with pytest.raises(FormatError, match="expected 2 columns"):
            parse_rows(PATH, complete, range(2, 3), what="a b")


@pytest.mark.parametrize("part", [1, 7, 1 << 20])
def test_text_is_split_in_parts_as_it_is_whole(part, monkeypatch):
    text = "".join(f"{row} {row / 7}\n# comment\n" for row in range(50))
    whole = np.array([[row, row / 7] for row in range(50)])
    monkeypatch.setattr(tables, "_PART_CHARACTERS", part)
    monkeypatch.setattr(table_rows, "_PART_ROWS", part)
    head = look_at(text.encode())
    columns = read_columns(PATH, head, text, range(2), "a b", [1])
    np.testing.assert_array_equal(columns.values, whole)
    assert columns.rows.lines == list(range(1, 100, 2))
    assert columns.ticks == list(range(50))
    assert columns.texts == ([f"{row / 7}" for row in range(50)],)


def test_headed_columns_come_in_the_order_asked_for(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("# t, x ,y\n1,2,3\n")
    assert read_headed_csv(path, ("y", "t")).fields == [["3", "1"]]
    with pytest.raises(FormatError, match="table.csv:1: expected a header with the columns z"):
        read_headed_csv(path, ("t", "z"))
    with pytest.raises(FileMissingError):
        read_headed_csv(tmp_path / "none.csv", ("t",))


def test_nanoseconds_since_1970_are_rounded_once():
    rows = parse_rows(PATH, "1403636579763555584", range(1, 2), what="t")
    assert rows.ticks(0) == [1403636579763555584]
    (seconds,) = seconds_of(PATH, rows.ticks(0), ReadOptions(), fixed="ns")
    assert seconds == 1403636579763555584 / 10**9
    assert to_ticks(np.array([0.1, seconds]), 1000) == [100, 1403636579764]
    assert to_ticks(np.array([0.5, -0.5, 1.5]), 1) == [1, 0, 2]  # halves are rounded up


@pytest.mark.parametrize(
    ("value", "field"),
    [(0.1, "0.1"), (np.float64(1 / 3), repr(1 / 3)), (7, "7"), ("a", "a"), (None, ""),
     (float("nan"), "")],
)  # fmt: skip
def test_fields(value, field):
    assert format_field(value) == field


def test_what_is_written_is_read_with_all_digits(rng):
    values = rng.normal(size=(20, 3)) * 10.0 ** rng.integers(-300, 300, size=(20, 3))
    rows = parse_rows(PATH, format_rows(values.tolist(), ","), range(3, 4), what="n", delimiter=",")
    np.testing.assert_array_equal(rows.numbers(slice(None)), values)


def test_the_head_of_a_file_is_sniffed_without_a_torn_row():
    assert head_rows(b"# c\n1 2\n\n3 4") == [["1", "2"], ["3", "4"]]
    long = b"1 2\n" * 10000
    assert len(head_rows(long)) == 20
    assert head_rows(b"1 2" * 10000) == []  # one line, cut off
    assert head_rows(b"1\0 2") == []
    assert all_numbers([["1", "2e3"]], range(2, 3))
    assert not all_numbers([["1", "x"]], range(2, 3))
    assert not all_numbers([], range(2, 3))


def test_a_growing_table_is_read_as_far_as_it_is_whole(tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    with AppendTable(path, "t,x") as table:
        for row in range(5):
            table.append(f"{row},{row / 4}")
        table.append("5\n6,nan\n7,hello\n8,")
    with path.open("a") as file:
        file.write("9,0.1")
    monkeypatch.setattr(append_table, "BLOCK_ROWS", 2)
    problems, values, lines = [], [], []
    for block in read_blocks(path, "t,x", problems):
        kept, numbers = finite_numbers(block, [0, 1], problems)
        values += numbers.tolist()
        lines += kept.lines
    np.testing.assert_array_equal(values, [[row, row / 4] for row in range(5)] + [[8, np.nan]])
    assert lines == [2, 3, 4, 5, 6, 10]
    found = {problem.line: (problem.text, problem.is_error) for problem in problems}
    assert found[7] == ("expected 2 fields, got 1", True)
    assert found[8] == ("expected a finite number, got 'nan'", True)
    assert found[9] == ("expected a finite number, got 'hello'", True)
    assert found[11][0].startswith("the last line is cut off")
    assert not found[11][1]


def test_a_growing_table_never_replaces_another(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("precious")
    with pytest.raises(AlreadyExistsError, match="table.csv: expected to write a new file"):
        AppendTable(path, "t")
    assert path.read_text() == "precious"
    with pytest.raises(FormatError, match="table.csv:1: expected the header t, got 'precious'"):
        list(read_blocks(path, "t", []))
    with pytest.raises(FileMissingError):
        list(read_blocks(tmp_path / "none.csv", "t", []))


def test_a_full_disk_leaves_whole_lines(tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    table = AppendTable(path, "t")
    table.append("1")
    write = os.write

    def fill(file, content):
        if len(content) > 2:
            return write(file, content[:2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("vioapr.files.append_table.os.write", fill)
    with pytest.raises(DiskFullError, match="table.csv: cannot be written: No space left"):
        table.append("234")
    table.close()
    assert path.read_text() == "t\n1\n"
