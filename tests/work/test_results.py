"""Files of the user in a folder of results are never replaced, vioapr's own are."""

import subprocess
import sys
from pathlib import Path

import pytest

from vioapr.errors import AlreadyExistsError, LockedError, UnwritableError
from vioapr.work import results
from vioapr.work.results import WRITTEN_FILE, ResultFolder

PATTERNS = ("index.html", "figures/*.png")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "report"


def publish(folder, text="one", **options):
    results = ResultFolder(folder, **options)
    results.check(PATTERNS)
    with results.adding() as partial:
        (partial / "figures").mkdir()
        (partial / "index.html").write_text(text)
        (partial / "figures" / "a.png").write_text(text)


def visible(folder):
    files = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    return sorted(name for name in files if not name.startswith("."))


def test_own_results_are_replaced_and_files_of_others_stay(folder):
    publish(folder)
    (folder / "notes.txt").write_text("mine")
    (folder / "figures" / "b.jpg").write_text("mine")
    publish(folder, "two")
    assert (folder / "index.html").read_text() == "two"
    assert (folder / "figures" / "a.png").read_text() == "two"
    assert visible(folder) == ["figures/a.png", "figures/b.jpg", "index.html", "notes.txt"]


@pytest.mark.parametrize("name", ["index.html", "figures/a.png"])
@pytest.mark.parametrize("is_changed", [False, True])
def test_a_file_of_the_user_is_kept(folder, name, is_changed):
    if is_changed:
        publish(folder)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("mine")
    before = visible(folder)
    with pytest.raises(AlreadyExistsError, match=rf"{name}: exists, .* or give `overwrite`"):
        publish(folder, "two")
    assert (folder / name).read_text() == "mine"
    assert visible(folder) == before
    publish(folder, "two", overwrite=True)
    assert (folder / name).read_text() == "two"


def test_a_file_that_came_while_the_work_was_done_is_kept(folder):
    results = ResultFolder(folder)
    results.check(PATTERNS)

    def work():
        with results.adding() as partial:
            (partial / "index.html").write_text("new")
            (folder / "index.html").write_text("mine")

    with pytest.raises(AlreadyExistsError):
        work()
    assert (folder / "index.html").read_text() == "mine"


def test_the_same_content_is_in_nobodys_way(folder):
    folder.mkdir()
    (folder / "index.html").write_text("one")
    with ResultFolder(folder).adding() as partial:
        (partial / "index.html").write_text("one")
    assert visible(folder) == ["index.html"]


def test_a_failure_moves_nothing(folder):
    publish(folder)

    def work():
        with ResultFolder(folder).adding() as partial:
            (partial / "index.html").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert (folder / "index.html").read_text() == "one"
    assert not list(folder.glob("*.partial"))


def test_what_a_killed_process_left_is_removed(folder):
    code = "import os, sys; from pathlib import Path; from vioapr.work.results import ResultFolder"
    code += "\nwith ResultFolder(Path(sys.argv[1])).adding(): os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", code, folder], check=False)
    assert len(list(folder.glob(".results.*.partial"))) == 1
    publish(folder)
    assert not list(folder.glob(".results.*.partial"))


def test_killed_while_files_are_moved_they_are_still_vioaprs(folder, monkeypatch):
    """Whichever of them were moved: the note of both contents comes first."""
    publish(folder)
    moved, replace = [], Path.replace

    def move_one(self, target):
        if moved:
            raise OSError("killed here")
        moved.append(target)
        replace(self, target)

    monkeypatch.setattr(Path, "replace", move_one)
    monkeypatch.setattr(
        results, "write_atomically", lambda path, content: path.write_bytes(content)
    )
    with pytest.raises(UnwritableError):
        publish(folder, "two")
    monkeypatch.undo()
    assert {(folder / name).read_text() for name in visible(folder)} == {"one", "two"}
    publish(folder, "three")
    assert {(folder / name).read_text() for name in visible(folder)} == {"three"}


def test_what_a_result_was_made_from(folder):
    results = ResultFolder(folder)
    assert results.made_from("a.tum") is None
    with results.adding({"a.tum": "key"}) as partial:
        (partial / "a.tum").write_text("poses")
    assert ResultFolder(folder).made_from("a.tum") == "key"
    (folder / "a.tum").write_text("changed")
    assert ResultFolder(folder).made_from("a.tum") is None


def test_a_broken_note_makes_all_files_the_users(folder):
    publish(folder)
    (folder / WRITTEN_FILE).write_text("{")
    with pytest.raises(AlreadyExistsError):
        publish(folder, "two")


def test_two_processes_do_not_write_at_once(folder):
    with ResultFolder(folder).adding(), pytest.raises(LockedError), ResultFolder(folder).adding():
        pass


def test_a_file_in_the_folders_place(folder):
    folder.write_text("")
    with pytest.raises(AlreadyExistsError, match="expected a folder, found a file"):
        ResultFolder(folder).check([])
