"""Formats that look alike are told apart by content where it tells, and by name where not."""

import pytest
from tests.formats.conftest import FOLDERS, file_name, make_trajectory
from tests.formats.samples import write_sample

from vioapr.files.text import natural_key
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import FORMATS, rank_formats, read_trajectory

QUAT_FIRST = "a/1.png 0.6 0 0.8 0 10 20 30\n"
QUAT_LAST = "a/1.png 10 20 30 0.6 0 0.8 0\n"


def rank(tmp_path, name, content):
    path = tmp_path / name
    path.write_text(content)
    return [(format_.name, confidence) for format_, confidence in rank_formats(path)]


def test_the_quaternions_place_tells_hloc(tmp_path):
    assert rank(tmp_path, "poses.txt", QUAT_FIRST) == [("hloc", 0.85)]
    assert "hloc" not in dict(rank(tmp_path, "poses.txt", QUAT_LAST))


def test_further_columns_tell_ace(tmp_path):
    assert rank(tmp_path, "poses.txt", QUAT_FIRST[:-1] + " 0.1 2 900")[0][0] == "ace"
    assert rank(tmp_path, "poses.txt", QUAT_FIRST[:-1] + " 525.5")[0][0] == "hloc"


@pytest.mark.parametrize(
    ("name", "expected", "sure"),
    [
        ("KingsCollege_PoseNet_predict.txt", "hrapr", 0.9),
        ("KingsCollege_test_gt.txt", "hrapr", 0.9),
        ("train.txt", "marvin", 0.8),
        ("test.txt", "marvin", 0.8),
        ("ARKit.txt", "marvin-vio", 0.9),
        ("ARCore.txt", "marvin-vio", 0.9),
        ("poses.txt", "hrapr", 0.5),
    ],
)
def test_only_the_name_tells_hrapr_from_marvin(name, expected, sure, tmp_path):
    ranked = rank(tmp_path, name, QUAT_LAST)
    assert ranked[0] == (expected, sure)
    assert {"hrapr", "marvin", "marvin-vio"} <= {name for name, _ in ranked}


def test_advio_is_told_by_name(tmp_path):
    row = "0.5,1,2,3,0.6,0,0.8,0\n"
    assert rank(tmp_path, "advio-03_gt_pose.csv", row)[0] == ("advio-gt", 0.9)
    assert rank(tmp_path, "pose.csv", row)[0] == ("advio-gt", 0.9)
    assert rank(tmp_path, "arcore.csv", row)[0] == ("advio-vio", 0.9)
    assert rank(tmp_path, "walk.csv", row) == [
        *(("tum", 0.45), ("advio-vio", 0.4), ("euroc", 0.3), ("advio-gt", 0.3))
    ]


def test_nanoseconds_and_a_header_tell_euroc(tmp_path):
    """Alone, nanoseconds do not: the quaternion may be in either order."""
    row = "1403636579763555584,1,2,3,0.6,0,0.8,0\n"
    assert rank(tmp_path, "data.csv", row) == [("euroc", 0.55), ("tum", 0.4)]
    biases = row[:-1] + ",0" * 9 + "\n"
    assert rank(tmp_path, "data.csv", biases)[0] == ("euroc", 0.7)
    header = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], "
    header += "q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
    assert rank(tmp_path, "data.csv", header + row)[0] == ("euroc", 0.95)
    wrong = header.replace("q_RS_w", "q_RS_v").replace("q_RS_z", "q_RS_w").replace("_v", "_z")
    assert rank(tmp_path, "data.csv", wrong + row)[0] == ("table", 0.9)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_the_start_of_a_long_file_is_enough(name, tmp_path):
    format_ = FORMATS[name]
    count = 40 if name in FOLDERS else 700
    path = tmp_path / file_name(format_)
    original = make_trajectory(format_, count)
    write_sample(format_, path, original)
    assert rank_formats(path)[0][0].name == name
    assert len(read_trajectory(path)) == count


def test_windows_line_ends_and_byte_order_marks(tmp_path):
    for name in ("tum", "hloc", "mstransformer", "stray", "aria"):
        format_ = FORMATS[name]
        path = tmp_path / file_name(format_)
        format_.write(path, make_trajectory(format_))
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
        assert len(format_.read(path, ReadOptions())) == 12, name


def test_natural_order():
    names = [
        "f10.png",
        "f9.png",
        "f2b.png",
        "f2.png",
        "f02.png",
        "F1.png",
        "10",
        "9",
        "f" + "9" * 5000,
    ]
    assert sorted(names, key=natural_key) == [
        *("9", "10", "F1.png", "f2.png", "f02.png", "f2b.png", "f9.png", "f10.png"),
        "f" + "9" * 5000,
    ]
