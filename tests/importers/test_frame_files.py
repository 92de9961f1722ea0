"""3D Scanner App and Polycam: a JSON file a frame, some of them broken."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from tests.importers.sources import (
    COUNT,
    make_nerfstudio,
    read_walks,
    texts,
    walk,
    write_images,
)
from tests.scene.scenes import make_scene

from vioapr.errors import FileError, FormatError
from vioapr.formats import conventions
from vioapr.geometry import quaternion
from vioapr.importers.frame_files import POLYCAM, SCANNER_APP
from vioapr.importers.write import write_recording
from vioapr.scene.check import check_scene

MATRICES = conventions.world_from_arcam(walk().target_from_source).to_matrix()


def make_scanner_app(folder: Path) -> Path:
    """Every second frame has an image."""
    folder.mkdir(parents=True)
    for k, matrix in enumerate(MATRICES.tolist()):
        content = {
            "time": 900 + k / 10,
            "frame_index": k,
            "cameraPoseARFrame": np.ravel(matrix).tolist(),
            "intrinsics": [20, 0, 8, 0, 21, 6, 0, 0, 1],
        }
        (folder / f"frame_{k:05d}.json").write_text(json.dumps(content))
    write_images(folder, [f"frame_{k:05d}.jpg" for k in range(0, COUNT, 2)])
    (folder / "info.json").write_text('{"title": "desk"}')
    return folder


def make_polycam(folder: Path, cameras="cameras", images="images", unit=1e6) -> Path:
    root = folder / "keyframes"
    (root / cameras).mkdir(parents=True)
    for k, matrix in enumerate(MATRICES.tolist()):
        content = {f"t_{i}{j}": matrix[i][j] for i in range(3) for j in range(4)}
        content |= {"fx": 20, "fy": 21, "cx": 8, "cy": 6, "width": 16, "height": 12}
        content |= {
            "timestamp": int((900 + k / 2) * unit) if unit > 1 else 900 + k / 2,
            "blur_score": 80.0,
        }
        (root / cameras / f"{k}.json").write_text(json.dumps(content))
    write_images(root, [f"{images}/{k}.jpg" for k in range(COUNT)])
    return folder


def edit(path, **members):
    path.write_text(json.dumps(json.loads(path.read_text()) | members))


def read_one(importer, source, **options):
    (found,) = read_walks(importer, source, **options)
    return found


def test_scanner_app(tmp_path):
    found = read_one(SCANNER_APP, make_scanner_app(tmp_path / "scan"))
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)
    angles = quaternion.angle_between_deg(found.vio_from_cam.quat_xyzw, walk().quat_xyzw)
    assert angles.max() < 1e-5
    np.testing.assert_allclose(found.timestamp_s, 900 + np.arange(COUNT) / 10)
    assert found.image_names[:3] == ["frame_00000.jpg", "", "frame_00002.jpg"]
    assert "20 frames: 10 with image, 20 with tracker's pose" in texts(found, warnings=False)
    frames = write_recording(make_scene(tmp_path / "s", 3), found).recording("scan").frames
    assert np.array(frames.intrinsics)[:, 2].tolist() == [16, 12, 20, 21, 8, 6]
    assert not check_scene(tmp_path / "s").errors


@pytest.mark.parametrize(
    ("members", "problem", "frames", "poses"),
    [
        ({"cameraPoseARFrame": [1, 2]}, "cameraPoseARFrame", COUNT - 1, COUNT - 1),
        ({"cameraPoseARFrame": [0.0] * 16}, "not orthonormal", COUNT, COUNT - 1),
        ({"cameraPoseARFrame": [float("nan")] * 16}, None, COUNT, COUNT - 1),
        ({"time": 900.2}, "the time of another frame: left out", COUNT - 1, COUNT - 1),
        ({"time": None}, "got no time: left out", COUNT - 1, COUNT - 1),
        ({"intrinsics": "none"}, '"intrinsics"', COUNT - 1, COUNT - 1),
        ({"intrinsics": None}, None, COUNT, COUNT),
    ],
)
def test_a_broken_frame_costs_itself_alone(members, problem, frames, poses, tmp_path):
    source = make_scanner_app(tmp_path / "scan")
    edit(source / "frame_00003.json", **members)
    found = read_one(SCANNER_APP, source)
    assert (len(found), int(found.vio_from_cam.is_known.sum())) == (frames, poses)
    if problem:
        assert problem in texts(found, warnings=True)
        assert "frame_00003.json" in texts(found, warnings=True)


def test_a_file_that_is_no_json(tmp_path):
    source = make_scanner_app(tmp_path / "scan")
    (source / "frame_00003.json").write_text('{"time": 90')
    assert len(read_one(SCANNER_APP, source)) == COUNT - 1
    for path in source.glob("frame_*.json"):
        path.write_text("")
    with pytest.raises(FileError, match=r"frame_00000.json:1: expected JSON"):
        read_one(SCANNER_APP, source)


def test_no_capture(tmp_path):
    with pytest.raises(FormatError, match=r"expected frame_00000.json and so on"):
        read_one(SCANNER_APP, tmp_path)
    with pytest.raises(FormatError, match=r"expected keyframes/cameras/"):
        read_one(POLYCAM, tmp_path)


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e6, 1e9])
def test_polycam(unit, tmp_path):
    found = read_one(POLYCAM, make_polycam(tmp_path / "scan", unit=unit))
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)
    np.testing.assert_allclose(found.timestamp_s, 900 + np.arange(COUNT) / 2)
    assert found.image_names[3] == "3.jpg"
    assert found.info.is_gravity_aligned
    assert "poses: of cameras/, as ARKit" in texts(found, warnings=False)


def test_polycam_without_timestamps(tmp_path):
    source = make_polycam(tmp_path / "scan")
    for path in (source / "keyframes/cameras").iterdir():
        content = json.loads(path.read_text())
        del content["timestamp"]
        path.write_text(json.dumps(content))
    found = read_one(POLYCAM, source)
    assert found.info.clock == "frame-rate"
    assert "no timestamps: counted at 1 Hz" in texts(found, warnings=True)


def test_polycam_corrected_cameras_come_first(tmp_path):
    source = make_polycam(tmp_path / "scan")
    make_polycam(source, "corrected_cameras", "corrected_images")
    found = read_one(POLYCAM, source)
    assert found.images[0].parent.name == "corrected_images"
    assert "of corrected_cameras/, as Polycam corrected them" in texts(found, warnings=False)


@pytest.mark.parametrize("inner", ["keyframes", ""])
def test_polycam_folders_around_and_within(inner, tmp_path):
    source = make_polycam(tmp_path / "download" / "scan")
    place = source / inner if inner else tmp_path / "download"
    assert len(read_one(POLYCAM, place)) == COUNT


def test_polycam_as_transforms(tmp_path):
    found = read_one(POLYCAM, make_nerfstudio(tmp_path / "capture"))
    assert len(found) == COUNT


def test_polycam_pictures_of_some_frames(tmp_path):
    source = make_polycam(tmp_path / "scan")
    (source / "keyframes/images/4.jpg").unlink()
    found = read_one(POLYCAM, source)
    assert "images: 1 frame has none, the first is frame 5" in texts(found, warnings=True)
    assert found.vio_from_cam.is_known.all()


@pytest.mark.skipif("VIOAPR_DATA" not in os.environ, reason="real data needed: set VIOAPR_DATA")
def test_a_real_capture_of_3d_scanner_app(tmp_path):
    source = Path(os.environ["VIOAPR_DATA"]) / "scanner_app_3d"
    if not source.exists():
        pytest.skip("the capture of 3D Scanner App is not there")
    found = read_one(SCANNER_APP, source)
    assert len(found) == 92
    assert found.info.is_gravity_aligned, "a desk seen from above, and ARKit's world is y up"
    assert "y is up by its definition" in texts(found, warnings=False)
    assert 15 < found.timestamp_s[-1] - found.timestamp_s[0] < 16
    frames = write_recording(make_scene(tmp_path / "s", 3), found).recording(found.id).frames
    assert frames.has_image.sum() == 31
    cameras = np.array(frames.intrinsics)[:, frames.has_image]
    assert (cameras[:2] == [[1920], [1440]]).all()
    assert ((cameras[2] > 1400) & (cameras[2] < 1500)).all()
