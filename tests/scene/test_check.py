"""`check_scene` finds everything that is wrong, each with file and line."""

import numpy as np
import pytest
from tests.scene.scenes import edit, jpeg, make_scene, write_recording

from vioapr.errors import FileMissingError
from vioapr.formats.registry import FORMATS
from vioapr.scene.check import check_scene, count_frames
from vioapr.scene.frames import Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory


@pytest.fixture
def scene(tmp_path):
    return make_scene(tmp_path / "scene", 5)


def errors(scene, **options):
    """Errors as text, paths relative to the scene."""
    prefix = f"{scene.folder}/"
    return [str(p).removeprefix(prefix) for p in check_scene(scene.folder, **options).errors]


def notes(scene):
    prefix = f"{scene.folder}/"
    found = check_scene(scene.folder).problems
    return [str(p).removeprefix(prefix) for p in found if not p.is_error]


def test_nothing_is_wrong(scene):
    steps = []
    report = check_scene(scene.folder, decode=True, tick=steps.append)
    assert report.problems == []
    assert (report.recordings, report.frames, report.images) == (2, 10, 10)
    assert sum(steps) == 10
    # Their headers are lines too.
    assert count_frames(scene.folder) == 12


WALK = "recordings/walk-1"


def remove_image(scene):
    (scene.folder / WALK / "images/frame-2.jpg").unlink()


def truncate_image(scene):
    (scene.folder / WALK / "images/frame-2.jpg").write_bytes(jpeg()[:-5])


def resize_image(scene):
    (scene.folder / WALK / "images/frame-2.jpg").write_bytes(jpeg(20, 10))


def break_line(scene):
    edit(scene.folder / WALK / "frames.csv", "1.0,frame-2.jpg,normal", "1.0,frame-2.jpg,good")


def repeat_image(scene):
    edit(scene.folder / WALK / "frames.csv", "frame-2.jpg", "frame-1.jpg")


def empty_frames(scene):
    path = scene.folder / WALK / "frames.csv"
    path.write_text(path.read_text().splitlines()[0] + "\n")


def drop_frames(scene):
    (scene.folder / WALK / "frames.csv").unlink()


def drop_info(scene):
    (scene.folder / WALK / "recording.json").unlink()


def break_imu(scene):
    (scene.folder / WALK / "imu.csv").write_text("time\n")


def break_gt(scene):
    edit(scene.gt_path("walk-1"), "0.5 ", "0.6 ")


def break_gt_row(scene):
    edit(scene.gt_path("walk-1"), "0.5 ", "x ")


def lose_recording(scene):
    scene.with_recording("walk-3", "train").save()


def use_twice(scene):
    edit(scene.folder / "scene.toml", 'test = ["walk-2"]', 'test = ["walk-2", "walk-1"]')


def list_twice(scene):
    edit(scene.folder / "scene.toml", '["walk-1"]', '["walk-1", "walk-1"]')


def empty_split(scene):
    edit(scene.folder / "scene.toml", '["walk-2"]', "[]")


def exclude_used(scene):
    edit(scene.folder / "scene.toml", "[world]", '[excluded]\nwalk-1 = "why"\n[world]')


def orphan_gt(scene):
    scene.gt_path("walk-9").write_text("0 0 0 0 0 0 0 1\n")


def map_of_missing_images(scene):
    FORMATS["colmap"].write(
        scene.map_folder / "images.txt",
        Trajectory.from_arrays(
            [0, 1], np.zeros((2, 3)), [[0, 0, 0, 1.0]] * 2,
            ["walk-1/images/frame-1.jpg", "walk-1/images/frame-77.jpg"], is_timed=False,
        ),
    )  # fmt: skip


def break_map(scene):
    scene.map_folder.mkdir()
    (scene.map_folder / "images.txt").write_text("1 2 3\n")


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (
            remove_image,
            f"{WALK}/frames.csv:4: images/frame-2.jpg: expected an image, found no file",
        ),
        (truncate_image, f"{WALK}/frames.csv:4: images/frame-2.jpg: truncated"),
        (resize_image, f"{WALK}/frames.csv:4: images/frame-2.jpg: the line says 16x12 pixels, but"),
        (break_line, f"{WALK}/frames.csv:4: expected tracking to be one of"),
        (repeat_image, f"{WALK}/frames.csv:4: the image frame-1.jpg is line 3's already"),
        (empty_frames, f"{WALK}/frames.csv: expected frames, found none"),
        (drop_frames, f"{WALK}/frames.csv: expected a file, found none"),
        (drop_info, f"{WALK}/recording.json: expected a file, found none"),
        (break_imu, f"{WALK}/imu.csv:1: expected the header timestamp_s,ax"),
        (break_gt, "gt/walk-1.tum: 1 of 5 poses are of no frame, the first at 0.600000 s"),
        (break_gt_row, "gt/walk-1.tum:3: expected a number, got 'x'"),
        (lose_recording, "scene.toml: splits.train names the recording 'walk-3', which is missing"),
        (use_twice, "scene.toml: the recording 'walk-1' is in both train and test"),
        (list_twice, "scene.toml: the recording 'walk-1' is in splits.train twice"),
        (empty_split, "scene.toml: the split test is empty"),
        (exclude_used, "scene.toml: the recording 'walk-1' is excluded, and in a split"),
        (orphan_gt, "gt/walk-9.tum: ground truth of a recording that is missing"),
        (break_map, "map/images.txt:1: expected"),
        (
            map_of_missing_images,
            "map: 1 of 2 images are not in recordings/: walk-1/images/frame-77.jpg",
        ),
    ],
)
def test_every_problem_is_named_with_file_and_line(damage, expected, scene):
    damage(scene)
    assert any(error.startswith(expected) for error in errors(scene)), errors(scene)


def test_all_problems_are_reported_at_once(scene):
    for damage in (remove_image, break_imu, break_gt, lose_recording):
        damage(scene)
    assert len(errors(scene)) == 4


def test_a_torn_end_is_worth_a_note(scene):
    path = scene.folder / WALK / "frames.csv"
    path.write_bytes(path.read_bytes()[:-4])
    scene.gt_path("walk-1").unlink()
    assert errors(scene) == []
    assert notes(scene) == [
        f"{WALK}/frames.csv:6: the last line is cut off and is passed over: was writing "
        "interrupted?",
        f"{WALK}/images: 1 image belongs to no frame: frame-4.jpg",
    ]


def test_frames_without_image_are_worth_a_note(scene):
    edit(scene.folder / WALK / "frames.csv", "frame-2.jpg", "")
    (scene.folder / WALK / "images/frame-2.jpg").unlink()
    assert errors(scene) == []
    assert notes(scene) == [f"{WALK}/frames.csv: 1 frame has no image"]


def write_lost(scene, id_, tracker):
    with RecordingWriter(scene.recording_folder(id_), RecordingInfo(tracker=tracker)) as writer:
        for k in range(3):
            writer.add_frame(k, f"{k}.jpg", jpeg(), Tracking.LOST, None)


def test_tracking_lost_throughout(scene):
    write_lost(scene, "lost", "ARKit")
    write_lost(scene, "untracked", "")
    scene.with_recording("lost", "train").with_recording("untracked", "train").save()
    expected = "recordings/lost/frames.csv: tracking was lost throughout: no frame has a pose"
    assert errors(scene) == [expected]


def test_no_images_at_all(scene):
    write_recording(scene.recording_folder("blind"), 3)
    path = scene.folder / "recordings/blind/frames.csv"
    for k in range(3):
        edit(path, f"frame-{k}.jpg", "")
    assert "recordings/blind/frames.csv: expected images, but no frame has one" in errors(scene)
    edit(
        scene.folder / "recordings/blind/recording.json",
        '"has_images": true',
        '"has_images": false',
    )
    assert errors(scene) == []


def test_a_diverging_tracker_in_a_split(scene):
    write_recording(scene.recording_folder("away"), 40)
    path = scene.folder / "recordings/away/frames.csv"
    lines = path.read_text().splitlines()
    fast = lines[:1]
    for k, line in enumerate(lines[1:]):
        fields = line.split(",")
        fields[3] = str(15.0 * k)
        fast.append(",".join(fields))
    path.write_text("\n".join(fast) + "\n")
    assert errors(scene) == []  # in no split
    Scene.open(scene.folder).with_recording("away", "train").save()
    assert errors(scene) == [
        "recordings/away/frames.csv: the tracker is diverging, and 'away' is in a split: exclude "
        "it in scene.toml"
    ]


def test_damage_within_an_image_shows_when_decoding(scene):
    path = scene.folder / WALK / "images/frame-2.jpg"
    content = bytearray(path.read_bytes())
    at = content.index(b"\xff\xda")
    content[at : at + 12] = b"\xff\xda\x00\x0c" + b"\x09" * 8
    path.write_bytes(content)
    assert errors(scene) == []
    (error,) = errors(scene, decode=True)
    assert error.startswith(f"{WALK}/frames.csv:4: images/frame-2.jpg: cannot be decoded")


def test_what_an_interrupted_import_left(scene):
    (scene.folder / "recordings/.walk-3.partial").mkdir()
    assert notes(scene) == [
        "recordings/.walk-3.partial: left by an import that was interrupted; it may be deleted"
    ]


def test_recordings_in_no_split(scene):
    write_recording(scene.recording_folder("spare"), 3)
    write_recording(scene.recording_folder("bad"), 3)
    scene.with_excluded("bad", "rain").save()
    assert notes(scene) == [
        "recordings/bad: excluded: rain", "recordings/spare: it is in no split",
    ]  # fmt: skip


def test_an_empty_scene(tmp_path):
    scene = Scene.create(tmp_path / "s", "s", is_outdoor=True)
    assert errors(scene) == [
        "recordings: expected recordings, found none",
        "scene.toml: the split train is empty: list recordings in splits.train",
        "scene.toml: the split test is empty: list recordings in splits.test",
    ]


def test_no_scene(tmp_path):
    with pytest.raises(FileMissingError, match="expected a scene's folder"):
        check_scene(tmp_path / "none")
