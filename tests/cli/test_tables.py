import csv
import io
import re

import pytest

from vioapr.cli.tables import Column, Row, Table, arrange, draw, to_csv, to_markdown

WORDS = ("a device of a long name", "ARKit")


def make_table(rows=3):
    columns = (
        Column("device", is_figure=False),
        Column("tracker", is_figure=False),
        *(Column(f"figure number {i}") for i in range(8)),
        Column("raw", stays_with_last=True),
    )
    made = [
        Row(
            (*WORDS, *(f"{i}.{j:04d} / 12.345" for j in range(8)), "99.9"),
            {"name": f"row {i}", "value": i / 3, "unknown": None, "nan": float("nan")},
        )
        for i in range(rows)
    ]
    return Table("a table of figures", columns, [made[:1], made[1:]])


@pytest.mark.parametrize("columns", [20, 30, 40, 60, 80, 120, 200, 400])
def test_nothing_is_cut_at_any_width(columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    table = make_table()
    draw(table)
    out = capsys.readouterr().out
    if columns >= 40:
        assert max(map(len, out.splitlines())) <= columns
    assert "…" not in out
    for row in table.rows:
        for cell in row.cells[2:]:
            assert cell in out
    figures = [column.header for column in table.columns if column.is_figure]
    for word in " ".join([*WORDS, *figures]).split():
        assert word in out


def test_bands_repeat_what_names_a_row_and_keep_pairs_together():
    table = make_table()
    bands = arrange(table, 80)
    assert len(bands) > 1
    assert all(list(band)[:2] == [0, 1] for band in bands)
    assert sorted(i for band in bands for i in list(band)[2:]) == list(range(2, 11))
    assert all((9 in band) == (10 in band) for band in bands)
    assert len(arrange(table, 1000)) == 1
    assert arrange(table, 20) == []  # a paragraph a row


def test_columns_without_content_are_left_out():
    table = Table("", (Column("a"), Column("")), [[Row(("1", ""), {})]])
    assert [list(band) for band in arrange(table, 80)] == [[0]]


def test_wide_characters_take_two_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    columns = (Column("名前", is_figure=False), Column("m"))
    draw(Table("", columns, [[Row(("中庭の歩行", "1.0"), {}), Row(("x", "22.0"), {})]]))
    _, line, first, second = capsys.readouterr().out.splitlines()
    assert first.endswith("中庭の歩行   1.0")
    assert second == "x           22.0"
    assert line == "─" * 10 + "  " + "─" * 4


def test_csv_has_values_with_all_digits_and_a_header_for_each_kind():
    table = make_table(2)
    other = Table("", (Column("x"),), [[Row(("1",), {"x": 1, "text": "a, b"}), Row(("",), {})]])
    first, second = to_csv([table, table, other]).split("\n\n")
    rows = list(csv.DictReader(io.StringIO(first)))
    assert [row["name"] for row in rows] == ["row 0", "row 1"] * 2
    assert float(rows[1]["value"]) == 1 / 3
    assert rows[0]["unknown"] == rows[0]["nan"] == ""
    assert list(csv.DictReader(io.StringIO(second))) == [{"x": "1", "text": "a, b"}]


def test_markdown_escapes_its_own_signs():
    columns = (Column("a|b", is_figure=False), Column("c"))
    lines = to_markdown(Table("t", columns, [[Row(("x | y", "1"), {})]])).splitlines()
    assert lines == ["**t**", "", "| a\\|b | c |", "| --- | ---: |", "| x \\| y | 1 |"]


@pytest.mark.slow
def test_tables_of_verbs_follow_the_terminal_and_formats(run, walk_dir, monkeypatch):
    folder = walk_dir.parent
    monkeypatch.setenv("COLUMNS", "60")
    for arguments in (("evaluate", folder, "--methods", "vio-apr"), ("vio-quality", folder)):
        code, out, err = run(*arguments)
        assert code == 0, err
        assert max(map(len, out.splitlines())) <= 60
        assert "…" not in out
    code, out, err = run("evaluate", folder, "--methods", "apr,vio-apr", "--format", "csv")
    rows = list(csv.DictReader(io.StringIO(out)))
    assert [row["method"] for row in rows][:1] == ["apr"]
    assert 0 < float(rows[0]["median_m"]) < 10
    out = run("evaluate", folder, "--methods", "apr", "--format", "markdown")[1]
    assert re.search(r"^\| apr \| all frames \| 100.0 % \|", out, flags=re.M)
    same = [run("evaluate", folder, "--methods", "apr", *how)[1] for how in (
        ("--format", "json"), ("--json", "-"),
    )]  # fmt: skip
    assert same[0] == same[1]
    assert same[0].startswith("[")
