"""`localize` says what looks wrong with the tracker's poses, and turns those of a body."""

import csv

import numpy as np
import pytest
from PIL import Image
from tests.localizers import pictures

from vioapr.formats import conventions, tum
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Tracking
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo
from vioapr.simulation.regressors import RegressorErrors
from vioapr.simulation.walks import WalkParams, simulate_walk

pytestmark = pytest.mark.slow

BODY_FROM_CAM = Rigid3(np.zeros(3), quaternion.from_rotvec(np.array([0.05, -0.02, 1.55])))


@pytest.fixture(scope="module")
def walk():
    errors = RegressorErrors(0.2, 1.0, 0.05, 0.3, 0.0)
    return simulate_walk(WalkParams(duration_s=90, extent_m=10, regressor=errors), seed=3)


@pytest.fixture
def files(walk, model_of, tmp_path):
    """Model, pictures named by time that show the predictions, and a place for the poses."""
    folder = tmp_path / "images"
    folder.mkdir()
    for time_s, picture in zip(walk.apr.timestamp_s, pictures(walk), strict=False):
        Image.fromarray(picture).save(folder / f"{time_s:.6f}.png")
    return (
        *("--model", model_of("vio-apr"), "--images", folder / "*.png"),
        *("--vio", tmp_path / "vio.tum"),
    )


def median_error_m(path, walk):
    with path.open() as file:
        rows = [[float(row[axis]) for axis in "xyz"] for row in csv.DictReader(file)]
    return float(np.nanmedian(np.linalg.norm(np.array(rows) - walk.gt.position_m, axis=1)))


def test_right_poses_give_no_warning(files, walk, run, tmp_path):
    tum.write(tmp_path / "vio.tum", walk.vio)
    code, _, err = run("localize", *files, "--out", tmp_path / "o.csv", "--strict")
    assert (code, err) == (0, "")


def test_opengl_poses_are_named_and_refused(files, walk, run, fails, tmp_path):
    turned = conventions.world_from_arcam(walk.vio.target_from_source)
    tum.write(tmp_path / "vio.tum", walk.vio.with_transforms(turned))
    code, _, err = run("localize", *files, "--out", tmp_path / "o.csv")
    assert code == 0
    (warning,) = err.splitlines()
    assert "vio.tum fits the file's predictions as OpenGL camera axes" in warning
    assert f"vioapr convert {tmp_path / 'vio.tum'} fixed.tum --reading opengl" in warning
    out = tmp_path / "strict.csv"
    assert "OpenGL camera axes" in fails("localize", *files, "--out", out, "--strict")
    assert not out.exists()


def test_a_body_is_turned_to_the_camera(files, walk, run, tmp_path):
    body = walk.vio.target_from_source @ BODY_FROM_CAM.inverse()
    tum.write(tmp_path / "vio.tum", walk.vio.with_transforms(body))
    mount = tmp_path / "mount.txt"
    np.savetxt(mount, BODY_FROM_CAM.to_matrix())
    outs = [tmp_path / f"{name}.csv" for name in ("wrong", "auto", "given")]
    code, _, err = run("localize", *files, "--out", outs[0])
    assert code == 0
    assert "vio.tum holds poses of a device turned by" in err
    assert "give --vio-from-cam" in err
    code, text, err = run("localize", *files, "--out", outs[1], "--vio-from-cam", "auto")
    assert (code, err) == (0, "")
    assert "images: body_from_cam " in text
    code, _, err = run("localize", *files, "--out", outs[2], "--vio-from-cam", mount)
    assert (code, err) == (0, "")
    wrong_m, auto_m, given_m = (median_error_m(out, walk) for out in outs)
    assert auto_m < wrong_m
    assert auto_m == pytest.approx(given_m, rel=0.3)


def test_an_uncertain_format_names_the_flag(files, fails, tmp_path):
    (tmp_path / "vio.tum").write_text("a/1.png 10 20 30 0.6 0 0.8 0\n")
    assert "--vio-format" in fails("localize", *files, "--out", tmp_path / "o.csv")


def test_a_recording_is_to_be_imported_again(walk, model_of, run, tmp_path):
    recording = tmp_path / "recording"
    turned = conventions.world_from_arcam(walk.vio.target_from_source)
    with RecordingWriter(recording, RecordingInfo(tracker="ARKit")) as writer:
        for row, picture in enumerate(pictures(walk)):
            time_s = float(walk.vio.timestamp_s[row])
            writer.add_frame(time_s, f"{row}.png", picture, Tracking.NORMAL, turned.at(row))
    code, _, err = run(
        *("localize", "--model", model_of("vio-apr"), "--recording", recording),
        *("--out", tmp_path / "o.csv"),
    )
    assert code == 0
    (warning,) = err.splitlines()
    assert "recording fits the file's predictions as OpenGL camera axes" in warning
    assert warning.endswith("mend the poses where they are from, and import them again")
