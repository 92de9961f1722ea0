"""A file or a whole folder takes its place in one go, and what is of others stays."""

import errno
import subprocess
import sys
import time

import pytest

from vioapr.errors import AlreadyExistsError, DiskFullError, UnwritableError
from vioapr.files.text import write_text
from vioapr.work.results import WRITTEN_FILE, ResultFolder, replacing_output

PATTERNS = ("*.pose", "*/*.pose")


def publish(path, *names, overwrite=False):
    with replacing_output(path, overwrite=overwrite, patterns=PATTERNS) as partial:
        for name in names:
            write_text(partial / name, name)


def names(folder):
    """All files in a folder, but for the note beside the one that is written."""
    paths = (path for path in folder.rglob("*") if not path.name.endswith(WRITTEN_FILE))
    return sorted(path.relative_to(folder).as_posix() for path in paths if path.is_file())


def test_a_new_folder_is_whole_and_nothing_else_is_left(tmp_path):
    publish(tmp_path / "out", "1.pose", "a/2.pose")
    assert names(tmp_path) == ["out/1.pose", "out/a/2.pose"]
    # Other programs read all that is in it: the note is beside it.
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["1.pose", "a"]
    assert (tmp_path / f".out{WRITTEN_FILE}").exists()
    assert ResultFolder(tmp_path / "out", is_noted_beside=True).find_others() == []


def test_a_shorter_result_leaves_nothing_of_the_longer_one(tmp_path):
    out = tmp_path / "out"
    publish(out, "1.pose", "2.pose", "a/3.pose", "b/4.pose")
    (out / "b" / "photo.jpg").write_text("mine")
    publish(out, "1.pose", overwrite=True)
    assert names(out) == ["1.pose", "b/photo.jpg"]
    assert not (out / "a").exists()
    publish(out, "1.pose", "5.pose", overwrite=True)  # and what is written later is known again
    publish(out, "1.pose", overwrite=True)
    assert names(out) == ["1.pose", "b/photo.jpg"]
    assert ResultFolder(out, is_noted_beside=True).find_others() == [out / "b" / "photo.jpg"]


@pytest.mark.parametrize("is_changed", [False, True])
def test_what_would_be_read_with_the_result_is_refused_before_anything_is_moved(
    tmp_path, is_changed
):
    out = tmp_path / "out"
    publish(out, "1.pose", "2.pose")
    (out / ("2.pose" if is_changed else "mine.pose")).write_text("mine")
    (out / "1.pose").write_text("of before")
    before = names(out)
    with pytest.raises(AlreadyExistsError, match=r"(mine|2)\.pose: would be read as a part of"):
        publish(out, "1.pose", overwrite=True)
    assert names(out) == before
    assert (out / "1.pose").read_text() == "of before"


def test_a_folder_that_another_process_made_meanwhile_stays(tmp_path):
    out = tmp_path / "out"

    def work():
        with replacing_output(out, overwrite=False, patterns=PATTERNS) as partial:
            write_text(partial / "1.pose", "mine")
            publish(out, "2.pose")

    with pytest.raises(AlreadyExistsError, match="out: exists now, and did not before"):
        work()
    assert names(tmp_path) == ["out/2.pose"]
    with replacing_output(tmp_path / "new", overwrite=True, patterns=PATTERNS) as partial:
        write_text(partial / "1.pose", "mine")
        publish(tmp_path / "new", "2.pose")
    assert names(tmp_path / "new") == ["1.pose"]


def test_an_empty_folder_that_was_filled_meanwhile_stays(tmp_path):
    out = tmp_path / "out"
    out.mkdir()

    def work():
        with replacing_output(out, overwrite=False) as partial:
            write_text(partial / "1.pose", "mine")
            (out / "photo.jpg").write_text("theirs")

    with pytest.raises(AlreadyExistsError, match="did not before"):
        work()
    assert names(tmp_path) == ["out/photo.jpg"]


def test_a_file_keeps_its_permissions_and_its_link(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "real").chmod(0o640)
    (tmp_path / "link").symlink_to("real")
    with replacing_output(tmp_path / "link", overwrite=True) as partial:
        partial.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    assert (tmp_path / "real").stat().st_mode & 0o777 == 0o640


def test_errors_name_the_path_that_the_user_gave(tmp_path):
    def fill_up():
        with replacing_output(tmp_path / "out", overwrite=False) as partial:
            partial.mkdir()
            raise UnwritableError.of(partial / "1.pose", OSError(errno.ENOSPC, "No space left"))

    with pytest.raises(DiskFullError) as caught:
        fill_up()
    assert caught.value.path == str(tmp_path / "out" / "1.pose")
    assert names(tmp_path) == []


def test_a_folder_is_not_put_in_the_place_of_a_file(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(UnwritableError):
        publish(tmp_path / "out", "1.pose", overwrite=True)
    assert (tmp_path / "out").read_text() == "mine"


RACER = """
import sys, time
from pathlib import Path
from vioapr.errors import AlreadyExistsError
from vioapr.files.text import write_text
while not Path(sys.argv[2]).exists():
    time.sleep(0.001)
try:
    write_text(Path(sys.argv[1]), sys.argv[3] * 100, overwrite=False)
except AlreadyExistsError:
    sys.exit(2)
"""


def test_of_several_processes_one_writes_a_new_file(tmp_path):
    out, start = tmp_path / "fused.csv", tmp_path / "start"
    racers = [subprocess.Popen([sys.executable, "-c", RACER, out, start, name]) for name in "abcd"]
    time.sleep(0.2)
    start.touch()
    codes = [racer.wait(60) for racer in racers]
    assert sorted(codes) == [0, 2, 2, 2]
    assert out.read_text() == "abcd"[codes.index(0)] * 100
    assert names(tmp_path) == ["fused.csv", "start"]
