import subprocess
import sys

import pytest

import vioapr
from vioapr.cli.help import describe_parameters
from vioapr.cli.parameters import parameters_of
from vioapr.cli.verbs import VERBS
from vioapr.fusion.types import Status

HEAVY = {"numpy", "scipy", "matplotlib", "torch", "PIL", "rich", "tyro", "msgspec"}


def test_help_lists_all_verbs_a_line_each(run):
    code, out, _ = run("--help")
    assert code == 0
    lines = out.splitlines()
    for verb in VERBS:
        assert sum(line.startswith(f"  {verb}  ") for line in lines) == 1
    assert max(map(len, lines)) <= 80
    assert run()[1] == out


@pytest.mark.parametrize(
    "code", ["import vioapr", "from vioapr.cli import main; main(['--help']); main(['fly'])"]
)
def test_help_and_a_mere_import_are_light(code):
    code += "; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert not HEAVY & set(done.stdout.split())


def test_the_order_of_the_help_is_that_of_the_work(run):
    out = run("--help")[1]
    verbs = ("inspect", "fuse", "import", "map", "train", "export", "localize", "demo")
    places = [out.index(f"\n  {verb} ") for verb in verbs]
    assert places == sorted(places)


@pytest.mark.parametrize("family", ["scene", "simulate", "reproduce"])
def test_help_of_verbs_of_two_words_shows_their_own_alone(run, family):
    code, out, _ = run(family, "--help")
    assert code == 0
    own = [name for name in VERBS if name.startswith(f"{family} ")]
    listed = [line for line in out.splitlines() if line.startswith("  ")]
    assert [line.split("  ")[1] for line in listed] == own
    for arguments in ((family,), ("help", family), (family, "-h"), ("help", "help", family)):
        assert run(*arguments) == (0, out, "")


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(run, verb, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = run(*verb.split(), "--help")
    assert code == 0
    assert out.startswith(f"usage: vioapr {verb} ")
    assert max(map(len, out.splitlines())) <= 80
    assert len(out) > 300
    # Every parameter has a text, and what is needed comes first.
    flags = [one for one in parameters_of(VERBS[verb].load()) if one.flags]
    assert all(f"  {one.flag}" in out for one in flags)
    needed = [out.index(f"\n  {one.flag} ") for one in flags if one.is_required]
    if needed and "\noptions:" in out:
        assert max(needed) < out.index("\noptions:")
    assert "example" in out
    assert run("help", *verb.split()) == (0, out, "")
    assert run(*verb.split(), "-h") == (0, out, "")


@pytest.mark.parametrize("verb", VERBS)
def test_every_parameter_has_a_text(verb):
    undocumented = [
        one.flag for one, text in describe_parameters(VERBS[verb].load()) if len(text) < 10
    ]
    assert undocumented == []


@pytest.mark.parametrize("verb", ["fuse", "localize"])
def test_help_tells_all_statuses(run, verb):
    out = " ".join(run(verb, "--help")[1].split())
    assert all(f"{status.label} {status.meaning}" in out for status in Status)


def test_unknown_verbs_are_refused(fails):
    line = fails("fly")
    assert "fly" in line
    assert "fuse" in line
    for arguments in (("evalute",), ("evalute", "--help"), ("evaluat", "x", "--json", "y")):
        assert "perhaps evaluate (see" in fails(*arguments)
    assert fails("nonsens3", "--help").startswith("unknown verb 'nonsens3'")
    assert fails("help", "fusee") == "unknown verb 'fusee': perhaps fuse (see vioapr --help)"
    assert "perhaps scene or" in fails("scenes")
    assert "perhaps scene check (see" in fails("scene", "chek", "--help")
    assert "perhaps scene check (see" in fails("check")
    assert fails("scene", "fly") == (
        "unknown verb 'scene fly': expected one of scene check, scene info, scene anonymize "
        "(see vioapr --help)"
    )
    assert "expected a verb before flags, got --apr" in fails("--apr", "x")


def test_the_version_is_told(run):
    said = (0, f"vioapr {vioapr.__version__}\n", "")
    for arguments in (("--version",), ("-V",), ("fuse", "-V"), ("scene", "--version")):
        assert run(*arguments) == said
    assert run("scene", "check", "x", "--version") == said


def test_flags_that_cannot_be_parsed_are_named(fails):
    files = ("--apr", "a", "--vio", "b", "--out", "c")
    see = " (see vioapr fuse --help)"
    assert fails("fuse", "--out", "x") == f"missing --apr, --vio{see}"
    assert fails("scene", "check") == "missing SCENE (see vioapr scene check --help)"
    assert fails("import", "stray", "--out", "y").startswith("missing SOURCE ")
    assert fails("fuse", *files, "--view") == f"--view: expected a value after it, got none{see}"
    for wrong in ("--tolerancee", "--toler", "--tolerence-s", "--Tolerance_S"):
        assert (
            fails("fuse", *files, wrong, "1") == f"unknown flag {wrong}; perhaps --tolerance-s{see}"
        )
    assert fails("fuse", "--out_dir", "x") == f"unknown flag --out_dir; perhaps --out{see}"
    assert fails("fuse", "--output=x") == f"unknown flag --output; perhaps --out{see}"
    assert fails("fuse", *files, "--zebra") == f"unknown flag --zebra{see}"
    assert fails("fuse", *files, "-q") == f"unknown flag -q{see}"
    assert fails("fuse", *files, "--tolerance-s", "near") == (
        f"--tolerance-s: expected a number, got 'near'{see}"
    )
    assert fails("fuse", *files, "--n", "1.5") == f"--n: expected a whole number, got '1.5'{see}"
    for given in (("--view", "liv"), ("--view=liv",)):
        assert fails("fuse", *files, *given) == (
            f"--view: expected one of retrospective, live, got 'liv'; perhaps live{see}"
        )
    assert fails("convert", "a", "b", "c").startswith(
        "expected no more than the files that the verb takes, got also c (see vioapr convert "
    )


def test_empty_paths_are_refused(fails):
    """An empty text would be the current folder."""
    empty = "expected a path, got an empty text: is a variable of the shell not set?"
    assert fails("map", "").startswith(empty)
    assert fails("fuse", "--apr", "").startswith(f"--apr: {empty}")
    assert fails("fuse", "--apr=", "--vio=b").startswith(f"--apr: {empty}")
    assert fails("evaluate", "walks", "--report", "").startswith(f"--report: {empty}")
    assert "expected names from apr" in fails("evaluate", "walks", "--methods", "")


def test_choices_of_the_library_are_suggested(fails, walk_dir):
    assert fails("evaluate", walk_dir, "--methods", "chian").endswith("; perhaps chain")
    assert fails("inspect", walk_dir / "gt.tum", "--from", "tun").endswith("; perhaps tum")
    assert "--rate-hz: expected a rate above 0 Hz" in fails("inspect", "x", "--rate-hz", "-3")
    assert "--tolerance-s: expected a time tolerance" in fails(
        "evaluate", walk_dir, "--tolerance-s", "nan"
    )


def test_want_of_memory_is_said_in_a_line(fails, walk_dir, monkeypatch):
    def greedy(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 28 GiB")

    monkeypatch.setattr("vioapr.cli.inspect.inspect_file", greedy)
    assert fails("inspect", walk_dir / "gt.tum") == "not enough memory: Unable to allocate 28 GiB"


def test_files_of_similar_names_are_suggested(fails, tmp_path):
    (tmp_path / "vio.tum").touch()
    near = f"; perhaps {tmp_path / 'vio.tum'}"
    assert fails("inspect", tmp_path / "vio.tun").endswith(near)
    assert fails("inspect", tmp_path / "VIO.tum.gz").endswith(near)
    assert fails("inspect", tmp_path / "other").endswith("found none of this name")
    missing = tmp_path / "walks"
    assert fails("inspect", missing / "a" / "b").endswith(f"; there is no folder {missing}")


@pytest.mark.slow
def test_the_demo_localizes_its_walk_from_pictures(run, tmp_path):
    out = tmp_path / "demo"
    code, printed, err = run("demo", "--out", out)
    assert code == 0, err
    assert all(method in printed for method in ("apr", "vio", "vio-apr", "chain"))
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


@pytest.mark.slow
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
    assert "file: cannot be written to: expected a folder" in fails(
        "simulate", "walks", "--out", tmp_path / "file"
    )


def test_a_closed_pipe_is_no_error():
    program = f"{sys.executable} -m vioapr --help | head -1"
    done = subprocess.run(program, shell=True, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_the_core_does_not_import_torch():
    modules = "vioapr.cli, vioapr.fusion.methods, vioapr.evaluation.tables, vioapr.trajectory"
    code = f"import sys, {modules}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
