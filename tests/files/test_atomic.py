"""A file is either the old one or the new one, and nothing else is left behind."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from vioapr.errors import AlreadyExistsError, DiskFullError, UnwritableError
from vioapr.files.atomic import (
    leftovers_beside,
    partial_beside,
    replace_folder,
    replacing,
    restore_folder,
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


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_a_file_that_the_output_is_appended_to_keeps_its_content(tmp_path, name):
    """As the shell's `>>` does: the path leads to a regular file then."""
    code = "import sys; from pathlib import Path; from vioapr.files.atomic import write_atomically"
    code += f"; print('printed'); write_atomically(Path({name!r}), b'content')"
    with (tmp_path / "log").open("ab") as log:
        log.write(b"earlier ")
        log.flush()
        subprocess.run([sys.executable, "-c", code], stdout=log, check=True)
    assert (tmp_path / "log").read_text() == "earlier printed\ncontent"
    assert names(tmp_path) == ["log"]


def test_permissions_of_a_file_that_is_replaced_stay(tmp_path):
    path = tmp_path / "file"
    path.write_text("old")
    path.chmod(0o640)
    write_atomically(path, b"new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_permissions_are_the_umasks_although_a_library_has_its_own(tmp_path):
    """As one that makes the file again, for its owner alone."""
    before = os.umask(0o022)
    try:
        with replacing(tmp_path / "model") as partial:
            partial.unlink()
            os.close(os.open(partial, os.O_WRONLY | os.O_CREAT, 0o600))
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "model").stat().st_mode) == 0o644


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="names of open files needed")
def test_content_and_name_reach_the_disk_in_this_order(tmp_path, monkeypatch):
    calls = []
    fsync, replace = os.fsync, Path.replace

    def note_fsync(file):
        calls.append(Path(f"/proc/self/fd/{file}").readlink().name)
        fsync(file)

    def note_replace(self, target):
        calls.append("replace")
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", note_fsync)
    monkeypatch.setattr(Path, "replace", note_replace)
    write_atomically(tmp_path / "file", b"content")
    assert calls[0].endswith(".partial")
    assert calls[1:] == ["replace", tmp_path.name]


@pytest.mark.parametrize("function", ["fsync", "replace"])
def test_a_disk_that_fills_up_late_spares_the_old_file(tmp_path, monkeypatch, function):
    def fail(*args):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "file"
    path.write_text("old")
    monkeypatch.setattr(*((os, "fsync") if function == "fsync" else (Path, "replace")), fail)
    with pytest.raises(DiskFullError):
        write_atomically(path, b"new")
    assert path.read_text() == "old"
    assert names(tmp_path) == ["file"]


def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path):
    code = "import os; from pathlib import Path; from vioapr.files.atomic import replacing\n"
    code += "with replacing(Path('file')) as partial:\n  os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False)
    (left,) = tmp_path.iterdir()
    assert leftovers_beside(tmp_path / "file") == [left]
    write_atomically(tmp_path / "another", b"")
    assert left.exists()
    write_atomically(tmp_path / "file", b"content")
    assert names(tmp_path) == ["another", "file"]


def test_what_is_being_written_is_no_leftover(tmp_path):
    path = tmp_path / "file"
    with replacing(path) as partial:
        write_atomically(path, b"other")
        partial.write_bytes(b"content")
    assert path.read_bytes() == b"content"


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


def test_a_crash_between_the_two_renames_is_mended(tmp_path):
    (tmp_path / ".map.old").mkdir()
    (tmp_path / ".map.old" / "file").write_text("old")
    restore_folder(tmp_path / "map")
    assert (tmp_path / "map" / "file").read_text() == "old"
    (tmp_path / ".map.old").mkdir()  # and after the second
    restore_folder(tmp_path / "map")
    assert names(tmp_path) == ["map"]


def test_leftovers_are_those_of_the_very_path(tmp_path):
    mine, others = partial_beside(tmp_path / "walk"), partial_beside(tmp_path / "walk.2")
    mine.mkdir()
    others.touch()
    (tmp_path / ".walk.partial").touch()
    assert leftovers_beside(tmp_path / "walk") == [mine]
    assert leftovers_beside(tmp_path / "walk.2") == [others]


def no_link(*args):
    raise OSError(errno.EPERM, os.strerror(errno.EPERM))


@pytest.mark.parametrize("has_links", [True, False])
def test_a_file_that_came_meanwhile_is_kept_unless_it_may_be_overwritten(
    tmp_path, monkeypatch, has_links
):
    if not has_links:
        monkeypatch.setattr(os, "link", no_link)
    path = tmp_path / "file"
    write_atomically(path, b"first", overwrite=False)
    assert path.read_bytes() == b"first"

    def write():
        with replacing(tmp_path / "late", overwrite=False) as partial:
            partial.write_bytes(b"mine")
            (tmp_path / "late").write_bytes(b"theirs")

    with pytest.raises(AlreadyExistsError, match="late: exists now, .*`overwrite`"):
        write()
    assert (tmp_path / "late").read_bytes() == b"theirs"
    assert names(tmp_path) == ["file", "late"]


def test_a_full_disk_leaves_no_empty_file_where_there_are_no_links(tmp_path, monkeypatch):
    def fail(*args):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "link", no_link)
    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(DiskFullError):
        write_atomically(tmp_path / "file", b"new", overwrite=False)
    assert names(tmp_path) == []
