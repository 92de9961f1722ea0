import subprocess
import sys

import pytest

import vioapr
from vioapr.cli.verbs import VERBS

HEAVY = {"numpy", "scipy", "matplotlib", "torch", "PIL", "rich", "tyro", "msgspec"}


def test_help_lists_all_verbs_a_line_each(run):
    code, out, _ = run("--help")
    assert code == 0
    lines = out.splitlines()
    for verb in VERBS:
        assert sum(line.startswith(f"  {verb}  ") for line in lines) == 1
    assert max(map(len, lines)) <= 84
    assert run()[1] == out


@pytest.mark.parametrize(
    "code", ["import vioapr", "from vioapr.cli import main; main(['--help']); main(['fly'])"]
)
def test_help_and_a_mere_import_are_light(code):
    code += "; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert not HEAVY & set(done.stdout.split())


def test_help_of_verbs_of_two_words(run):
    code, out, _ = run("scene", "--help")
    assert code == 0
    assert "scene check" in out
    assert "simulate walks" not in out


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(run, verb):
    code, out, _ = run(verb, "--help")
    assert code == 0
    assert len(out) > 300


def test_unknown_verbs_are_refused(fails):
    line = fails("fly")
    assert "fly" in line
    assert "fuse" in line
    assert fails("scene") == (
        "unknown verb 'scene': expected one of scene check, scene info (see vioapr --help)"
    )


def test_the_version_is_told(run):
    assert run("--version")[1] == f"vioapr {vioapr.__version__}\n"


def test_flags_that_cannot_be_parsed_are_named(fails):
    files = ("--apr", "a", "--vio", "b", "--out", "c")
    see = " (see vioapr fuse --help)"
    assert fails("fuse", "--out", "x") == f"missing --apr, --vio{see}"
    assert fails("scene", "check") == "missing SCENE (see vioapr scene check --help)"
    assert fails("import", "stray", "--out", "y").startswith("missing SOURCE ")
    assert "Missing value for argument '--view'" in fails("fuse", *files, "--view")
    assert fails("fuse", *files, "--tolerancee") == (
        f"Unrecognized options: --tolerancee; perhaps --tolerance-s{see}"
    )
    assert "--tolerance-s: could not convert" in fails("fuse", *files, "--tolerance-s", "near")
    assert "invalid choice 'x' for argument '--view'" in fails("fuse", *files, "--view", "x")


@pytest.mark.slow
def test_the_demo_localizes_its_walk_from_pictures(run, tmp_path):
    out = tmp_path / "demo"
    code, printed, err = run("demo", "--out", out)
    assert code == 0, err
    assert all(method in printed for method in ("apr", "vio", "vio-apr", "consensus"))
    assert (out / "report" / "index.html").exists()
    images = len(list((out / "courtyard" / "recordings" / "test-01" / "images").iterdir()))
    assert len((out / "fused.csv").read_text().splitlines()) == images + 1
    (command,) = (line for line in printed.splitlines() if line.startswith("vioapr localize"))
    before = (out / "fused.csv").read_bytes()
    assert run(*command.split()[1:])[0] == 0
    assert (out / "fused.csv").read_bytes() == before


def test_demo_refuses_a_file_as_its_folder(fails, tmp_path):
    (tmp_path / "file").touch()
    assert "cannot be written" in fails("demo", "--out", tmp_path / "file")


def test_simulated_walks_are_walks(run, tmp_path):
    code, _, err = run("simulate", "walks", "--out", tmp_path / "walks", "--walks", "2")
    assert code == 0, err
    code, out, err = run("evaluate", tmp_path / "walks", "--methods", "apr,vio-apr")
    assert code == 0, err
    assert "2 walks" in out


def test_simulate_walks_refuses_what_cannot_be(fails, tmp_path):
    out = ("--out", tmp_path / "walks")
    assert "--walks: expected at least 1, got 0" in fails("simulate", "walks", *out, "--walks", "0")
    assert "--seed" in fails("simulate", "walks", *out, "--seed", "-1")
    (tmp_path / "file").touch()
    assert "walk01: cannot be written: Not a directory" in fails(
        "simulate", "walks", "--out", tmp_path / "file"
    )


def test_a_closed_pipe_is_no_error():
    program = f"{sys.executable} -m vioapr --help | head -1"
    done = subprocess.run(program, shell=True, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


def test_the_core_does_not_import_torch():
    modules = "vioapr.cli, vioapr.fusion.methods, vioapr.evaluation.tables, vioapr.trajectory"
    code = f"import sys, {modules}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
