import sys

import pytest
from tests.room import SMALL

from vioapr.scene.scene import Scene
from vioapr.simulation.rooms import make_room_scene

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def room_folder(tmp_path_factory):
    scene, _ = make_room_scene(tmp_path_factory.mktemp("cli") / "scene", images=SMALL)
    return scene.folder


def test_map_says_what_it_found(run, room_folder):
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    options = ("--max-features", "400", "--sequential", "4", "--spatial", "2", "--loops", "4")
    code, out, err = run("map", room_folder, *options)
    assert code == 0, err
    for words in ("registered images", "map: 10 images", "scale by VIO", "up by VIO", "report: "):
        assert words in out
    assert (room_folder / "map" / "report" / "index.html").exists()
    assert run("scene", "check", room_folder)[0] == 0
    _, again, _ = run("map", room_folder, *options)
    assert "not repeated: features, matches, near, pruning, model, world, test" in again
    _, quality, _ = run("vio-quality", room_folder)
    assert "Room arkit" in quality


def test_bad_scenes(fails, tmp_path):
    assert "expected a scene's folder" in fails("map", tmp_path / "no")
    scene = Scene.create(tmp_path / "empty", "Empty", is_outdoor=True)
    assert "expected training recordings in splits.train" in fails("map", scene.folder)


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--max-features", "5", "--max-features: expected at least 100, got 5"),
        ("--max-rate-hz", "-1", "--max-rate-hz: expected at least 0"),
        ("--sequential", "-1", "sequential: expected at least 0"),
        ("--mapper", "magic", "mapper"),
    ],
)
def test_bad_parameters(fails, tmp_path, option, value, message):
    assert message in fails("map", tmp_path, option, value)


def test_without_pycolmap(fails, tmp_path, monkeypatch):
    scene = Scene.create(tmp_path / "scene", "Scene", is_outdoor=True)
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    assert "pip install 'vioapr[mapping]'" in fails("map", scene.folder)
