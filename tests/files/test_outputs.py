"""Outputs are refused before the work where they would destroy something."""

import os
from pathlib import Path

import pytest

from vioapr.errors import AlreadyExistsError, ParameterError, UnwritableError
from vioapr.files.outputs import check_outputs


@pytest.fixture
def given(tmp_path):
    path = tmp_path / "in.tum"
    path.write_text("input")
    return path


def test_new_files_are_free(tmp_path, given):
    check_outputs([tmp_path / "a", tmp_path / "new" / "b", None], [given, None])
    assert sorted(tmp_path.iterdir()) == [given]


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("kind", ["itself", "spelling", "link", "hard link", "through a folder"])
def test_an_input_is_no_output_whatever_it_is_called(tmp_path, given, kind, overwrite):
    path = tmp_path / "other.tum"
    if kind == "itself":
        path = given
    elif kind == "spelling":
        path = tmp_path / "x" / ".." / "in.tum"
    elif kind == "link":
        path.symlink_to(given)
    elif kind == "hard link":
        os.link(given, path)
    else:
        (tmp_path / "folder").symlink_to(tmp_path)
        path = tmp_path / "folder" / "in.tum"
    with pytest.raises(ParameterError, match=r"is the input.*: write to another file"):
        check_outputs([path], [given], overwrite=overwrite)


def test_a_folder_that_is_read_may_hold_outputs_but_be_none(tmp_path):
    check_outputs([tmp_path / "out.csv"], [tmp_path])
    with pytest.raises(ParameterError, match="is the input"):
        check_outputs([tmp_path], [tmp_path])


def test_each_output_has_a_file_of_its_own(tmp_path):
    with pytest.raises(ParameterError, match="also another output"):
        check_outputs([tmp_path / "a", tmp_path / "a"])
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(ParameterError, match="the same file as"):
        check_outputs([tmp_path / "a", tmp_path / "b"], overwrite=True)


def test_a_result_is_kept_unless_it_is_to_be_replaced(tmp_path):
    path = tmp_path / "out.csv"
    path.write_text("result")
    with pytest.raises(AlreadyExistsError, match=r"out\.csv: exists: .*or give `overwrite`"):
        check_outputs([path])
    check_outputs([path], overwrite=True)
    assert path.read_text() == "result"


def test_what_is_no_file(tmp_path, given):
    with pytest.raises(UnwritableError, match="cannot be written: it is a folder"):
        check_outputs([tmp_path], overwrite=True)
    with pytest.raises(UnwritableError, match=r"in\.tum is no folder"):
        check_outputs([given / "out.csv"])


@pytest.mark.parametrize("name", ["-", "/dev/stdout", "/dev/null", "/dev/fd/1", "/proc/self/fd/1"])
def test_streams_may_always_be_written(name):
    check_outputs([Path(name), Path(name)], [Path(name)])
