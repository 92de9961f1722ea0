import csv
import json

import pytest

from vioapr.fusion.methods import METHODS


def test_tables_and_files(run, walk_dir, tmp_path):
    root = walk_dir.parent.parent
    code, out, err = run(
        "evaluate", root, "--json", tmp_path / "out.json", "--csv", tmp_path / "frames.csv"
    )
    assert code == 0, err
    for words in ("Set, VIO sim, regressor net", "only keyframes", "all frames", "raw"):
        assert words in out
    (group,) = json.loads((tmp_path / "out.json").read_text())
    assert (group["set"], group["vio"], group["apr"]) == ("Set", "sim", "net")
    with (tmp_path / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * 60
    assert {row["method"] for row in rows} == {"apr", "vio", "vio-apr", "consensus"}


@pytest.mark.slow
def test_the_report_is_written(run, walk_dir, tmp_path):
    code, out, err = run(
        "evaluate", walk_dir, "--methods", "apr,vio-apr", "--report", tmp_path / "report"
    )
    assert code == 0, err
    assert (tmp_path / "report" / "index.html").exists()
    assert str(tmp_path / "report" / "index.html") in out


def test_parameters_reach_the_method(run, walk_dir, tmp_path):
    shares = []
    for threshold in ("0.05", "2.0"):
        run("evaluate", walk_dir, "--methods", "vio-apr", "--d-th", threshold, "--o-th", "10",
            "--json", tmp_path / "out.json", "--overwrite")  # fmt: skip
        (group,) = json.loads((tmp_path / "out.json").read_text())
        shares.append(group["rows"][0]["fused"]["share"])
    assert shares[0] < shares[1]


def test_help_names_every_method(run):
    code, out, _ = run("evaluate", "--help")
    assert code == 0
    assert all(name in out for name in METHODS)


@pytest.mark.parametrize(
    ("methods", "message"),
    [
        ("apr,magic", "unknown method 'magic'"),
        (",", "expected names from apr, vio"),
        ("apr,apr", "apr is named twice"),
    ],
)
def test_bad_methods(fails, walk_dir, methods, message):
    assert message in fails("evaluate", walk_dir, "--methods", methods)


def test_bad_walks(fails, walk_dir, tmp_path):
    assert "expected a folder with walks, got nothing" in fails("evaluate", tmp_path / "no")
    (walk_dir / "gt.tum").write_text("0 0 0\n")
    line = fails("evaluate", walk_dir)
    assert f"{walk_dir / 'gt.tum'}" in line


def test_no_walks_named(fails):
    assert "WALKS" in fails("evaluate").upper()
