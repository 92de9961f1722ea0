import csv
import json
import shutil

import pytest

from vioapr.fusion.methods import METHODS


@pytest.mark.slow
def test_tables_and_files(run, walk_dir, tmp_path):
    root = walk_dir.parent.parent
    code, out, err = run(
        "evaluate", root, "--json", tmp_path / "out.json", "--csv", tmp_path / "frames.csv"
    )
    assert code == 0, err
    for words in ("Set, VIO sim, regressor net", "only keyframes", "all frames", "raw"):
        assert words in out
    assert "Set, VIO sim, regressor net: content jumps and stated sigmas" in out
    (group,) = json.loads((tmp_path / "out.json").read_text())
    jumps = {row["method"]: row["figures"]["jumps_per_min"] for row in group["reliability"]}
    assert jumps["vio"] == 0 < jumps["vio-apr"] < jumps["apr"]
    assert (group["set"], group["vio"], group["apr"]) == ("Set", "sim", "net")
    with (tmp_path / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * 60
    assert {row["method"] for row in rows} == {"apr", "vio", "vio-apr", "chain"}


def test_csv_has_the_second_tables_figures_in_the_rows_of_all_frames(run, walk_dir):
    command = ("evaluate", walk_dir, "--methods", "vio-apr,chain")
    code, out, err = run(*command, "--format", "csv")
    assert code == 0, err
    rows = list(csv.DictReader(out.splitlines()))
    assert [row["method"] for row in rows] == [*["vio-apr"] * 4, "chain"]
    (group,) = json.loads(run(*command, "--json", "-")[1])
    figures = {row["method"]: row["figures"] for row in group["reliability"]}
    for row in rows:
        for name, value in figures[row["method"]].items():
            is_known = value is not None and row["frames"] == "all frames"
            assert row[name] == (repr(value) if is_known else "")
    assert figures["chain"]["risk_50_m"] > 0


@pytest.mark.slow
def test_the_report_is_written(run, walk_dir, tmp_path):
    code, out, err = run(
        "evaluate", walk_dir, "--methods", "apr,vio-apr", "--report", tmp_path / "report"
    )
    assert code == 0, err
    assert (tmp_path / "report" / "index.html").exists()
    assert str(tmp_path / "report" / "index.html") in out


@pytest.mark.slow
def test_parameters_reach_the_method(run, walk_dir, tmp_path):
    shares = []
    for threshold in ("0.05", "2.0"):
        run("evaluate", walk_dir, "--methods", "vio-apr", "--d-th", threshold, "--o-th", "10",
            "--json", tmp_path / "out.json", "--overwrite")  # fmt: skip
        (group,) = json.loads((tmp_path / "out.json").read_text())
        shares.append(group["rows"][0]["fused"]["share"])
    assert shares[0] < shares[1]


def test_a_flag_that_no_method_takes_is_refused(run, fails, walk_dir):
    line = fails("evaluate", walk_dir, "--methods", "apr,chain", "--d-th", "1")
    assert "--d-th is a flag of methods vio, vio-apr: expected flags of apr, chain" in line
    code, _, err = run("evaluate", walk_dir, "--methods", "apr,vio-apr", "--d-th", "1")
    assert (code, err) == (0, "")


def test_offline_uses_the_future_by_the_methods_that_can(run, walk_dir, tmp_path):
    medians = {}
    for name, flags in (("live", []), ("after", ["--offline"])):
        path = tmp_path / f"{name}.json"
        code, out, err = run("evaluate", walk_dir, "--methods", "apr,chain", *flags, "--json", path)
        assert code == 0, err
        assert ("after the walk: chain; as it happened: apr" in out) == bool(flags)
        (group,) = json.loads(path.read_text())
        medians[name] = {row["method"]: row["fused"]["median_m"] for row in group["rows"]}
    assert medians["live"]["apr"] == medians["after"]["apr"]
    assert medians["live"]["chain"] != medians["after"]["chain"]


def test_offline_needs_a_method_that_can(fails, walk_dir):
    message = fails("evaluate", walk_dir, "--methods", "apr,vio", "--offline")
    assert "--offline: no method of --methods can: add chain" in message


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


@pytest.fixture
def walks_dir(walk_dir):
    """A folder Set with a walk, and five that cannot be evaluated."""
    root = walk_dir.parent
    for name in ("broken", "late", "no-gt", "twice", "other-vio"):
        shutil.copytree(walk_dir, root / name)
    (root / "broken" / "gt.tum").write_text("1 2 three\n")
    gt = [line.split() for line in (walk_dir / "gt.tum").read_text().splitlines()]
    moved = [" ".join([str(float(row[0]) + 9e4), *row[1:]]) for row in gt if row[0] != "#"]
    (root / "late" / "gt.tum").write_text("\n".join(moved) + "\n")
    (root / "no-gt" / "gt.tum").unlink()
    shutil.copy(walk_dir / "gt.tum", root / "twice" / "gt.txt")
    (root / "other-vio" / "vio_bad.tum").write_bytes(b"\0\1\2")
    return root


@pytest.mark.slow
def test_what_cannot_be_evaluated_is_named_and_the_rest_is(run, walks_dir, tmp_path):
    code, out, err = run("evaluate", walks_dir, "--methods", "apr", "--csv", tmp_path / "out.csv")
    assert code == 0
    assert "Set, VIO sim, regressor net: 2 walks" in out  # walk and other-vio
    said = [line for line in err.splitlines() if line.startswith("WARNING skipped: ")]
    reasons = {
        walks_dir / "broken" / "gt.tum": ": expected",
        walks_dir / "late": "no frame has ground truth: no common times",
        walks_dir / "no-gt": "expected a walk with a file gt.*, found none",
        walks_dir / "twice": "expected one ground truth file gt.*, got gt.tum, gt.txt",
        walks_dir / "other-vio" / "vio_bad.tum": "expected a trajectory, got binary content",
    }
    assert len(said) == len(reasons)
    for path, reason in reasons.items():
        (line,) = (line for line in said if str(path) in line)
        assert reason in line
    with (tmp_path / "out.csv").open() as file:
        assert {row["walk"] for row in csv.DictReader(file)} == {"walk", "other-vio"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["broken", "late", "no-gt", "twice", "other-vio"])
def test_strict_evaluates_nothing_of_what_is_not_whole(fails, walks_dir, tmp_path, name):
    folders = (walks_dir / "walk", walks_dir / name)
    json_out = ("--json", tmp_path / "out.json")
    assert str(walks_dir / name) in fails("evaluate", *folders, "--strict", *json_out)
    assert not (tmp_path / "out.json").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["broken", "late", "no-gt", "twice"])
def test_nothing_left_is_an_error(run, walks_dir, name):
    code, out, err = run("evaluate", walks_dir / name)
    assert (code, out) == (2, "")
    *warnings, error = err.splitlines()
    assert all(line.startswith("WARNING ") for line in warnings)
    assert error.startswith("error: ")
    assert str(walks_dir / name) in error


def test_folders_without_walks_are_left_out_too(run, walk_dir, tmp_path):
    (tmp_path / "empty").mkdir()
    code, out, err = run("evaluate", tmp_path / "empty", walk_dir, "--methods", "apr")
    assert code == 0
    assert "1 walk" in out
    assert f"WARNING skipped: {tmp_path / 'empty'}: expected walks" in err


def test_no_walks_named(fails):
    assert "WALKS" in fails("evaluate").upper()
