"""Every malformed file gives one error that says where, what was expected and what found."""

import gzip
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from tests.formats.conftest import FOLDERS, file_name, make_trajectory
from tests.formats.samples import write_sample

from vioapr.errors import (
    FileMissingError,
    FormatError,
    ParameterError,
    UnreadableError,
    UnwritableError,
)
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.registry import FORMATS, rank_formats, read_trajectory

ALL = pytest.mark.parametrize("format_", FORMATS.values(), ids=FORMATS)
FILES = [f for f in FORMATS.values() if f.name not in FOLDERS]
FILE = pytest.mark.parametrize("format_", FILES, ids=lambda f: f.name)
# Where the first data row of a written file is, and the fields of its rows.
TABLES = {
    "tum": (2, " "),
    "euroc": (2, ","),
    "kitti": (1, " "),
    "colmap": (3, " "),
    "hloc": (1, " "),
    "ace": (1, " "),
    "marvin": (1, " "),
    "marvin-vio": (1, " "),
    "hrapr": (1, " "),
    "mstransformer": (2, ","),
    "cambridge": (4, " "),
    "advio-gt": (1, ","),
    "advio-vio": (1, ","),
    "stray": (2, ","),
    "scancapture": (2, ","),
    "aria": (2, ","),
}
# The fields of a quaternion in a row.
QUATS = {
    "tum": slice(4, 8),
    "euroc": slice(4, 8),
    "colmap": slice(1, 5),
    "hloc": slice(1, 5),
    "ace": slice(1, 5),
    "marvin": slice(4, 8),
    "marvin-vio": slice(4, 8),
    "hrapr": slice(4, 8),
    "mstransformer": slice(7, 11),
    "cambridge": slice(4, 8),
    "advio-gt": slice(4, 8),
    "advio-vio": slice(4, 8),
    "stray": slice(5, 9),
    "scancapture": slice(5, 9),
    "aria": slice(4, 8),
}
TIMED = ["tum", "euroc", "advio-gt", "advio-vio", "stray", "scancapture", "aria"]
NAMED = ["hloc", "ace", "marvin", "marvin-vio", "hrapr", "cambridge", "mstransformer", "colmap"]


def write_valid(name, folder, count=4):
    format_ = FORMATS[name]
    path = folder / file_name(format_)
    write_sample(format_, path, make_trajectory(format_, count))
    return path


def edit_row(path, name, row, change):
    """Change the fields of a data row; gives the row's line number."""
    first, separator = TABLES[name]
    # COLMAP's images take two lines each.
    line = first + row * (2 if name == "colmap" else 1)
    lines = path.read_text().split("\n")
    fields = lines[line - 1].split(separator)
    change(fields)
    lines[line - 1] = separator.join(fields)
    path.write_text("\n".join(lines))
    return line


def expect(path, name, pattern, line=None):
    """The reader's error names the file, the line, and the problem."""
    with pytest.raises(FormatError, match=pattern) as caught:
        FORMATS[name].read(path, ReadOptions(strict=True))
    message = str(caught.value)
    assert "\n" not in message
    place = str(path) if line is None else f"{path}:{line}"
    assert message.startswith(f"{place}: ")


@ALL
def test_missing(format_, tmp_path):
    path = tmp_path / "nowhere" / file_name(format_)
    with pytest.raises(FileMissingError, match=re.escape(str(path)) + ".*found no"):
        format_.read(path, ReadOptions())


@FILE
def test_empty(format_, tmp_path):
    path = tmp_path / file_name(format_)
    path.write_bytes(b"")
    with pytest.raises(FormatError, match="expected"):
        format_.read(path, ReadOptions())


@FILE
def test_directory(format_, tmp_path):
    is_folder_too = "/" in format_.extensions
    error = FileMissingError if is_folder_too else FormatError
    problem = "expected a file, " + ("found none" if is_folder_too else "got a directory")
    with pytest.raises(error, match=problem):
        format_.read(tmp_path, ReadOptions())


def test_7scenes_needs_a_folder_of_poses(tmp_path):
    expect(tmp_path, "7scenes", "expected a folder of .*found none")
    (tmp_path / "x.pose.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n")
    with pytest.raises(FormatError, match=r"x.pose.txt: expected a 4x4 matrix, got 3 rows"):
        read_trajectory(tmp_path, "7scenes")
    (tmp_path / "x.pose.txt").write_text("1 0 0 0\n0 1 0\n")
    with pytest.raises(FormatError, match=r"x.pose.txt:2: expected 4 columns"):
        read_trajectory(tmp_path, "7scenes")


@FILE
def test_unreadable(format_, tmp_path, monkeypatch):
    path = tmp_path / file_name(format_)
    path.write_text("1 2 3")

    def refuse(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(UnreadableError, match="cannot be read: Permission denied"):
        format_.read(path, ReadOptions())


@FILE
def test_a_name_too_long_for_the_system(format_, tmp_path):
    with pytest.raises(UnreadableError, match="cannot be read"):
        format_.read(tmp_path / ("x" * 5000), ReadOptions())


@FILE
def test_binary_garbage(format_, tmp_path):
    path = tmp_path / file_name(format_)
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(FormatError, match="binary|expected"):
        format_.read(path, ReadOptions())
    path.write_bytes(b"\0" * 100)
    with pytest.raises(FormatError, match="binary|expected"):
        format_.read(path, ReadOptions())


@FILE
def test_truncated_gzip(format_, tmp_path):
    path = write_valid(format_.name, tmp_path)
    path.write_bytes(gzip.compress(path.read_bytes())[:-12])
    expect(path, format_.name, "gzip|ended before")
    path.write_bytes(b"\x1f\x8b" + os.urandom(40))
    expect(path, format_.name, "gzip|read")


@pytest.mark.parametrize("name", TABLES)
def test_wrong_number_of_columns(name, tmp_path):
    path = write_valid(name, tmp_path)
    line = edit_row(path, name, 2, lambda fields: fields.__delitem__(slice(-4, None)))
    expect(path, name, r"expected .*columns .*got \d+", line)


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("value", ["abc", "nan", "inf", "1e999", "9" * 5000])
def test_not_a_finite_number(name, value, tmp_path):
    path = write_valid(name, tmp_path)
    column = QUATS.get(name, slice(3, 4)).start
    line = edit_row(path, name, 2, lambda fields: fields.__setitem__(column, value))
    expect(path, name, "expected (a number|finite numbers)", line)


@pytest.mark.parametrize("name", QUATS)
@pytest.mark.parametrize("factor", [0, 1.1, 1e200])
def test_not_a_unit_quaternion(name, factor, tmp_path):
    path = write_valid(name, tmp_path)

    def scale(fields):
        quat = QUATS[name]
        fields[quat] = [repr(float(value) * factor) for value in fields[quat]]

    line = edit_row(path, name, 2, scale)
    expect(path, name, "expected a unit quaternion, got one of norm", line)


@pytest.mark.parametrize("name", QUATS)
def test_positions_that_cannot_be_metres(name, tmp_path):
    path = write_valid(name, tmp_path)
    quat = QUATS[name]
    column = quat.stop if name in ("colmap", "hloc", "ace") else quat.start - 1
    line = edit_row(path, name, 2, lambda fields: fields.__setitem__(column, "1e300"))
    expect(path, name, r"expected positions within 1e\+09 m, got 1e\+300", line)


@pytest.mark.parametrize("name", TIMED)
def test_times_out_of_order(name, tmp_path):
    for source, pattern in ((1, "a duplicate of"), (0, "earlier than")):
        path = write_valid(name, tmp_path)
        first, separator = TABLES[name]
        time = path.read_text().split("\n")[first - 1 + source].split(separator)[0]
        line = edit_row(path, name, 2, lambda fields, t=time: fields.__setitem__(0, t))
        expect(path, name, f"expected increasing timestamps, got .*{pattern}", line)
        notes = ReadingNotes()
        assert len(FORMATS[name].read(path, ReadOptions(notes=notes))) == 3
        assert [row.line for row in notes.left_out] == [line]


@pytest.mark.parametrize("name", TIMED)
def test_times_in_another_unit(name, tmp_path):
    path = write_valid(name, tmp_path)
    line = edit_row(path, name, 3, lambda fields: fields.__setitem__(0, "1" + "7" * 28))
    expect(path, name, "expected a timestamp in seconds, got .*another unit", line)


@pytest.mark.parametrize("name", NAMED)
def test_duplicate_names(name, tmp_path):
    path = write_valid(name, tmp_path)
    text = path.read_text().replace("frame-000002", "frame-000001")
    path.write_text(text)
    line = TABLES[name][0] + (4 if name == "colmap" else 2)
    expect(path, name, "expected each image once, got .*frame-000001.png' again", line)


def test_duplicate_names_in_json_and_binary(tmp_path):
    for name in ("nerfstudio", "colmap-binary"):
        path = write_valid(name, tmp_path)
        path.write_bytes(path.read_bytes().replace(b"frame-000002", b"frame-000001"))
        expect(path, name, "expected each image once", 3)


@pytest.mark.parametrize(
    ("name", "content", "pattern"),
    [
        ("nerfstudio", "{", "expected JSON"),
        ("nerfstudio", "[]", "expected a JSON object, got a list"),
        ("nerfstudio", "{}", 'expected a list "frames".*got none'),
        ("nerfstudio", '{"frames": []}', "got an empty list"),
        ("nerfstudio", '{"frames": 5}', "got a number"),
        ("nerfstudio", '{"frames": [5]}', ':1: expected a frame with a text "file_path"'),
        ("nerfstudio", '{"frames": [{"file_path": "a"}]}', "list of 4x4 numbers"),
        ("nerfstudio", "[" * 100000, "expected JSON"),
        ("nerfstudio", '{"frames": ' + "9" * 5000 + "}", "expected JSON"),
        ("record3d", '{"poses": [[0, 0, 0, 1, 0, 0]]}', "a pose as a list of 7 numbers"),
        ("record3d", '{"poses": [[0, 0, 0, true, 0, 0, 0]]}', "list of 7 numbers"),
        ("record3d", '{"poses": [[0, 0, 0, "1", 0, 0, 0]]}', "list of 7 numbers"),
        ("record3d", '{"poses": [[0, 0, 0, NaN, 0, 0, 0]]}', "NaN or inf"),
        ("record3d", '{"poses": [[0, 0, 0, 1, 0, 0, 1' + "0" * 400 + "]]}", "finite numbers"),
        ("record3d", '{"fps": 0, "poses": [[0, 0, 0, 1, 0, 0, 0]]}', '"fps" above 0'),
        ("record3d", '{"fps": "60", "poses": [[0, 0, 0, 1, 0, 0, 0]]}', '"fps"'),
        ("record3d", "PK\x03\x04 not a zip", "broken zip"),
    ],
)
def test_json_of_other_content(name, content, pattern, tmp_path):
    path = tmp_path / "file.json"
    path.write_text(content)
    with pytest.raises(FormatError, match=pattern):
        read_trajectory(path, name)


def test_names_that_are_no_text(tmp_path):
    path = tmp_path / "transforms.json"
    frame = {"file_path": "\ud800.png", "transform_matrix": np.eye(4).tolist()}
    path.write_text(json.dumps({"frames": [frame]}))
    expect(path, "nerfstudio", "expected an image name in UTF-8", 1)


def matrix_file(tmp_path, name, matrix):
    if name == "nerfstudio":
        path = tmp_path / "transforms.json"
        frame = {"file_path": "a.png", "transform_matrix": matrix.tolist()}
        path.write_text(json.dumps({"frames": [frame]}))
    elif name == "kitti":
        path = tmp_path / "poses.txt"
        np.savetxt(path, matrix[:3].reshape(1, 12))
    else:
        path = tmp_path
        np.savetxt(tmp_path / "frame-000000.pose.txt", matrix)
    return path


@pytest.mark.parametrize("name", ["kitti", "7scenes", "nerfstudio"])
def test_matrices_that_are_no_rotation(name, tmp_path):
    for matrix, pattern in (
        (np.diag([1.0, 1, -1, 1]), r"mirror image \(determinant -1\)"),
        (np.diag([1.0, 1, 1.5, 1]), "not orthonormal"),
        (np.diag([0.0, 0, 0, 1]), "not orthonormal"),
        (np.diag([1e300, 1, 1, 1]), "expected finite numbers and a rotation"),
        (np.diag([float("nan"), 1, 1, 1]), "expected finite numbers and a rotation"),
    ):
        with pytest.raises(FormatError, match=pattern):
            read_trajectory(matrix_file(tmp_path, name, matrix), name)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_cambridge_headers_end_where_rows_begin(count, tmp_path):
    path = tmp_path / "dataset_train.txt"
    header = ["Visual Landmark Dataset V1", "ImageFile, Camera Position [X Y Z W P Q R]", ""]
    rows = [f"seq1/f{i}.png {i} 2 3 1 0 0 0" for i in range(5)]
    path.write_text("\n".join([*header[3 - count :], *rows]) + "\n")
    read = read_trajectory(path)
    assert read.names == tuple(f"seq1/f{i}.png" for i in range(5))
    assert read.position_m[0].tolist() == [0, 2, 3]


def test_a_broken_first_row_is_no_header(tmp_path):
    path = tmp_path / "dataset_train.txt"
    rows = "seq1/f1.png 1 2 3 1 0 0 0\n" * 3
    path.write_text("ImageFile, Camera Position [X Y Z W P Q R]\nf0.png 1 2 3 1 0 0\n" + rows)
    expect(path, "cambridge", "expected 8 columns .* got 7", 2)
    path.write_text("one\ntwo\nthree\nfour\n" + rows)
    expect(path, "cambridge", "expected 8 columns .* got 1", 4)


def test_colmap_points_must_follow_images(tmp_path):
    path = tmp_path / "images.txt"
    path.write_text("1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b.png\n")
    expect(path, "colmap", "expected points as X Y POINT3D_ID after an image", 2)


@pytest.mark.parametrize("keep", [4, 8, 20, 90, -3])
def test_a_binary_model_that_ends_early(keep, tmp_path):
    path = write_valid("colmap-binary", tmp_path)
    path.write_bytes(path.read_bytes()[:keep])
    expect(path, "colmap-binary", "end of the file|room for", None if keep in (4, 8, 20, 90) else 4)


def test_a_header_without_the_columns(tmp_path):
    for name in ("stray", "aria", "mstransformer"):
        path = tmp_path / "a.csv"
        path.write_text("a,b\n1,2\n")
        expect(path, name, "expected a header with the columns", 1)


def test_a_file_of_no_known_format(tmp_path):
    path = tmp_path / "letter.txt"
    path.write_text("Dear Sir or Madam,\n")
    assert rank_formats(path) == []
    with pytest.raises(
        FormatError,
        match="letter.txt: expected a trajectory, got text of no",
    ):
        read_trajectory(path)


def test_no_format_of_that_name(tmp_path):
    with pytest.raises(ParameterError, match="unknown format 'tmu': expected one of tum"):
        read_trajectory(tmp_path, "tmu")


@pytest.mark.parametrize("format_", [f for f in FILES if f.write], ids=lambda f: f.name)
def test_a_file_that_cannot_be_written(format_, tmp_path):
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / file_name(format_)
    with pytest.raises(UnwritableError, match="cannot be written"):
        format_.write(path, make_trajectory(format_))
