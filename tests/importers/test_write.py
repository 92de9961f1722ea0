"""Imported walks are written whole or not at all; broken images cost their frames the image."""

import errno
import os

import numpy as np
import pytest
from tests.importers.sources import COUNT, make_images, make_stray, read_walks, texts
from tests.scene.scenes import jpeg, make_scene

from vioapr.errors import AlreadyExistsError, DiskFullError, FormatError, ParameterError
from vioapr.importers.base import ImportedScene, Walk, flat_names, id_of
from vioapr.importers.diagnostics import diagnose
from vioapr.importers.images import IMPORTER as IMAGES
from vioapr.importers.stray import IMPORTER as STRAY
from vioapr.importers.write import WriteSettings, open_or_create, write_recording
from vioapr.scene.check import check_scene
from vioapr.scene.frames import Intrinsics
from vioapr.scene.scene import Scene
from vioapr.schemas.scene import World


@pytest.fixture
def scene(tmp_path):
    return make_scene(tmp_path / "scene", 4)


def snapshot(scene):
    files = sorted(path for path in scene.folder.rglob("*") if path.is_file())
    return {str(path): path.read_bytes() for path in files}


def import_stray(scene, source, **options):
    (walk,) = read_walks(STRAY, source, **options)
    return walk, lambda: write_recording(scene, walk)


def test_a_walk_is_written_and_entered(scene, tmp_path):
    walk, write = import_stray(scene, make_stray(tmp_path / "scan"))
    again = Scene.open(write().folder)
    assert again.splits["train"] == ("walk-1", "scan")
    frames = again.recording("scan").frames
    assert len(frames) == COUNT
    np.testing.assert_array_equal(frames.vio_from_cam.quat_xyzw, walk.vio_from_cam.quat_xyzw)
    # The size is the images' own.
    assert (frames.intrinsics.width == 16).all()
    assert again.recording("scan").info.notes == tuple(f.text for f in walk.findings)
    assert not check_scene(scene.folder).errors


def test_ground_truth_is_written(scene, tmp_path):
    source = make_images(tmp_path / "s")
    (walk,) = read_walks(IMAGES, source / "images", gt=source / "gt.tum")
    scene = write_recording(scene, walk)
    np.testing.assert_array_equal(scene.gt("images").position_m, walk.gt.position_m)


def test_an_existing_recording_is_never_overwritten(scene, tmp_path):
    _, write = import_stray(scene, make_stray(tmp_path / "scan"), id="walk-1")
    before = snapshot(scene)
    with pytest.raises(AlreadyExistsError, match=r"walk-1: a recording of this id exists"):
        write()
    assert snapshot(scene) == before


def test_broken_images_cost_their_frames_the_image(scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    (source / "rgb/000002.jpg").write_bytes(jpeg()[:-3])
    (source / "rgb/000005.jpg").write_bytes(b"")
    walk, write = import_stray(scene, source)
    (source / "rgb/000007.jpg").unlink()
    frames = write().recording("scan").frames
    assert len(frames) == COUNT
    assert np.flatnonzero(~frames.has_image).tolist() == [2, 5, 7]
    assert frames.has_pose.all()
    warning = texts(walk, warnings=True)
    assert "images: 3 are missing or broken" in warning
    assert "000002.jpg: truncated" in warning
    assert "000007.jpg: no file of this name" in warning


def test_no_image_can_be_used(scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    for path in (source / "rgb").iterdir():
        path.write_bytes(b"x")
    _, write = import_stray(scene, source)
    before = snapshot(scene)
    with pytest.raises(FormatError, match="none of 20 images can be used: 000000.jpg: expected"):
        write()
    assert snapshot(scene) == before


def test_intrinsics_of_another_size_are_rescaled(scene, tmp_path):
    walk, write = import_stray(scene, make_stray(tmp_path / "scan"))
    walk.intrinsics = Intrinsics(640, 480, 800.0, 840.0, 310.0, 250.0)
    frames = write().recording("scan").frames
    # Pixels count from the edge of the first one, so everything shrinks alike.
    np.testing.assert_allclose(np.array(frames.intrinsics)[:, 0], [16, 12, 20, 21, 7.75, 6.25])
    note = texts(walk, warnings=False)
    assert "they are of images of 640x480, and the images are 16x12: rescaled" in note
    assert not check_scene(scene.folder).errors


def test_intrinsics_of_another_shape_are_left_out(scene, tmp_path):
    walk, write = import_stray(scene, make_stray(tmp_path / "scan"))
    walk.intrinsics = Intrinsics(640, 360, 800.0, 840.0, 310.0, 170.0)
    frames = write().recording("scan").frames
    assert np.isnan(frames.intrinsics.fx).all()
    assert (frames.intrinsics.height == 12).all()
    warning = texts(walk, warnings=True)
    assert "of 640x360, and the images are 16x12: another shape, and what was cut off" in warning
    assert "give `focal_px`" in warning
    assert not check_scene(scene.folder).errors


def test_intrinsics_of_upright_images_are_not_those_of_lying_ones(scene, tmp_path):
    walk, write = import_stray(scene, make_stray(tmp_path / "scan"))
    walk.intrinsics = Intrinsics(480, 640, 800.0, 840.0, 240.0, 320.0)
    assert np.isnan(write().recording("scan").frames.intrinsics.fx).all()
    assert "which way it was turned is not known" in texts(walk, warnings=True)


def test_intrinsics_without_size_are_of_the_size_that_their_middle_shows(scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    (source / "camera_matrix.csv").write_text("80, 0, 32.5\n0, 84, 23.8\n0, 0, 1")
    walk, write = import_stray(scene, source)
    frames = write().recording("scan").frames
    np.testing.assert_allclose(np.array(frames.intrinsics)[:, 0], [16, 12, 20, 21, 8.125, 5.95])
    assert "of 64x48, and the images are 16x12: rescaled" in texts(walk, warnings=False)


@pytest.mark.parametrize(
    ("middle", "fx", "found"),
    [
        ((10.0, 7.5), 16.0, "20x15, and the images are 16x12: rescaled"),
        ((12.2, 8.9), 13.333, "24x18, and the images are 16x12: rescaled"),
        ((4.05, 3.0), 40.0, "8x6, and the images are 16x12: rescaled"),
        ((8.6, 6.4), 20.0, ""),
        ((6.0, 8.0), np.nan, "12x16, and the images are 16x12: the one is upright"),
    ],
)
def test_sizes_that_a_middle_shows(middle, fx, found, scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    (source / "camera_matrix.csv").write_text(f"20, 0, {middle[0]}\n0, 20, {middle[1]}\n0, 0, 1")
    walk, write = import_stray(scene, source)
    frames = write().recording("scan").frames
    np.testing.assert_allclose(frames.intrinsics.fx[0], fx, atol=1e-3)
    said = texts(walk, warnings=False) + texts(walk, warnings=True)
    assert found in said
    assert ("and the images are" in said) == bool(found)


def test_intrinsics_whose_middle_fits_no_image_are_left_out(scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    (source / "camera_matrix.csv").write_text("80, 0, 32\n0, 84, 6\n0, 0, 1")
    walk, write = import_stray(scene, source)
    assert np.isnan(write().recording("scan").frames.intrinsics.fx).all()
    assert "their middle is that of images of 64x12" in texts(walk, warnings=True)


def test_a_focal_length_that_is_given_counts(scene, tmp_path):
    (walk,) = read_walks(STRAY, make_stray(tmp_path / "scan"))
    frames = write_recording(scene, walk, WriteSettings(focal_px=33)).recording("scan").frames
    np.testing.assert_array_equal(np.array(frames.intrinsics)[:, 0], [16, 12, 33, 33, 8, 6])
    assert "focal length 33 pixels, as you say" in texts(walk, warnings=False)


def test_strict_refuses_what_is_imported_with_a_warning(scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    (source / "rgb/000002.jpg").write_bytes(jpeg()[:-3])
    (walk,) = read_walks(STRAY, source)
    before = snapshot(scene)
    with pytest.raises(FormatError, match=r"refused, as `strict` says: images: 1 are missing"):
        write_recording(scene, walk, WriteSettings(strict=True))
    assert snapshot(scene) == before


def test_frames_are_counted_as_their_images_are(scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    (source / "rgb/000002.jpg").write_bytes(b"")
    _, write = import_stray(scene, source)
    notes = write().recording("scan").info.notes
    assert notes[0] == "20 frames: 19 with image, 20 with tracker's pose"


def test_intrinsics_that_cannot_be_are_left_out(scene, tmp_path):
    source = make_stray(tmp_path / "scan")
    (source / "camera_matrix.csv").write_text("0, 0, 8\n0, 21, 6\n0, 0, 1")
    walk, write = import_stray(scene, source)
    frames = write().recording("scan").frames
    assert np.isnan(frames.intrinsics.fx).all()
    assert (frames.intrinsics.width == 16).all()
    assert "intrinsics: those of 20 frames are left out" in texts(walk, warnings=True)


@pytest.mark.parametrize(
    "camera",
    [
        (np.inf, 12, 20, 21, 8, 6),
        (16, 1e300, 20, 21, 8, 6),
        (-16, 12, 20, 21, 8, 6),
        (16.5, 12, 20, 21, 8, 6),
        (16, 12, np.inf, 21, 8, 6),
        (16, 12, 20, 1e308, 8, 6),
        (np.nan, np.nan, 20, 21, 1e308, 6),
        (np.nan, np.nan, 20, 21, -np.inf, 6),
        (0, 0, 0, 0, 0, 0),
    ],
)
def test_numbers_that_no_camera_has(camera, scene, tmp_path):
    walk, write = import_stray(scene, make_stray(tmp_path / "scan"))
    walk.intrinsics = Intrinsics(*(np.full(COUNT, float(value)) for value in camera))
    frames = write().recording("scan").frames
    assert (frames.intrinsics.width == 16).all()
    assert "intrinsics: those of 20 frames are left out" in texts(walk, warnings=True)
    assert not check_scene(scene.folder).errors


def test_a_diverging_tracker_is_left_out_of_the_splits(scene, tmp_path):
    (walk,) = read_walks(STRAY, make_stray(tmp_path / "scan", 200))
    walk.vio_from_cam.translation_m[:] *= 30
    walk.findings.clear()
    diagnose(walk)
    assert "the tracker is diverging" in texts(walk, warnings=True)
    scene = write_recording(scene, walk)
    assert scene.splits["train"] == ("walk-1",)
    assert scene.excluded == {"scan": "the tracker is diverging"}


@pytest.mark.parametrize("bytes_left", [0, 300, 5000])
def test_a_full_disk_leaves_the_scene_as_it_was(bytes_left, scene, tmp_path, monkeypatch):
    _, write = import_stray(scene, make_stray(tmp_path / "scan"))
    before = snapshot(scene)
    real, left = os.write, [bytes_left]

    def full(file, content):
        if left[0] <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = real(file, bytes(content)[: left[0]])
        left[0] -= taken
        return taken

    monkeypatch.setattr("vioapr.files.append_table.os.write", full)
    with pytest.raises(DiskFullError, match="cannot be written: No space left on device"):
        write()
    monkeypatch.undo()
    assert snapshot(scene) == before
    assert scene.recording_ids == ["walk-1", "walk-2"]


def test_a_full_disk_at_the_very_end(scene, tmp_path, monkeypatch):
    source = make_images(tmp_path / "s")
    (walk,) = read_walks(IMAGES, source / "images", gt=source / "gt.tum")
    before = snapshot(scene)

    def fail(path, text):
        raise FormatError(path, "cannot be written: No space left on device")

    monkeypatch.setattr("vioapr.scene.scene.write_text", fail)
    with pytest.raises(FormatError, match="No space left on device"):
        write_recording(scene, walk)
    assert snapshot(scene) == before


def test_an_interrupt_leaves_the_scene_as_it_was(scene, tmp_path):
    walk, write = import_stray(scene, make_stray(tmp_path / "scan"))
    images = list(walk.images)

    def interrupted():
        yield from images[:5]
        raise KeyboardInterrupt

    walk.images = interrupted()
    before = snapshot(scene)
    with pytest.raises(KeyboardInterrupt):
        write()
    assert snapshot(scene) == before


def test_existing_ground_truth_is_never_overwritten(scene, tmp_path):
    scene.write_gt("images", scene.gt("walk-1"))
    source = make_images(tmp_path / "s")
    (walk,) = read_walks(IMAGES, source / "images", gt=source / "gt.tum")
    before = snapshot(scene)
    with pytest.raises(AlreadyExistsError, match=r"images.tum: ground truth of this id exists"):
        write_recording(scene, walk)
    assert snapshot(scene) == before


def test_what_was_left_by_a_kill_is_replaced(scene, tmp_path):
    left = scene.folder / "recordings/.scan.0123abcd.partial"
    left.mkdir()
    (left / "frames.csv").write_text("torn")
    _, write = import_stray(scene, make_stray(tmp_path / "scan"))
    assert len(write().recording("scan").frames) == COUNT
    assert not left.exists()
    assert sorted(p.name for p in left.parent.iterdir()) == ["scan", "walk-1", "walk-2"]


@pytest.mark.parametrize("at", ["write_gt", "save", "rename"])
def test_an_import_that_was_killed_at_the_end_can_be_run_again(at, scene, tmp_path, monkeypatch):
    """A kill leaves ground truth, an entry in scene.toml and a partial folder, or less."""
    source = make_images(tmp_path / "s")

    def import_again():
        (walk,) = read_walks(IMAGES, source / "images", gt=source / "gt.tum")
        return write_recording(Scene.open(scene.folder), walk)

    class Killed(BaseException):
        pass

    def killed(*_args):
        raise Killed

    with monkeypatch.context() as patch:
        if at == "rename":
            patch.setattr("pathlib.Path.rename", killed)
        else:
            patch.setattr(Scene, at, killed)
        # Nothing is put back, as after kill -9.
        for name in ("remove_gt_file", "write_bytes", "shutil.rmtree"):
            patch.setattr(f"vioapr.importers.write.{name}", lambda *_args, **_options: None)
        with pytest.raises(Killed):
            import_again()
    again = import_again()
    assert again.splits["train"] == ("walk-1", "images")
    assert len(again.gt("images")) == COUNT
    assert not check_scene(scene.folder).errors
    assert sorted(p.name for p in again.recording_folder("images").parent.iterdir()) == [
        "images", "walk-1", "walk-2",
    ]  # fmt: skip


def test_an_interrupt_at_the_very_end_leaves_the_scene_as_it_was(scene, tmp_path, monkeypatch):
    source = make_images(tmp_path / "s")
    (walk,) = read_walks(IMAGES, source / "images", gt=source / "gt.tum")
    before = snapshot(scene)

    def interrupt(*_args):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.rename", interrupt)
        with pytest.raises(KeyboardInterrupt):
            write_recording(scene, walk)
    assert snapshot(scene) == before


def imported(place=None):
    return ImportedScene("Church", place, World(), 1, lambda: iter(()))


def test_a_new_scene_needs_a_place(tmp_path):
    with pytest.raises(ParameterError, match="give `place`: outdoor or indoor"):
        open_or_create(tmp_path / "new", imported(), None)
    assert not (tmp_path / "new").exists()
    assert open_or_create(tmp_path / "new", imported(), "indoor").is_outdoor is False
    assert open_or_create(tmp_path / "other", imported("outdoor"), None).name == "Church"


def test_a_folder_of_other_files_is_no_scene(tmp_path):
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(FormatError, match="expected a scene or a new folder, found other files"):
        open_or_create(tmp_path, imported("outdoor"), None)
    with pytest.raises(FormatError, match="expected a scene or a new folder, found a file"):
        open_or_create(tmp_path / "a.txt", imported("outdoor"), None)


def test_frames_without_image_and_pose_stay_for_their_ground_truth(scene, tmp_path):
    source = make_images(tmp_path / "s")
    (source / "images/frame-0003.jpg").write_bytes(b"")
    (walk,) = read_walks(IMAGES, source / "images", gt=source / "gt.tum")
    scene = write_recording(scene, walk)
    frames = scene.recording("images").frames
    assert len(frames) == COUNT
    assert (frames.image[3], frames.has_pose[3]) == ("", False)
    assert not check_scene(scene.folder).errors


def test_tracking_lost_throughout_is_reported(tmp_path):
    (walk,) = read_walks(STRAY, make_stray(tmp_path / "scan"))
    lost = Walk(**{**vars(walk), "findings": [], "tracking": np.full(COUNT, 2, dtype=np.uint8)})
    diagnose(lost)
    assert "tracking was lost throughout: no frame has a pose" in texts(lost, warnings=True)


def test_names_for_one_folder():
    assert flat_names(["a/1.jpg", "a/2.jpg"]) == ["1.jpg", "2.jpg"]
    assert flat_names(["a/1.jpg", "b/1.jpg"]) == ["a_1.jpg", "b_1.jpg"]
    assert flat_names(['x/a, "b".jpg']) == ["a___b_.jpg"]


def test_ids():
    assert id_of("My Scan (2).r3d") == "My-Scan-2-.r3d"
    with pytest.raises(ParameterError, match="`id`"):
        id_of("///")
