"""Faces in a scene's pictures: found however the phone was held, blurred for good, counted."""

import numpy as np
import pytest
from PIL import Image

from vioapr.errors import FormatError, MissingExtraError
from vioapr.files import published
from vioapr.files.images import encode_image, read_rgb
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.write import _refuse_others
from vioapr.scene import faces as module
from vioapr.scene.anonymize import (
    ANONYMIZED_FILE,
    Anonymized,
    anonymize_recording,
    count_images,
    find_faces,
    find_turns,
)
from vioapr.scene.check import check_scene
from vioapr.scene.faces import (
    Face,
    FaceDetector,
    blur_faces,
    decode,
    find_network,
    pick_apart,
)
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import CACHE_FOLDER, Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo

LEVEL_XYZW = np.array([1.0, 0.0, 0.0, 0.0])
"""vio_from_cam of a level camera in a world with y up."""


class RedDetector:
    """Takes the red box for a face if it is upright: higher than wide."""

    def __init__(self):
        self.seen = 0

    def find(self, pixels):
        self.seen += 1
        rows, columns = np.nonzero((pixels[..., 0] > 180) & (pixels[..., 1] < 100))
        if not len(rows):
            return []
        face = Face(columns.min(), rows.min(), columns.max() + 1.0, rows.max() + 1.0)
        return [face] if face.bottom - face.top > face.right - face.left else []


def picture(has_face=True, quarter_turns=0):
    """An upright picture of 80x60 with a red box of 12x20, stored turned clockwise."""
    rng = np.random.default_rng(1)
    pixels = rng.integers(90, 110, (60, 80, 3)).astype(np.uint8)
    if has_face:
        pixels[10:30, 50:62] = (240, 20, 20)
        pixels[14:18, 52:55] = 0  # an eye
    return np.ascontiguousarray(np.rot90(pixels, -quarter_turns))


@pytest.fixture
def scene(tmp_path):
    """Frames with and without a face, one held sideways, one lost; and an image of no frame."""
    scene = Scene.create(tmp_path / "scene", "Place", is_outdoor=True)
    sideways = quaternion.multiply(
        LEVEL_XYZW, quaternion.from_rotvec(np.array([0.0, 0.0, -np.pi / 2]))
    )
    frames = [
        (picture(), LEVEL_XYZW), (picture(has_face=False), LEVEL_XYZW),
        (picture(quarter_turns=1), sideways), (picture(quarter_turns=2), None),
    ]  # fmt: skip
    with RecordingWriter(scene.recording_folder("walk"), RecordingInfo(tracker="ARKit")) as writer:
        for row, (pixels, quat) in enumerate(frames):
            pose = None if quat is None else Rigid3(np.zeros(3), quat)
            state = Tracking.LOST if quat is None else Tracking.NORMAL
            writer.add_frame(float(row), f"{row}.png", pixels, state, pose, Intrinsics())
    scene.with_recording("walk", "train").save()
    orphan = scene.recording_folder("walk") / "images" / "9.jpg"
    orphan.write_bytes(encode_image("9.jpg", picture(quarter_turns=3)))
    return Scene.open(scene.folder)


def images_of(scene):
    folder = scene.recording_folder("walk") / "images"
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def has_eye(pixels):
    """Whether the black of the eye is there, which averages take away."""
    return bool((pixels < 15).all(axis=2).any())


def test_faces_are_blurred_however_the_phone_was_held(scene):
    before, ticks = images_of(scene), []
    found = anonymize_recording(scene, "walk", RedDetector(), tick=lambda: ticks.append(1))
    assert found == Anonymized(images=5, with_faces=4, faces=4)
    assert len(ticks) == count_images(scene, "walk") == 5
    after = images_of(scene)
    assert [name for name in after if after[name] == before[name]] == ["1.png"]
    for name in after:
        pixels = read_rgb(scene.recording_folder("walk") / "images" / name)
        assert pixels.shape == read_rgb_bytes(before[name]).shape
        assert not has_eye(pixels)
    assert not (scene.folder / "originals").exists()


def read_rgb_bytes(content):
    import io

    return np.asarray(Image.open(io.BytesIO(content)))


def test_what_is_done_is_not_done_again(scene):
    first, again, other = RedDetector(), RedDetector(), RedDetector()
    whole = anonymize_recording(scene, "walk", first)
    after = images_of(scene)
    assert anonymize_recording(scene, "walk", again) == whole
    assert again.seen == 0
    assert images_of(scene) == after
    (scene.recording_folder("walk") / "images" / "1.png").write_bytes(
        encode_image("1.png", picture())
    )
    assert anonymize_recording(scene, "walk", other).faces == 5
    assert other.seen == 1


def test_a_run_that_was_stopped_goes_on(scene):
    class Stopping(RedDetector):
        def find(self, pixels):
            if self.seen == 2:
                raise KeyboardInterrupt
            return super().find(pixels)

    with pytest.raises(KeyboardInterrupt):
        anonymize_recording(scene, "walk", Stopping())
    notes = scene.recording_folder("walk") / ANONYMIZED_FILE
    assert len(notes.read_text().splitlines()) == 3
    with notes.open("a") as file:
        file.write("2.png,12")  # cut off
    assert anonymize_recording(scene, "walk", RedDetector()).faces == 4


def test_originals_are_kept_if_asked_and_the_first_copy_stays(scene):
    before = images_of(scene)
    anonymize_recording(scene, "walk", RedDetector(), keep_originals=True)
    kept = {path.name: path.read_bytes() for path in (scene.folder / "originals/walk").iterdir()}
    assert kept == {name: before[name] for name in ("0.png", "2.png", "3.png", "9.jpg")}
    (scene.recording_folder("walk") / ANONYMIZED_FILE).unlink()
    anonymize_recording(scene, "walk", RedDetector(), keep_originals=True)
    assert (scene.folder / "originals/walk/0.png").read_bytes() == before["0.png"]


def test_decoded_images_of_trainings_go_too(scene):
    cache = scene.folder / CACHE_FOLDER / "images-256" / "walk.npy"
    cache.parent.mkdir(parents=True)
    cache.write_bytes(b"faces")
    anonymize_recording(scene, "walk", RedDetector())
    assert not cache.exists()


def test_a_linked_source_keeps_its_faces(scene, tmp_path):
    image = scene.recording_folder("walk") / "images" / "0.png"
    source = tmp_path / "source.png"
    source.hardlink_to(image)
    anonymize_recording(scene, "walk", RedDetector())
    assert has_eye(read_rgb(source))
    assert not has_eye(read_rgb(image))


def test_the_scene_is_sound_afterwards_and_may_be_imported_again(scene):
    (scene.recording_folder("walk") / "images" / "9.jpg").unlink()
    anonymize_recording(scene, "walk", RedDetector())
    problems = [problem.text for problem in check_scene(scene.folder).errors]
    assert not [text for text in problems if "split" not in text]
    _refuse_others(scene, "walk")


def test_which_way_images_are_turned_is_the_trackers_word(scene):
    turns = find_turns(scene.recording("walk"))
    assert turns == {"0.png": [0], "1.png": [0], "2.png": [1]}


@pytest.mark.parametrize(
    ("tilt_deg", "roll_deg", "turns"),
    [(0, 45, [0, 3]), (80, 0, [0, 1, 2, 3]), (30, -100, [1])],
)
def test_a_camera_between_two_ways_is_looked_at_both_ways(scene, tilt_deg, roll_deg, turns):
    tilt, roll = np.radians(tilt_deg), np.radians(roll_deg)
    turn = quaternion.multiply(
        quaternion.from_rotvec(np.array([tilt, 0.0, 0.0])),
        quaternion.from_rotvec(np.array([0.0, 0.0, roll])),
    )
    pose = Rigid3(np.zeros(3), quaternion.multiply(LEVEL_XYZW, turn))
    with RecordingWriter(scene.recording_folder("other"), RecordingInfo(tracker="x")) as writer:
        writer.add_frame(0.0, "a.png", picture(), Tracking.NORMAL, pose, Intrinsics())
    assert find_turns(scene.recording("other")) == {"a.png": turns}


def test_one_face_seen_in_two_turns_is_one_face():
    class Everywhere:
        def find(self, pixels):
            height, width = pixels.shape[:2]
            middle = np.array([width, height]) / 2
            return [Face(*(middle - 10), *(middle + 10))]

    assert len(find_faces(picture(), Everywhere(), range(4))) == 1


def test_answers_become_boxes():
    heat = np.zeros((10, 12), np.float32)
    heat[3, 5] = 0.9
    scale, offset = np.zeros((2, 10, 12), np.float32), np.zeros((2, 10, 12), np.float32)
    scale[:, 3, 5] = np.log(6), np.log(4)  # 24 pixels high, 16 wide
    offset[:, 3, 5] = 0.25, -0.25
    boxes, scores = decode(heat, scale, offset)
    assert scores == pytest.approx([0.9])
    assert boxes[0] == pytest.approx([21 - 8, 15 - 12, 21 + 8, 15 + 12])


def test_boxes_of_one_face_are_one():
    boxes = np.array([[0.0, 0, 10, 10], [1, 1, 11, 11], [30, 0, 40, 10]])
    assert pick_apart(boxes, np.array([0.5, 0.9, 0.3])) == [1, 2]
    assert pick_apart(np.zeros((0, 4)), np.zeros(0)) == []


def test_blur_keeps_what_is_around_a_face_and_takes_boxes_at_the_edge():
    pixels = np.random.default_rng(0).integers(0, 255, (60, 80, 3)).astype(np.uint8)
    blurred = blur_faces(pixels, [Face(30, 20, 50, 45), Face(-20, -20, 5, 5), Face(90, 70, 99, 80)])
    assert (blurred[58:, :20] == pixels[58:, :20]).all()
    inside = blurred[26:39, 35:45].astype(float)
    assert np.abs(np.diff(inside, axis=1)).max() < 25  # noise of 255 is gone
    assert (blurred[:3, :3] != pixels[:3, :3]).any()


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(published, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"vioapr\[anonymize\]"):
        find_network()


def test_another_network_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "_NETWORK", module._NETWORK._replace(sha256="0" * 64))
    monkeypatch.setattr(
        published, "find_spec",
        lambda name: type("Spec", (), {"submodule_search_locations": [str(tmp_path)]}),
    )  # fmt: skip
    with pytest.raises(FormatError, match="expected the network of SHA-256 0000"):
        find_network()


@pytest.mark.parametrize("scale", [1.0, 0.25])
def test_a_real_face_is_found_and_not_found_again(scale):
    """Rear Admiral Grace Hopper, whose portrait comes with Matplotlib."""
    cbook = pytest.importorskip("matplotlib.cbook")
    try:
        detector = FaceDetector()
    except MissingExtraError as error:
        pytest.skip(str(error))
    with cbook.get_sample_data("grace_hopper.jpg") as file, Image.open(file) as portrait:
        size = round(portrait.width * scale), round(portrait.height * scale)
        pixels = np.asarray(portrait.convert("RGB").resize(size))
    (face,) = detector.find(pixels)
    middle = np.array([face.left + face.right, face.top + face.bottom]) / 2 / scale
    assert middle == pytest.approx([265, 225], abs=25)
    assert 140 < (face.right - face.left) / scale < 230
    assert detector.find(blur_faces(pixels, [face])) == []
