"""What scenes hold, checked by hand."""

import numpy as np
import pytest
from tests.scene.scenes import edit, jpeg, make_scene, pose

from vioapr.scene.frames import Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.summary import summarize_scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo


@pytest.fixture
def scene(tmp_path):
    return make_scene(tmp_path / "scene", 9)


def test_a_scene(scene):
    summary = summarize_scene(scene)
    assert (summary.name, summary.is_outdoor) == ("Courtyard", True)
    assert (summary.images("train"), summary.images("test")) == (9, 9)
    first = summary.recordings[0]
    assert (first.id, first.split, first.device) == ("walk-1", "train", "iPhone 14 Pro, ARKit")
    assert (first.frames, first.images, first.gt_frames) == (9, 9, 9)
    assert first.tracking == {"normal": 9, "limited": 0, "lost": 0, "reset": 0}
    # Eight steps of 0.5 m in 0.5 s each.
    assert (first.duration_s, first.path_m) == (4, 4)
    np.testing.assert_allclose(first.speeds_m_s, [1, 1, 1, 1])
    assert first.speeds_of == "vio"
    size, of = summary.extent_m
    assert (size.tolist(), of) == ([0, 4, 0], "gt")


def test_extent_without_ground_truth_is_the_largest_tracks(scene):
    for id_ in ("walk-1", "walk-2"):
        scene.gt_path(id_).unlink()
    size, of = summarize_scene(scene).extent_m
    # y of the tracker's world is its height and comes last.
    assert (size.tolist(), of) == ([4, 0, 0], "vio")


def write_walk(scene, id_, frames):
    with RecordingWriter(scene.recording_folder(id_), RecordingInfo(tracker="ARKit")) as writer:
        for time, x, tracking in frames:
            at = None if tracking == Tracking.LOST else pose(x)
            writer.add_frame(time, f"{time}.jpg", jpeg(), tracking, at)


def test_ways_are_not_measured_across_resets_and_gaps(tmp_path):
    scene = Scene.create(tmp_path / "s", "s", is_outdoor=False).with_recording("a", "train")
    normal, lost, reset = Tracking.NORMAL, Tracking.LOST, Tracking.RESET
    frames = [(0, 0, normal), (1, 2, normal), (2, 4, normal), (3, 0, lost), (4, 0, lost)]
    frames += [(5, 100, reset), (6, 103, normal), (7, 106, normal)]
    write_walk(scene, "a", frames)
    (recording,) = summarize_scene(scene).recordings
    assert recording.path_m == 10
    assert recording.speeds_m_s.tolist() == [2, 2, 3, 3]
    assert recording.tracking == {"normal": 5, "limited": 0, "lost": 2, "reset": 1}


@pytest.mark.parametrize("rows", [1, 2, 3, 7, 100])
def test_parts_of_a_table_add_up(rows, tmp_path, monkeypatch):
    """However the frames are cut into blocks, the sums are the same."""
    monkeypatch.setattr("vioapr.files.append_table.BLOCK_ROWS", rows)
    scene = Scene.create(tmp_path / "s", "s", is_outdoor=False).with_recording("a", "train")
    times = 0.25 * np.arange(41)
    write_walk(scene, "a", [(t, t * t / 10, Tracking.NORMAL) for t in times.tolist()])
    (recording,) = summarize_scene(scene).recordings
    assert recording.frames == 41
    assert recording.duration_s == 10
    np.testing.assert_allclose(recording.path_m, 10)
    # From second k to k + 1, x = t^2 / 10 grows by (2 k + 1) / 10.
    np.testing.assert_allclose(recording.speeds_m_s, (2 * np.arange(10) + 1) / 10)


def test_low_rates_have_speeds_too(tmp_path):
    scene = Scene.create(tmp_path / "s", "s", is_outdoor=False).with_recording("a", "train")
    write_walk(scene, "a", [(2.5 * k, 5.0 * k, Tracking.NORMAL) for k in range(5)])
    assert summarize_scene(scene).speeds_m_s.tolist() == [2] * 4


def test_without_tracker_speeds_are_of_ground_truth(scene):
    path = scene.folder / "recordings/walk-1/frames.csv"
    lines = path.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    rows = [[*row[:2], "lost", *[""] * 7, *row[10:]] for row in rows]
    path.write_text("\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n")
    first = summarize_scene(scene).recordings[0]
    assert first.speeds_of == "gt"
    np.testing.assert_allclose(first.speeds_m_s, 1)


def test_broken_lines_are_left_out_and_said(scene):
    edit(scene.folder / "recordings/walk-1/frames.csv", "normal", "fine")
    first = summarize_scene(scene).recordings[0]
    assert first.frames == 8
    assert first.problem.startswith("1 line of frames.csv left out")


def test_broken_ground_truth_is_said(scene):
    scene.gt_path("walk-1").write_text("x\n")
    first = summarize_scene(scene).recordings[0]
    problem = "walk-1.tum: expected rows of timestamp x y z qx qy qz qw, got none"
    assert first.problem.endswith(problem)


def test_excluded_recordings_do_not_count(scene):
    scene = scene.with_excluded("walk-2", "rain")
    summary = summarize_scene(scene)
    assert [recording.split for recording in summary.recordings] == ["train", "excluded"]
    assert len(summary.speeds_m_s) == 4
