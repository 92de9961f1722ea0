import io
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest


@pytest.fixture
def give(monkeypatch):
    """Gives bytes as standard input."""

    def call(content):
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(content)))

    return call


def test_inspect_reads_standard_input(run, give, walk_dir):
    content = (walk_dir / "vio_sim.tum").read_bytes()
    give(content)
    code, out, err = run("inspect", "-")
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == "standard input"
    named = run("inspect", walk_dir / "vio_sim.tum")[1].splitlines()
    assert out.splitlines()[2:] == named[2:]  # a name makes the format surer
    give(content)
    (found,) = json.loads(run("inspect", "-", "--format", "json")[1])
    assert found["path"] == "standard input"


def test_convert_is_a_filter(run, give, walk_dir, tmp_path):
    source = walk_dir / "vio_sim.tum"
    run("convert", source, tmp_path / "x.txt", "--to", "kitti")
    give(source.read_bytes())
    code, out, err = run("convert", "-", "-", "--to", "kitti")
    assert code == 0
    assert out == (tmp_path / "x.txt").read_text()
    assert "standard input (tum) -> standard output (kitti)" in err


@pytest.mark.slow
def test_fuse_writes_to_standard_output(run, give, walk_dir, tmp_path):
    files = ("--apr", walk_dir / "apr_net.tum", "--vio", walk_dir / "vio_sim.tum")
    run("fuse", *files, "--out", tmp_path / "fused.csv")
    code, out, err = run("fuse", *files, "--out", "-")
    assert code == 0
    assert out == (tmp_path / "fused.csv").read_text()
    assert "standard output: 60 frames" in err
    give((walk_dir / "vio_sim.tum").read_bytes())
    assert run("fuse", *files[:2], "--vio", "-", "--out", "-")[1] == out


@pytest.mark.slow
def test_figures_go_to_standard_output_alone(run, walk_dir):
    for verb in ("evaluate", "vio-quality"):
        code, out, err = run(verb, walk_dir.parent, "--json", "-")
        assert code == 0
        assert json.loads(out)
        assert "median" in err or "Medians" in err
    rows = run("evaluate", walk_dir.parent, "--csv", "-")[1].splitlines()
    assert rows[0].startswith("set,walk,vio,apr,method,timestamp_s")


def test_misused_streams_are_refused(fails, give, walk_dir, tmp_path):
    out = ("--out", tmp_path / "x")
    assert fails("fuse", "--apr", "-", "--vio", "-", *out) == (
        "expected standard input once, got it for --apr and --vio"
    )
    folder = walk_dir.parent
    assert "once, got it for --json and --csv" in fails(
        "evaluate", folder, "--json", "-", "--csv", "-"
    )
    assert "once, got it for --json and --format" in fails(
        "evaluate", folder, "--json", "-", "--format", "csv"
    )
    assert "--report: expected a path: - has no meaning here" in fails(
        "evaluate", folder, "--report", "-"
    )
    give(b"")
    assert fails("inspect", "-").startswith("standard input: ")
    give(b"\0\1\2")
    assert "standard input: expected a trajectory, got binary content" in fails("inspect", "-")
    give((walk_dir / "vio_sim.tum").read_bytes())
    assert "standard output: the name does not tell which format to write" in fails(
        "convert", "-", "-"
    )
    give((walk_dir / "vio_sim.tum").read_bytes())
    line = fails("fuse", "--apr", walk_dir / "none.tum", "--vio", "-", "--out", "-")
    assert line.startswith(f"{walk_dir / 'none.tum'}: expected a file")


@pytest.mark.slow
def test_a_pipe_of_verbs_is_clean(walk_dir):
    verb = f"{sys.executable} -m vioapr"
    program = (
        f"{verb} fuse --apr {walk_dir}/apr_net.tum --vio {walk_dir}/vio_sim.tum --out x.csv "
        f"--tum - | {verb} convert - - --to kitti | head -2"
    )
    done = subprocess.run(
        program, shell=True, capture_output=True, text=True, timeout=120, cwd=walk_dir
    )
    assert done.returncode == 0, done.stderr
    assert [len(line.split()) for line in done.stdout.splitlines()] == [12, 12]
    assert "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("how", [(), ("--format", "csv")])
def test_a_full_standard_output_is_said_in_a_line(walk_dir, how):
    command = [sys.executable, "-m", "vioapr", "inspect", walk_dir / "gt.tum", *how]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "error: standard output: cannot be written: No space left on device\n"


@pytest.mark.slow
def test_signs_that_a_terminal_does_not_have_are_no_failure(walk_dir):
    command = [sys.executable, "-m", "vioapr", "vio-quality", walk_dir]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment)
    assert done.returncode == 0, done.stderr
    assert "APE m / AOE \\xb0" in done.stdout
    data = subprocess.run(
        [*command, "--format", "json"], capture_output=True, timeout=60, env=environment
    )
    assert json.loads(data.stdout.decode("utf-8"))
