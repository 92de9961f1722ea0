import subprocess
import sys

import pytest

from vioapr.cli.main import VERBS


def test_help_lists_all_verbs(run):
    code, out, _ = run("--help")
    assert code == 0
    assert all(verb in out for verb in VERBS)
    assert run()[1] == out


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(run, verb):
    code, out, _ = run(verb, "--help")
    assert code == 0
    assert len(out) > 300


def test_unknown_verbs_are_refused(fails):
    line = fails("fly")
    assert "fly" in line
    assert "fuse" in line


@pytest.mark.slow
def test_the_demo_runs(run, tmp_path):
    code, out, err = run("demo", "--out", tmp_path / "demo", "--walks", "1")
    assert code == 0, err
    assert "vio-apr" in out
    assert (tmp_path / "demo" / "report" / "index.html").exists()
    assert (tmp_path / "demo" / "Simulated" / "walk01" / "gt.tum").exists()
    again = run("demo", "--out", tmp_path / "again", "--walks", "1")[1]
    assert [line for line in again.splitlines() if "|" in line or "│" in line] == [
        line for line in out.splitlines() if "|" in line or "│" in line
    ]


def test_demo_refuses_what_cannot_be(fails, tmp_path):
    assert "--walks: expected at least 1, got 0" in fails("demo", "--walks", "0")
    assert "--seed" in fails("demo", "--seed", "-1")
    (tmp_path / "file").touch()
    assert "cannot be made" in fails("demo", "--out", tmp_path / "file")


def test_a_closed_pipe_is_no_error():
    program = f"{sys.executable} -m vioapr --help | head -1"
    done = subprocess.run(program, shell=True, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


def test_the_core_does_not_import_torch():
    modules = "vioapr.cli, vioapr.fusion.methods, vioapr.evaluation.tables, vioapr.trajectory"
    code = f"import sys, {modules}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
