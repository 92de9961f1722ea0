"""RealityCapture's heading, pitch and roll, by the makers' words and a published camera."""

import numpy as np
import pytest

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.registry import rank_formats, read_trajectory

HEADER = "#name,x,y,alt,heading,pitch,roll,f,px,py\n"


def read_angles(path, heading, pitch, roll):
    """right, down and forward of a camera with these angles, as rows."""
    path.write_text(f"{HEADER}a b.jpg,1,2,3,{heading},{pitch},{roll},24,0,0\n")
    track = read_trajectory(path)
    assert track.position_m[0].tolist() == [1, 2, 3]
    assert track.names == ("a b.jpg",)
    return track.target_from_source.to_matrix()[0, :3, :3].T


def test_the_makers_words(tmp_path):
    """x is east, y north, z up."""
    path = tmp_path / "cameras.csv"
    axes = read_angles(path, 0, 0, 0)  # looks down, its top is north
    np.testing.assert_allclose(axes, np.diag([1, -1, -1]), atol=1e-12)
    _, down, forward = read_angles(path, 0, 90, 0)  # raised to the horizon: north
    np.testing.assert_allclose([down, forward], [[0, 0, -1], [0, 1, 0]], atol=1e-12)
    assert read_angles(path, 90, 90, 0)[2] == pytest.approx([1, 0, 0], abs=1e-12)  # east
    assert read_angles(path, 180, 90, 0)[2] == pytest.approx([0, -1, 0], abs=1e-12)  # south
    _, down, forward = read_angles(path, 90, 0, 0)  # looks down, its top is east
    np.testing.assert_allclose([down, forward], [[-1, 0, 0], [0, 0, -1]], atol=1e-12)


def test_a_published_camera(tmp_path):
    """Epic's forum, topic 710449: the matrix of the XMP file, cam_from_world, and its angles."""
    angles = (163.736597399311, 83.4154313461628, 174.386496244756)
    matrix = [
        [0.982594073038806, 0.185426733553445, -0.0112166890261935],
        [-0.032113633044729, 0.11008102707942, -0.993403685341366],
        [-0.18296885582437, 0.976472781986697, 0.114],  # cut off there
    ]
    found = read_angles(tmp_path / "cameras.csv", *angles)
    np.testing.assert_allclose(found[:2], matrix[:2], atol=1e-9)
    np.testing.assert_allclose(found[2], matrix[2], atol=2e-4)


def test_other_names_of_the_columns(tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text("#cameras 1\n#Name, X, Y, Z, Yaw, Pitch, Roll\na.jpg, 1, 2, 3, 0, 90, 0\n")
    assert rank_formats(path)[0][0].name == "realitycapture"
    track = read_trajectory(path)
    assert track.target_from_source.to_matrix()[0, :3, 2] == pytest.approx([0, 1, 0], abs=1e-12)


def test_other_angles_are_not_guessed(tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text("#name,x,y,alt,omega,phi,kappa\na.jpg,1,2,3,0,0,0\n")
    with pytest.raises(FormatError, match=":1: .*export heading, pitch, roll instead of omega"):
        read_trajectory(path)
    path.write_text("a.jpg,1,2,3,0,0,0\n")
    with pytest.raises(FormatError, match=r"expected a header #name,x,y,alt,.*; found none"):
        read_trajectory(path, "realitycapture")


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("a.jpg,1,2,3,0,0", "expected 10 columns"),
        ("a.jpg,1,2,3,x,0,0,1,1,1", "expected a number, got 'x'"),
        ("a.jpg,nan,2,3,0,0,0,1,1,1", "expected finite numbers"),
        ("a.jpg,1,2,3,1e300,0,0,1,1,1", "expected finite numbers"),
        ("", "the file is empty"),
    ],
)
def test_malformed(row, problem, tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text(f"{HEADER}{row}\n")
    with pytest.raises(FormatError, match=problem):
        read_trajectory(path, "realitycapture")


def test_one_bad_row_is_left_out(tmp_path):
    path = tmp_path / "cameras.csv"
    rows = [f"{k}.jpg,{k},0,0,0,0,0,1,1,1" for k in range(5)]
    rows[2] = "2.jpg,,,,,,,,,"
    path.write_text(HEADER + "\n".join(rows))
    notes = ReadingNotes()
    track = read_trajectory(path, None, ReadOptions(notes=notes))
    assert track.names == ("0.jpg", "1.jpg", "3.jpg", "4.jpg")
    assert notes.warnings == ["1 row has no pose (line 4): left out"]
