"""`vioapr predict --model map`: what it says, leaves and refuses."""

import shutil

import numpy as np
import pytest

pytest.importorskip("pycolmap", reason="pycolmap is not installed")
pytest.importorskip("cv2", reason="OpenCV is not installed")

from tests.room import SMALL

from vioapr.formats.registry import read_trajectory
from vioapr.scene.scene import Scene
from vioapr.simulation.rooms import make_room_scene


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A room whose recordings have ground truth from elsewhere."""
    scene, truths = make_room_scene(tmp_path_factory.mktemp("room") / "scene", images=SMALL)
    for id_, truth in truths.items():
        scene.write_gt(id_, truth, "simulator")
    return scene, truths


@pytest.fixture
def scene(made, tmp_path):
    return Scene.open(shutil.copytree(made[0].folder, tmp_path / "scene"))


@pytest.mark.slow
def test_from_a_scene_to_figures(run, fails, made, scene):
    arguments = ("predict", scene.folder, "--model", "map", "--max-rate-hz", 0)
    code, out, err = run(*arguments)
    assert code == 0, err
    walks = scene.folder / "walks" / "test"
    assert "localizing in ground truth of a, b: 10 images, " in out
    assert "t: 2 of 2 images localized" in out
    assert f"evaluate them: vioapr evaluate {walks}" in out
    poses = read_trajectory(walks / "t" / "apr_map.tum")
    np.testing.assert_allclose(poses.position_m, made[1]["t"].position_m, atol=0.01)
    code, out, err = run("evaluate", walks, "--methods", "apr")
    assert code == 0, err
    assert "1 walk" in out
    # Run again, it keeps the map and the predictions.
    code, out, err = run(*arguments)
    assert code == 0, err
    assert "t: localized before in this map, kept" in out
    # Another choice of images is another map.
    assert "exists, by another model: choose another --name" in fails(*arguments[:-1], 1)


@pytest.mark.slow
def test_a_recording_that_is_of_elsewhere(run, scene, tmp_path):
    """It gets no predictions, and says so; another recording is not concerned."""
    other, truths = make_room_scene(tmp_path / "other", seed=3, images=3)
    folder = scene.recording_folder("elsewhere")
    shutil.copytree(other.recording_folder("a"), folder)
    scene.with_recording("elsewhere", "test").save()
    scene.write_gt("elsewhere", truths["a"], "simulator")
    code, out, err = run("predict", scene.folder, "--model", "map", "--max-rate-hz", 0)
    assert code == 0, err
    assert "elsewhere: 0 of 3 images localized" in out
    assert "t: 2 of 2 images localized" in out
    walks = scene.folder / "walks" / "test"
    assert not list((walks / "elsewhere").glob("apr_*"))
    assert (walks / "t" / "apr_map.tum").exists()


def test_what_is_refused(fails, made, scene):
    folder = scene.folder
    assert "expected recordings in the split 'train'" in fails(
        "predict", _without_training(scene), "--model", "map", "--split", "train"
    )
    assert "--map, --map-images and --max-rate-hz go with model map" in fails(
        "predict", folder, "--model", folder / "models" / "net", "--map", folder
    )
    assert "--max-rate-hz: expected at least 0, got -1" in fails(
        "predict", folder, "--model", "map", "--max-rate-hz", -1
    )
    assert "expected a map, or ground truth of training recordings" in fails(
        "predict", folder, "--model", "map"
    )
    message = fails("predict", folder, "--model", "map", "--map", folder / "no")
    assert str(folder / "no") in message


def _without_training(scene):
    for id_ in ("a", "b"):
        scene.gt_path(id_).unlink()
    path = scene.folder / "scene.toml"
    before = path.read_text()
    copy = shutil.copytree(scene.folder, scene.folder.with_name("untrained"))
    changed = before.replace('train = ["a", "b"]', "train = []")
    assert changed != before
    (copy / "scene.toml").write_text(changed)
    return copy
