"""frames.csv: what is written is read back, and every malformed line is named."""

import numpy as np
import pytest
from tests.scene.scenes import edit, write_recording

from vioapr.errors import FormatError, ParameterError
from vioapr.scene.frames import HEADER, Intrinsics, Tracking, find_name_problem, read_frames
from vioapr.scene.recording import Recording

GOOD = "{t},{name},normal,1,2,3,0,0,0,1,16,12,20,20,8,6"


def read_lines(tmp_path, *lines):
    path = tmp_path / "frames.csv"
    path.write_text("\n".join([HEADER, *lines]) + "\n")
    problems = []
    return read_frames(path, problems), problems


def line(t=0, name="a.jpg", **fields):
    values = dict(zip(HEADER.split(","), GOOD.format(t=t, name=name).split(","), strict=True))
    values.update({key: str(value) for key, value in fields.items()})
    return ",".join(values.values())


NO_POSE = dict.fromkeys(("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"), "")


def test_columns(tmp_path):
    frames, problems = read_lines(
        tmp_path,
        line(0.5),
        line(1.5, "", tracking="lost", **NO_POSE),
        line(2.5, "c.jpg", tracking="reset", width="", height="", fx="", fy="", cx="", cy=""),
        line(3.5, "d.png", tracking="limited"),
    )
    assert problems == []
    assert frames.timestamp_s.tolist() == [0.5, 1.5, 2.5, 3.5]
    assert frames.image == ("a.jpg", "", "c.jpg", "d.png")
    assert [Tracking(t).label for t in frames.tracking] == ["normal", "lost", "reset", "limited"]
    assert frames.has_pose.tolist() == [True, False, True, True]
    assert frames.has_image.tolist() == [True, False, True, True]
    assert frames.tracking_world.tolist() == [0, 0, 1, 1]
    np.testing.assert_array_equal(frames.vio_from_cam.translation_m[0], [1, 2, 3])
    np.testing.assert_array_equal(frames.vio_from_cam.quat_xyzw[0], [0, 0, 0, 1])
    assert frames.intrinsics.at(0) == Intrinsics(16, 12, 20, 20, 8, 6)
    assert np.isnan(frames.intrinsics.fx[2])
    assert frames.lines.tolist() == [2, 3, 4, 5]


def test_trajectory_of_the_tracked_frames(tmp_path):
    frames, _ = read_lines(
        tmp_path, line(0), line(1, "b.jpg", tracking="lost", **NO_POSE), line(2, "c.jpg")
    )
    trajectory = frames.to_trajectory()
    assert trajectory.timestamp_s.tolist() == [0, 2]
    assert trajectory.names == ("a.jpg", "c.jpg")
    assert trajectory.target == "vio"


def test_no_pose_no_trajectory(tmp_path):
    frames, _ = read_lines(tmp_path, line(0, tracking="lost", **NO_POSE))
    with pytest.raises(ParameterError, match="at least one pose"):
        frames.to_trajectory()


@pytest.mark.parametrize(
    ("bad", "problem"),
    [
        (line(1).removesuffix(",6"), "expected 16 fields, got 15"),
        (line(""), "expected a timestamp in seconds, got none"),
        (line("now"), "expected a finite number, got 'now'"),
        (line("nan"), "expected a finite number, got 'nan'"),
        (line(1.7e18), "got a larger unit"),
        (line(0), r"later than the one before \(0.000000 s\), got 0.000000 s"),
        (line(-1), "later than the one before"),
        (line(1, x_m="1e400"), "expected a finite number, got '1e400'"),
        (line(1, x_m=""), "expected all of x_m,y_m,z_m,qx,qy,qz,qw or none"),
        (line(1, **NO_POSE), "expected a pose, as tracking is not lost"),
        (line(1, tracking="lost"), "expected no pose, as tracking is lost"),
        (line(1, tracking="good"), "expected tracking to be one of normal, limited, lost, reset"),
        (line(1, tracking=""), "expected tracking to be one of"),
        (line(1, qw=2), "expected a unit quaternion"),
        (line(1, x_m=1e10), "expected a position in metres"),
        (line(1, width=""), "expected width,height and fx,fy,cx,cy, each all or none"),
        (line(1, cx=""), "expected width,height and fx,fy,cx,cy, each all or none"),
        (line(1, width=0), "expected width,height above 0, whole"),
        (line(1, width=1.5), "expected width,height above 0, whole"),
        (line(1, fx=0), "expected focal lengths fx,fy above 0"),
        (line(1, "../a.jpg"), "expected a plain file name"),
        (line(1, " a.jpg"), "expected a plain file name"),
    ],
)
def test_a_malformed_line_is_named_and_left_out(bad, problem, tmp_path):
    frames, problems = read_lines(tmp_path, line(0), bad, line(5, "z.jpg"))
    assert len(problems) == 1
    assert problems[0].line == 3
    assert problems[0].is_error
    with pytest.raises(FormatError, match=f"frames.csv:3: .*{problem}"):
        raise problems[0].to_error()
    assert frames.image == ("a.jpg", "z.jpg")


def test_order_is_checked_across_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr("vioapr.files.append_table.BLOCK_ROWS", 2)
    times = [0, 1, 2, 1.5, 3]
    frames, problems = read_lines(tmp_path, *(line(t, f"{k}.jpg") for k, t in enumerate(times)))
    assert [problem.line for problem in problems] == [5]
    assert frames.timestamp_s.tolist() == [0, 1, 2, 3]


def test_a_torn_last_line_loses_that_frame_only(tmp_path):
    folder = write_recording(tmp_path / "walk", 5)
    table = folder / "frames.csv"
    whole = table.read_bytes()
    for cut in (1, 2, 20):
        table.write_bytes(whole[:-cut])
        frames = Recording.open(folder).frames
        assert len(frames) == 4
        assert frames.image[-1] == "frame-3.jpg"


def test_another_header(tmp_path):
    folder = write_recording(tmp_path / "walk", 2)
    edit(folder / "frames.csv", "timestamp_s", "time")
    with pytest.raises(FormatError, match=r"frames.csv:1: expected the header timestamp_s,image"):
        _ = Recording.open(folder).frames


def test_further_columns_are_passed_over(tmp_path):
    path = tmp_path / "frames.csv"
    path.write_text(f"{HEADER},exposure_s\n{line(0)},0.01\n")
    assert len(read_frames(path, [])) == 1


def test_only_malformed_lines(tmp_path):
    frames, problems = read_lines(tmp_path, line("now"), line("then"))
    assert len(frames) == 0
    assert [problem.line for problem in problems] == [2, 3]


def test_empty_table(tmp_path):
    frames, problems = read_lines(tmp_path)
    assert len(frames) == 0
    assert problems == []


@pytest.mark.parametrize("name", ["", "a.jpg", "frame 1.jpg", "ünï.png"])
def test_good_names(name):
    assert find_name_problem(name) is None


@pytest.mark.parametrize("name", ["a/b.jpg", "a\\b.jpg", "a,b.jpg", 'a"b', ".hidden", "a ", "a\nb"])
def test_bad_names(name):
    assert "expected a plain file name" in find_name_problem(name)
