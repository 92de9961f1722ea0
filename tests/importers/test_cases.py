"""Captures as people have them, with their right answers: the folders of shared/cases."""

from dataclasses import dataclass

import numpy as np
import pytest
from tests.cases_of import case_folder

from vioapr.errors import FormatError
from vioapr.importers.base import ImportOptions
from vioapr.importers.registry import get_importer, import_source
from vioapr.scene.check import check_scene
from vioapr.scene.recording import Recording
from vioapr.scene.scene import Scene
from vioapr.work.progress import silent


@dataclass
class Found:
    recording: Recording
    scene: Scene
    notes: str
    warnings: str


def import_one(name, source, out, **options) -> Found:
    found = list(
        import_source(
            get_importer(name), source, out, ImportOptions(**options), place="indoor",
            progress=silent,
        )
    )  # fmt: skip
    (one,) = found
    scene = Scene.open(out)
    assert not check_scene(out).errors, "what import writes passes the check"
    return Found(
        scene.recording(one.folder.name),
        scene,
        "\n".join(f.text for f in one.findings if not f.is_warning),
        "\n".join(f.text for f in one.findings if f.is_warning),
    )


def test_transforms_with_timestamps(tmp_path):
    found = import_one("nerfstudio", case_folder("11-transforms-with-timestamps"), tmp_path / "s")
    frames = found.recording.frames
    assert found.recording.info.clock == "device"
    assert frames.timestamp_s[0] == 5000
    np.testing.assert_allclose(np.diff(frames.timestamp_s), 0.1, atol=1e-6)
    positions = frames.vio_from_cam.translation_m
    ways_of_1_s = np.linalg.norm(positions[10:] - positions[:-10], axis=1)
    assert np.median(ways_of_1_s) == pytest.approx(1.1, abs=0.05)
    assert not found.warnings


def test_transforms_of_colmap2nerf_are_not_metric(tmp_path):
    source = case_folder("12-colmap2nerf-is-not-metric")
    found = import_one("nerfstudio", source, tmp_path / "s")
    assert not found.recording.info.is_metric
    assert "the poses are COLMAP's, not metric (sharpness, aabb_scale" in found.warnings


@pytest.mark.parametrize("folder", ["backslash", "other_root"])
def test_transforms_with_paths_of_another_machine(folder, tmp_path):
    source = case_folder("13-transforms-paths") / folder
    found = import_one("nerfstudio", source, tmp_path / "s")
    frames = found.recording.frames
    assert (len(frames), int(frames.has_image.sum())) == (20, 20)
    is_elsewhere = folder == "other_root"
    assert ("./data_c/images/0000.jpg is images/0000.jpg" in found.notes) == is_elsewhere


def test_looking_down_the_accelerometer_decides(tmp_path):
    source = case_folder("14-looking-down-accelerometer-agrees")
    found = import_one("stray", source, tmp_path / "s")
    assert found.recording.info.is_gravity_aligned
    assert "+y is up by the accelerometer; the camera's up is 81 deg off" in found.notes
    assert not found.warnings


def test_record3d_is_never_gravity_aligned(tmp_path):
    source = case_folder("15-record3d-started-looking-down")
    found = import_one("record3d", source, tmp_path / "s")
    assert not found.recording.info.is_gravity_aligned
    assert "the world is the first camera's, whose tilt nobody knows" in found.notes


def test_images_of_half_the_size(tmp_path):
    found = import_one("nerfstudio", case_folder("16-downscaled-images"), tmp_path / "s")
    cameras = np.array(found.recording.frames.intrinsics)
    np.testing.assert_array_equal(cameras.T, [[48, 36, 40, 40, 24, 18]] * 20)
    assert "of images of 96x72, and the images are 48x36: rescaled" in found.notes


def test_images_are_counted_that_are_there(tmp_path):
    source = case_folder("18-count-of-images")
    found = import_one("nerfstudio", source, tmp_path / "s")
    assert "60 frames: 50 with image, 60 with tracker's pose" in found.recording.info.notes
    assert f"{source}/images/0000.jpg: no file of this name" in found.warnings


def test_3d_scanner_app(tmp_path):
    found = import_one("3dscannerapp", case_folder("20-3d-scanner-app"), tmp_path / "s")
    frames = found.recording.frames
    assert (len(frames), int(frames.has_image.sum())) == (30, 10)
    assert frames.timestamp_s[0] == 9000
    np.testing.assert_allclose(np.diff(frames.timestamp_s), 0.1, atol=1e-6)
    assert frames.vio_from_cam.translation_m[0].tolist() == [0, 1.5, -0.11]
    np.testing.assert_allclose(np.array(frames.intrinsics)[:, 0], [96, 72, 72.7, 72.7, 48.6, 35.7])
    info = found.recording.info
    assert (info.is_metric, info.is_gravity_aligned, info.tracker) == (True, True, "ARKit")


def test_cambridge_with_one_absurd_row(tmp_path):
    source = case_folder("06-cambridge-one-broken-row")
    found = list(
        import_source(
            get_importer("cambridge"), source, tmp_path / "s", ImportOptions(), progress=silent
        )
    )
    scene = Scene.open(tmp_path / "s")
    recordings = [scene.recording(one.folder.name) for one in found]
    frames = sum(len(recording.frames) for recording in recordings)
    labelled = sum(len(scene.gt(one.folder.name)) for one in found)
    assert (frames, labelled) == (40, 39)
    assert all(recording.frames.has_image.all() for recording in recordings)
    (warning,) = [f.text for one in found for f in one.findings if f.is_warning]
    assert (
        warning == "dataset_train.txt:24: position is 3.1e9 m away, left out (seq1/frame00021.png)"
    )
    assert not check_scene(tmp_path / "s").errors


def test_cambridge_with_one_absurd_row_is_refused_under_strict(tmp_path):
    source = case_folder("06-cambridge-one-broken-row")
    with pytest.raises(FormatError, match=r"dataset_train.txt:24: expected positions within"):
        get_importer("cambridge").read(source, ImportOptions(strict=True))
