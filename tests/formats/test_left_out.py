"""Rows without a pose are left out, counted and named; a file of mostly such rows is refused."""

import logging

import numpy as np
import pytest
from tests.cases_of import case_folder
from tests.formats.conftest import file_name, make_trajectory

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import FORMATS, read_trajectory, read_with_notes

POSE = "1 2 3 0 0 0 1"
NONE = "0 0 0 0 0 0 0"


def table(tmp_path, rows, name="walk.tum"):
    """A TUM file of rows that may begin with their own time."""
    path = tmp_path / name
    lines = [row if row.count(" ") == 7 else f"{i} {row}" for i, row in enumerate(rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    "nothing", [NONE, " ".join(["nan"] * 7), "1 2 3 0 0 0 0", "inf " * 6 + "1"]
)
def test_rows_without_a_pose(nothing, tmp_path):
    path = table(tmp_path, [nothing] * 20 + [POSE] * 30 + [nothing] + [POSE] * 9)
    reading = read_with_notes(path)
    assert reading.trajectory.timestamp_s.tolist() == [*range(20, 50), *range(51, 60)]
    assert reading.warnings == ["21 rows have no pose (lines 1 to 20, 51): left out"]
    assert [row.line for row in reading.left_out] == [*range(1, 21), 51]
    assert [row.timestamp_s for row in reading.left_out] == [*range(20), 50]


def test_a_single_row_without_a_pose(tmp_path):
    reading = read_with_notes(table(tmp_path, [POSE, NONE, POSE]))
    assert reading.warnings == ["1 row has no pose (line 2): left out"]


def test_most_rows_may_have_no_pose_but_not_all(tmp_path):
    assert len(read_trajectory(table(tmp_path, [NONE] * 50 + [POSE] * 2))) == 2
    with pytest.raises(
        FormatError, match="walk.tum:1: expected a unit quaternion, got one of norm 0"
    ):
        read_trajectory(table(tmp_path, [NONE] * 50))


def test_mostly_malformed_rows_are_a_misread_file(tmp_path):
    with pytest.raises(FormatError, match="walk.tum:2: expected a unit quaternion, .* norm 2"):
        read_trajectory(table(tmp_path, [POSE, *["1 2 3 0 0 0 2"] * 3, POSE]))
    reading = read_with_notes(table(tmp_path, [POSE, "1 2 3 0 0 0 2", *[POSE] * 3]))
    assert reading.warnings == ["walk.tum:2: quaternion has norm 2, left out"]


@pytest.mark.parametrize(
    ("far", "text"), [(3117382476.41, "3.1e9"), (-5e6, "5e6"), (2e300, "2e300")]
)
def test_one_absurd_position(far, text, tmp_path):
    rows = [f"{0.1 * i} 0 0 0 0 0 1" for i in range(60)]
    rows[23] = f"{far!r} 0 0 0 0 0 1"
    reading = read_with_notes(table(tmp_path, rows))
    assert len(reading.trajectory) == 59
    assert reading.warnings == [f"walk.tum:24: position is {text} m away, left out"]


def test_large_coordinates_are_no_outliers(tmp_path):
    """Of a map in geocentric or projected metres, and of a walk between two places."""
    rows = [f"{4.2e6 + i} 3e6 {4.6e6 - i} 0 0 0 1" for i in range(60)]
    assert read_with_notes(table(tmp_path, rows)).warnings == []
    rows = [f"{i % 2 * 2e4} 0 0 0 0 0 1" for i in range(60)]
    assert read_with_notes(table(tmp_path, rows)).warnings == []


def test_the_image_of_a_row_is_named(tmp_path):
    rows = [f"seq1/f{i}.png 1 0 0 0 {i} 2 3" for i in range(30)]
    rows[4] = "seq1/f4.png 1 0 0 0 -3e9 2 3"
    rows[7] = "seq1/f7.png nan nan nan nan nan nan nan"
    path = tmp_path / "poses.txt"
    path.write_text("\n".join(rows))
    reading = read_with_notes(path, "hloc")
    assert reading.warnings == [
        "1 row has no pose (line 8): left out",
        "poses.txt:5: position is 3e9 m away, left out (seq1/f4.png)",
    ]
    assert [row.name for row in reading.left_out] == ["seq1/f4.png", "seq1/f7.png"]


@pytest.mark.parametrize("name", ["kitti", "7scenes", "nerfstudio"])
@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_matrices_of_lost_frames(name, value, tmp_path):
    path = tmp_path / file_name(FORMATS[name])
    original = make_trajectory(FORMATS[name])
    FORMATS[name].write(path, original)
    file = path if path.is_file() else sorted(path.rglob("*.txt"))[3]
    text = file.read_text()
    if name == "kitti":
        lines = text.splitlines()
        lines[3] = " ".join([str(value)] * 12)
        file.write_text("\n".join(lines))
    elif name == "7scenes":
        np.savetxt(file, np.full((4, 4), value))
    else:
        frames = text.split('"transform_matrix": ')
        nothing = str([[value] * 4] * 4).replace("nan", "NaN").replace("inf", "Infinity")
        frames[4] = nothing + frames[4][frames[4].index("]\n   ]") + len("]\n   ]") :]
        file.write_text('"transform_matrix": '.join(frames))
    reading = read_with_notes(path)
    assert len(reading.trajectory) == 11
    assert reading.warnings == ["1 row has no pose (line 4): left out"]
    if original.names:
        assert [row.name for row in reading.left_out] == [original.names[3]]


def test_a_repeated_time(tmp_path):
    rows = [f"{t} {POSE}" for t in (0, 1, 2, 2, 3, 4, 4, 4, 5)]
    reading = read_with_notes(table(tmp_path, rows))
    assert reading.trajectory.timestamp_s.tolist() == [0, 1, 2, 3, 4, 5]
    assert [row.line for row in reading.left_out] == [4, 7, 8]
    assert reading.warnings[0].startswith(
        "time: 3 rows out of order, left out: line 4: timestamp 2.000000 s is a duplicate of one"
    )


def test_one_time_far_ahead_costs_one_row(tmp_path):
    rows = [f"{t} {POSE}" for t in (0, 1, 2, 900, 3, 4, 5, 6, 7, 8, 9, 10, 11)]
    reading = read_with_notes(table(tmp_path, rows))
    assert [row.line for row in reading.left_out] == [4]
    assert "900.000000 s is later than those after" in reading.warnings[0]


@pytest.mark.parametrize("second", [range(50), range(20), range(0, 50, 5)])
def test_two_runs_in_one_file(second, tmp_path):
    rows = [f"{t} {POSE}" for t in (*range(50), *second)]
    with pytest.raises(FormatError, match="walk.tum:51: expected increasing .* two runs?"):
        read_trajectory(table(tmp_path, rows))


def test_strict_refuses_the_first(tmp_path):
    rows = [POSE] * 60
    rows[3], rows[20] = "1e5 2 3 0 0 0 1", NONE
    with pytest.raises(FormatError, match="walk.tum:4: expected a position near the others"):
        read_trajectory(table(tmp_path, rows), options=ReadOptions(strict=True))
    rows[3] = POSE
    with pytest.raises(FormatError, match="walk.tum:21: expected a unit quaternion"):
        read_trajectory(table(tmp_path, rows), options=ReadOptions(strict=True))


def test_simple_reading_logs(tmp_path, caplog):
    with caplog.at_level(logging.WARNING, "vioapr.formats"):
        assert len(read_trajectory(table(tmp_path, [POSE, NONE, POSE]))) == 2
    assert "1 row has no pose (line 2): left out" in caplog.text


def test_the_case_of_lost_rows():
    folder = case_folder("07-lost-rows-nan")
    for name in ("nan_start.tum", "zero_quat.tum"):
        reading = read_with_notes(folder / name)
        assert len(reading.trajectory) == 130
        assert reading.warnings == ["20 rows have no pose (lines 1 to 20): left out"]


def test_the_case_of_one_broken_row():
    path = case_folder("06-cambridge-one-broken-row") / "dataset_train.txt"
    count = len([line for line in path.read_text().splitlines() if ".png" in line])
    reading = read_with_notes(path)
    assert len(reading.trajectory) == count - len(reading.left_out)
    assert reading.warnings == [
        "dataset_train.txt:24: position is 3.1e9 m away, left out (seq1/frame00021.png)"
    ]


def test_the_case_of_one_duplicate():
    folder = case_folder("25-one-duplicate-timestamp")
    reading = read_with_notes(folder / "groundtruth.txt")
    assert len(reading.trajectory) == 150
    assert reading.left_out[0].line == 73
