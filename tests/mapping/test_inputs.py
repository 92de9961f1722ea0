import numpy as np
import pytest

from vioapr.errors import MappingError
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import collect_images
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo
from vioapr.simulation.rooms import ROOM_CAMERA

PICTURE = np.zeros((240, 320), dtype=np.uint8)
AT_ORIGIN = Rigid3(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))


@pytest.fixture
def scene(tmp_path):
    return Scene.create(tmp_path / "scene", "Scene", is_outdoor=True)


def record(scene, id_, split, frames=4, camera=ROOM_CAMERA, rate_hz=10.0, info=None, states=None):
    """A recording of grey pictures; returns the scene with it."""
    cameras = camera if isinstance(camera, list) else [camera] * frames
    with RecordingWriter(scene.recording_folder(id_), info or RecordingInfo()) as writer:
        for k in range(frames):
            state = Tracking.NORMAL if states is None else states[k]
            pose = None if state == Tracking.LOST else AT_ORIGIN
            writer.add_frame(k / rate_hz, f"{k}.png", PICTURE, state, pose, cameras[k])
    return scene.with_recording(id_, split)


def test_worlds_of_recordings_are_told_apart(scene):
    states = [Tracking.NORMAL, Tracking.LOST, Tracking.RESET, Tracking.LIMITED]
    scene = record(record(scene, "b", "train", states=states), "a", "test")
    images = collect_images(scene)
    assert images.ids == ("b", "a")
    assert images.names[:2] == ("b/images/0.png", "b/images/1.png")
    assert images.tracking_world.tolist() == [0, 0, 1, 1, 2, 2, 2, 2]
    assert images.has_vio.tolist() == [True, False, True, True] + [True] * 4
    assert images.is_tracked.tolist() == [True, False, True, False] + [True] * 4
    assert images.rows_of("a").tolist() == [4, 5, 6, 7]


def test_recordings_are_thinned(scene):
    scene = record(scene, "a", "train", frames=31, rate_hz=30.0)
    assert collect_images(scene, 3.0).frame_row.tolist() == [0, 9, 18, 27]
    assert len(collect_images(scene)) == 31
    at_the_rate = record(scene, "b", "train", frames=5, rate_hz=3.0)
    assert len(collect_images(at_the_rate, 3.0).rows_of("b")) == 5


def test_a_tracker_begins_anew_between_the_images_that_are_kept(scene):
    states = [Tracking.NORMAL] * 4 + [Tracking.RESET] + [Tracking.NORMAL] * 4
    images = collect_images(record(scene, "a", "train", frames=9, states=states), 3.0)
    assert images.frame_row.tolist() == [0, 3, 6]
    assert images.tracking_world.tolist() == [0, 0, 1]


def test_autofocus_is_one_camera_and_zoom_another(scene):
    def focal(f):
        return Intrinsics(320, 240, f, f, 160, 120)

    cameras = [focal(200.5), focal(201.0), focal(201.5), focal(300.0)]
    images = collect_images(record(scene, "a", "train", camera=cameras))
    assert images.camera.tolist() == [0, 0, 0, 1]
    assert images.cameras[0].fx == pytest.approx(201.0)
    assert images.cameras[1].fx == pytest.approx(300.0)


def test_intrinsics_of_another_size_are_scaled(scene):
    large = Intrinsics(640, 480, 440, 440, 320, 240)
    (camera,) = collect_images(record(scene, "a", "train", camera=large)).cameras
    assert camera == (320, 240, 220, 220, 160, 120)


def test_unknown_cameras_are_shared_known_ones_are_not(scene):
    scene = record(record(scene, "a", "train"), "b", "test")
    assert len(collect_images(scene).cameras) == 2
    scene = record(
        record(scene, "c", "train", camera=Intrinsics()), "d", "test", camera=Intrinsics()
    )
    images = collect_images(scene)
    assert len(images.cameras) == 3
    assert images.camera[images.rows_of("c")[0]] == images.camera[images.rows_of("d")[0]]


def test_the_fingerprint_is_of_all_that_counts(scene):
    scene = record(scene, "a", "train")
    before = collect_images(scene).fingerprint
    assert collect_images(scene).fingerprint == before
    path = scene.recording_folder("a") / "images" / "2.png"
    path.write_bytes(path.read_bytes() + b"")
    assert collect_images(scene).fingerprint != before


def test_poses_alone_cannot_be_mapped(scene):
    scene = record(scene, "a", "train", info=RecordingInfo(has_images=False))
    with pytest.raises(MappingError, match="no images, only poses"):
        collect_images(scene)
