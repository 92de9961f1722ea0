"""Order, sequences and times of formats that go by image name."""

import pytest

from vioapr.errors import FormatError, ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import read_trajectory, read_with_notes

POSE = "1 0 0 0 0 0 0"
QUAT = "0.6 0 0.8 0"
TWO = f"b/frame10.png {POSE}\nb/frame9.png {POSE}\na/frame2.png {POSE}\n"


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text(TWO)
    return file


def read(path, **options):
    return read_trajectory(path, "hloc", ReadOptions(**options))


def test_names_come_in_natural_order(path):
    trajectory = read(path)
    assert trajectory.names == ("a/frame2.png", "b/frame9.png", "b/frame10.png")
    assert not trajectory.is_timed
    assert trajectory.timestamp_s.tolist() == [0, 1, 2]


def test_a_sequence_is_picked_by_folder(path):
    assert read(path, sequence="b").names == ("b/frame9.png", "b/frame10.png")
    assert read(path, sequence="b/").names == read(path, sequence="b").names


def test_a_sequence_may_be_the_last_part_of_a_path(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text(f"King/seq1/f1.png {POSE}\nKing/xseq1/f1.png {POSE}\n")
    assert read(file, sequence="seq1").names == ("King/seq1/f1.png",)


def test_a_rate_makes_times_of_frame_numbers(path):
    trajectory = read(path, sequence="b", rate_hz=2)
    assert trajectory.is_timed
    assert trajectory.timestamp_s.tolist() == [4.5, 5]


def test_a_rate_for_several_sequences_lists_them(path):
    with pytest.raises(ParameterError, match="several sequences.*`sequence`: a, b"):
        read(path, rate_hz=2)


def test_an_unknown_sequence_lists_those_there(path):
    with pytest.raises(ParameterError, match="no sequence 'c': expected one of a, b"):
        read(path, sequence="c")


def test_a_name_without_number_has_no_time(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text(f"frame.png {POSE}\n")
    with pytest.raises(FormatError, match=r"poses.txt:1: expected a frame number"):
        read(file, rate_hz=2)


def test_the_number_is_the_last_of_the_file_name(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text(f"s7/image1_000030.color.png {POSE}\n")
    assert read(file, rate_hz=30).timestamp_s.tolist() == [1]


def test_two_images_of_one_number_are_refused(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text(f"left1.png {POSE}\nright1.png {POSE}\n")
    with pytest.raises(FormatError, match="duplicate"):
        read(file, rate_hz=2)


@pytest.mark.parametrize("rate_hz", [0, -1, float("nan"), float("inf")])
def test_a_rate_must_be_above_zero(rate_hz):
    with pytest.raises(ParameterError, match="rate above 0"):
        ReadOptions(rate_hz=rate_hz)


@pytest.mark.parametrize(
    "image",
    ["my walk/frame 1.png", "IMG 0001.jpg", "a  b.png", "frame 7", "2024 03 01 at noon.png"],
)
@pytest.mark.parametrize("focal", ["", " 525.5"])
def test_names_with_spaces(image, focal, tmp_path):
    path = tmp_path / "poses.txt"
    rows = [f"{image} {QUAT} 1 2 3{focal}", f"plain.png {QUAT} 4 5 6{focal}"]
    path.write_text("\n".join(rows))
    read = read_trajectory(path)
    assert set(read.names) == {image, "plain.png"}
    assert read.position_m[read.names.index("plain.png")].tolist() != [0, 0, 0]


def test_lost_images_with_spaces(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(f"a b.png nan nan nan nan nan nan nan\nc d.png {QUAT} 1 2 3\n")
    reading = read_with_notes(path)
    assert reading.trajectory.names == ("c d.png",)
    assert reading.left_out[0].name == "a b.png"


def test_the_same_row_twice(tmp_path):
    path = tmp_path / "poses.txt"
    rows = [f"{i}.png {QUAT} {i} 2 3" for i in range(5)]
    path.write_text("\n".join([*rows, rows[2]]) + "\n")
    reading = read_with_notes(path)
    assert len(reading.trajectory) == 5
    assert reading.warnings == ["poses.txt:6: repeats line 3, left out (2.png)"]


def test_a_last_row_that_was_cut_off(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(f"a.png {QUAT} 1 2 3\nb.png {QUAT} 4 5 6\nc.png 1 0 0")
    reading = read_with_notes(path)
    assert reading.trajectory.names == ("a.png", "b.png")
    assert reading.warnings == ["the file ends in the middle of line 3: left out"]
    with pytest.raises(FormatError, match=r"poses.txt:3: expected 8 columns .* got 4"):
        read_with_notes(path, options=ReadOptions(strict=True))
