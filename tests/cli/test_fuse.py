import csv

import numpy as np
import pytest

from vioapr.cli import fuse as fuse_module
from vioapr.formats.registry import read_trajectory
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import fuse_walk
from vioapr.fusion.pairing import pair_frames
from vioapr.fusion.smoothing import SMOOTHERS, smooth_walk
from vioapr.fusion.types import Status
from vioapr.fusion.vio_apr import VioAprParams

BATCHED = [name for name, method in METHODS.items() if method.is_batched]


@pytest.fixture
def files(walk_dir):
    return "--apr", walk_dir / "apr_net.tum", "--vio", walk_dir / "vio_sim.tum"


def read_csv(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
@pytest.mark.parametrize("method", BATCHED)
def test_every_method_writes_a_row_a_frame(run, files, tmp_path, method):
    code, out, err = run("fuse", *files, "--method", method, "--out", tmp_path / "f.csv")
    assert code == 0, err
    rows = read_csv(tmp_path / "f.csv")
    assert list(rows[0])[:9] == ["timestamp_s", "status", "x", "y", "z", "qx", "qy", "qz", "qw"]
    assert len(rows) == 60
    assert {row["status"] for row in rows} <= {status.label for status in Status}
    assert "60 frames" in out


def test_the_csv_holds_the_librarys_poses(run, files, tmp_path, walk_dir):
    run("fuse", *files, "--method", "vio-apr", "--d-th", "0.7", "--o-th", "6", "--n", "3",
        "--t", "5", "--out", tmp_path / "f.csv", "--tum", tmp_path / "f.tum.gz")  # fmt: skip
    frames = pair_frames(read_trajectory(files[1]), read_trajectory(files[3]))
    expected = fuse_walk(METHODS["vio-apr"], VioAprParams(0.7, 6.0, 3, 5), frames)
    rows = read_csv(tmp_path / "f.csv")
    assert [row["status"] for row in rows] == [Status(s).label for s in expected.status]
    values = [[float(row[key]) for key in ("x", "y", "z")] for row in rows]
    np.testing.assert_array_equal(values, expected.world_from_cam.translation_m)
    fused = read_trajectory(tmp_path / "f.tum.gz")
    assert len(fused) == expected.is_localized.sum()


@pytest.mark.slow
def test_the_live_view_differs(run, files, tmp_path):
    run("fuse", *files, "--method", "vio-apr", "--out", tmp_path / "later.csv")
    run("fuse", *files, "--method", "vio-apr", "--view", "live", "--out", tmp_path / "live.csv")
    later, live = read_csv(tmp_path / "later.csv"), read_csv(tmp_path / "live.csv")
    keyframes = [sum(r["status"] == "keyframe" for r in rows) for rows in (later, live)]
    assert keyframes[0] > keyframes[1]


@pytest.mark.parametrize("method", SMOOTHERS)
def test_offline_writes_the_smoothers_poses(run, files, tmp_path, method):
    code, _, err = run("fuse", *files, "--method", method, "--offline", "--out", tmp_path / "f.csv")
    assert code == 0, err
    frames = pair_frames(read_trajectory(files[1]), read_trajectory(files[3]))
    chosen = METHODS[method]
    expected = smooth_walk(chosen, chosen.params_type(), frames)
    rows = read_csv(tmp_path / "f.csv")
    values = [[float(row[key]) for key in ("x", "y", "z")] for row in rows]
    np.testing.assert_array_equal(values, expected.world_from_cam.translation_m)
    sigmas = [float(row["sigma_position_m"]) for row in rows]
    np.testing.assert_array_equal(sigmas, expected.sigma_position_m)


def test_offline_needs_a_method_that_can(fails, files, tmp_path):
    message = fails("fuse", *files, "--method", "apr", "--offline", "--out", tmp_path / "f.csv")
    assert "can use the future: chain; apr cannot" in message
    assert not (tmp_path / "f.csv").exists()


def test_no_tum_file_where_nothing_is_localized(run, files, tmp_path):
    code, out, _ = run(
        "fuse", *files, "--method", "vio-apr", "--d-th", "0", "--out", tmp_path / "f.csv",
        "--tum", tmp_path / "f.tum",
    )  # fmt: skip
    assert code == 0
    assert "not written, no frame was localized" in out
    assert not (tmp_path / "f.tum").exists()


def test_the_help_names_every_method_and_unit(run):
    code, out, _ = run("fuse", "--help")
    assert code == 0
    assert all(name in out for name in METHODS)
    assert "--d-th" in out
    assert "largest difference between the distances" in " ".join(out.split())
    assert all(name in fuse_module.fuse.__doc__ for name in METHODS)


BAD_VALUES = [
    (("--d-th", "-1"), "--d-th: expected a number of at least 0, got -1.0"),
    (("--d-th", "wide"), "--d-th: expected a number, got 'wide' (see vioapr fuse --help)"),
    (("--o-th", "nan"), "--o-th: expected a number of at least 0, got nan"),
    (("--n", "0"), "--n: expected a whole number of at least 1, got 0"),
    (("--pose-graph-prior-sigma-m", "0"), "--pose-graph-prior-sigma-m: expected a number greater"),
    (("--n", "1.5"), "--n: expected a whole number, got '1.5'"),
    (("--method", "magic"), "unknown method 'magic': expected one of apr, vio, vio-apr"),
    (("--view", "both"), "--view: expected one of retrospective, live, got 'both'"),
    (("--tolerance-s", "-1"), "expected a time tolerance of at least 0 s, got -1.0"),
    (("--apr-format", "word"), "unknown format 'word': expected one of tum"),
    (("--colour", "red"), "unknown flag --colour (see"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "message"), BAD_VALUES, ids=lambda v: str(v)[:20])
def test_bad_values_get_one_line(fails, files, tmp_path, arguments, message):
    assert message in fails("fuse", *files, "--out", tmp_path / "f.csv", *arguments)
    assert not (tmp_path / "f.csv").exists()


RUN = b"".join(b"%d 1 2 3 0 0 0 1\n" % time for time in range(7))
TWO_RUNS = RUN + RUN
BAD_FILES = [
    (b"", (": expected rows of", "empty file")),
    (b"# only a comment\n", (": expected rows of",)),
    (b"0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0\n", (":2: expected 8 columns",)),
    (b"0 1 2 3 0 0 0 1\n1 1 2 x 0 0 0 1\n", (":2: expected a number, got 'x'",)),
    (b"0 1 2 nan 0 0 0 1\n1 1 2 nan 0 0 0 1\n", (":1: expected finite numbers",)),
    (b"0 1 2 inf 0 0 0 1\n", (":1: expected finite numbers",)),
    (b"0 1 2 3 0 0 0 0\n", (":1: expected a unit quaternion, got one of norm 0",)),
    (b"0 1 2 3 0 0 0 2\n", (":1: expected a unit quaternion, got one of norm 2",)),
    (TWO_RUNS, (":8: expected increasing timestamps", "two runs?")),
    (b"1 1 2 3 0 0 0 1\n" * 9, (":2: expected increasing timestamps",)),
    (b"0 1 2 3 0 0 0 1\n\x00\xff\xfe\x00\n", (":2: expected text, got binary content",)),
    (b"\x1f\x8b\x08\x00broken", ("gzip",)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("content", "message"), BAD_FILES, ids=lambda v: str(v)[-30:])
def test_bad_files_get_one_line_that_names_them(fails, files, tmp_path, content, message):
    bad = tmp_path / "bad.tum"
    bad.write_bytes(content)
    for named in (["--apr-format", "tum"], []):
        out = "--out", tmp_path / "f.csv"
        line = fails("fuse", "--apr", bad, *files[2:], *named, *out, "--strict")
        assert str(bad) in line
        assert any(m in line for m in message), line


def test_missing_files_folders_and_strangers(fails, files, tmp_path):
    out = ("--out", tmp_path / "f.csv")
    assert "found none of this name" in fails("fuse", *files[:3], tmp_path / "no.tum", *out)
    assert "got a directory" in fails(
        "fuse", "--apr", tmp_path, *files[2:], "--apr-format", "tum", *out
    )
    stranger = tmp_path / "stranger"
    stranger.write_bytes(bytes(range(256)))
    assert "binary content" in fails("fuse", "--apr", stranger, *files[2:], *out)
    assert "cannot be written" in fails("fuse", *files, "--out", tmp_path)


def test_walks_that_do_not_meet(fails, files, tmp_path):
    late = tmp_path / "late.tum"
    late.write_text("".join(f"{1000 + k / 5} 0 0 0 0 0 0 1\n" for k in range(6)))
    line = fails("fuse", "--apr", late, *files[2:], "--out", tmp_path / "f.csv")
    assert "no prediction has a VIO pose" in line
    assert "cover 1000.000 to 1001.000 s" in line


@pytest.mark.slow
def test_predictions_without_vio_are_a_warning_with_the_flag(run, fails, files, tmp_path):
    gap, out = tmp_path / "gap.tum", ("--out", tmp_path / "f.csv")
    lines = files[3].read_text().splitlines()
    gap.write_text("\n".join([*lines[:20], *lines[24:]]) + "\n")
    code, _, err = run("fuse", *files[:2], "--vio", gap, *out)
    assert code == 0
    assert "4 of 60 predictions have no VIO pose within 0.01 s" in err
    assert "--tolerance-s" in err
    (tmp_path / "f.csv").unlink()
    assert "4 of 60 predictions" in fails("fuse", *files[:2], "--vio", gap, *out, "--strict")
    assert not (tmp_path / "f.csv").exists()


def test_required_options_are_named(fails):
    assert fails("fuse", "--out", "x").startswith("missing --apr, --vio (see")


def write_sigmas(path, walk_dir, rng):
    times = read_trajectory(walk_dir / "apr_net.tum").timestamp_s
    drawn = rng.uniform(1, 9, (len(times), 2))
    rows = [f"{time},{m},{deg}" for time, (m, deg) in zip(times, drawn, strict=True)]
    path.write_text("\n".join(["timestamp_s,sigma_position_m,sigma_orientation_deg", *rows]) + "\n")


@pytest.mark.slow
def test_what_the_regressor_states_is_used_found_or_named(run, files, tmp_path, walk_dir, rng):
    plain, named, found = (tmp_path / f"{name}.csv" for name in ("plain", "named", "found"))
    sigmas = tmp_path / "apr_net.sigma.csv"
    run("fuse", *files, "--out", plain)
    write_sigmas(sigmas, walk_dir, rng)
    code, _, err = run("fuse", *files, "--apr-sigma", sigmas, "--out", named)
    assert code == 0, err
    (tmp_path / "apr_net.tum").write_bytes((walk_dir / "apr_net.tum").read_bytes())
    run("fuse", "--apr", tmp_path / "apr_net.tum", *files[2:], "--out", found)
    assert named.read_text() == found.read_text() != plain.read_text()


FOREIGN = [
    (("--method", "chain", "--d-th", "2"), "--d-th is a flag of methods vio, vio-apr"),
    (("--d-th", "0.5"), "--d-th is a flag of methods vio, vio-apr: expected flags of chain"),
    (("--method", "apr", "--n=4"), "--n is a flag of methods vio, vio-apr: expected flags of apr"),
    (
        ("--method", "vio-apr", "--pose_graph-prior-sigma-m", "1"),
        "--pose-graph-prior-sigma-m is a flag of method pose-graph: expected flags of vio-apr",
    ),
]


@pytest.mark.parametrize(("arguments", "message"), FOREIGN, ids=lambda v: str(v)[:30])
def test_flags_of_another_method_are_refused(fails, files, tmp_path, arguments, message):
    line = fails("fuse", *files, "--out", tmp_path / "f.csv", *arguments)
    assert message in line
    assert "see vioapr fuse --help" in line
    assert not (tmp_path / "f.csv").exists()


@pytest.mark.parametrize("method", ["vio", "vio-apr"])
def test_a_flag_of_two_methods_is_taken_by_both(run, files, tmp_path, method):
    out = "--out", tmp_path / "f.csv"
    code, _, err = run("fuse", *files, *out, "--method", method, "--d-th", "0.7")
    assert (code, err) == (0, "")


def test_sigmas_for_a_method_without_use_for_them_are_refused(
    fails, files, tmp_path, walk_dir, rng
):
    sigmas = tmp_path / "s.csv"
    write_sigmas(sigmas, walk_dir, rng)
    line = fails("fuse", *files, "--method", "vio-apr", "--apr-sigma", sigmas, "--out", "f.csv")
    assert "--apr-sigma: method vio-apr has no use for it, only chain has" in line


def test_a_bad_table_of_sigmas_is_refused(fails, files, tmp_path):
    sigmas = tmp_path / "s.csv"
    sigmas.write_text("timestamp_s,sigma_m\n1,1\n")
    line = fails("fuse", *files, "--apr-sigma", sigmas, "--out", tmp_path / "f.csv")
    assert "expected a header with the columns sigma_position_m, sigma_orientation_deg" in line
