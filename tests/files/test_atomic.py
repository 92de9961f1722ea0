"""A file is either the old one or the new one, and nothing else is left behind."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from vioapr.errors import DiskFullError, UnwritableError
from vioapr.files.atomic import (
    leftovers_beside,
    partial_beside,
    replace_folder,
    replacing,
    write_atomically,
)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_and_its_folders_are_made(tmp_path):
    write_atomically(tmp_path / "a" / "b" / "file.bin", b"content")
    assert (tmp_path / "a" / "b" / "file.bin").read_bytes() == b"content"
    assert names(tmp_path / "a" / "b") == ["file.bin"]


def test_an_interrupted_writer_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")

    def write():
        with replacing(path) as partial:
            partial.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert path.read_text() == "old"
    assert names(tmp_path) == ["file.txt"]


@pytest.mark.parametrize(
    ("number", "kind"), [(errno.ENOSPC, DiskFullError), (errno.EACCES, UnwritableError)]
)
def test_what_the_system_says_is_an_error_of_ours(tmp_path, number, kind):
    path = tmp_path / "file.txt"
    path.write_text("old")
    expected = pytest.raises(UnwritableError, match=r"file\.txt: cannot be written: ")
    with expected as caught, replacing(path):
        raise OSError(number, os.strerror(number))
    assert type(caught.value) is kind
    assert path.read_text() == "old"
    assert names(tmp_path) == ["file.txt"]


def test_the_old_file_is_whole_until_the_new_one_is(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")
    with replacing(path) as partial:
        partial.write_text("new")
        assert path.read_text() == "old"
        assert partial.name.startswith(".file.txt.")
        assert partial.name.endswith(".partial")
    assert path.read_text() == "new"


def test_two_writers_do_not_share_a_temporary_file(tmp_path):
    path = tmp_path / "file.txt"
    with replacing(path) as first, replacing(path) as second:
        first.write_text("first")
        second.write_text("second")
        assert first != second
    assert path.read_text() == "first"  # the outer one ends last
    assert names(tmp_path) == ["file.txt"]


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_files_are_readable_as_the_umask_says(tmp_path, umask, mode):
    before = os.umask(umask)
    try:
        write_atomically(tmp_path / "file", b"")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == mode


def test_a_link_stays_and_its_file_is_replaced(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_atomically(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_a_device_is_written_directly():
    device = Path(os.devnull)
    write_atomically(device, b"content")
    assert device.is_char_device()


def test_a_pipe_is_written_directly():
    code = "from pathlib import Path; from vioapr.files.atomic import write_atomically as w; "
    code += "w(Path('/dev/stdout'), b'content')"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert ran.stdout == b"content"


def test_a_folder_in_the_way_is_said(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(UnwritableError, match="taken: cannot be written: Is a directory"):
        write_atomically(tmp_path / "taken", b"content")


def test_a_folder_is_replaced_by_a_finished_one(tmp_path):
    for name, text in (("map", "old"), ("map.new", "new")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(text)
    replace_folder(tmp_path / "map", tmp_path / "map.new")
    assert (tmp_path / "map" / "file").read_text() == "new"
    assert names(tmp_path) == ["map"]


def test_a_folder_that_cannot_be_moved_in_leaves_the_old_one(tmp_path):
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "file").write_text("old")
    with pytest.raises(UnwritableError, match="map: cannot be written"):
        replace_folder(tmp_path / "map", tmp_path / "missing")
    assert (tmp_path / "map" / "file").read_text() == "old"
    assert names(tmp_path) == ["map"]


def test_leftovers_are_those_of_the_very_path(tmp_path):
    mine, others = partial_beside(tmp_path / "walk"), partial_beside(tmp_path / "walk.2")
    mine.mkdir()
    others.touch()
    (tmp_path / ".walk.partial").touch()
    assert leftovers_beside(tmp_path / "walk") == [mine]
    assert leftovers_beside(tmp_path / "walk.2") == [others]
