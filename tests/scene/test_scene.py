"""Scenes: scene.toml, splits and ground truth."""

import numpy as np
import pytest
from tests.scene.scenes import edit, gt_of, make_scene

from vioapr.errors import FormatError, ParameterError
from vioapr.scene.scene import GeodeticOrigin, Scene, World


@pytest.fixture
def scene(tmp_path):
    return make_scene(tmp_path / "courtyard", 4)


def test_what_a_scene_holds(scene):
    again = Scene.open(scene.folder)
    assert (again.name, again.is_outdoor) == ("Courtyard", True)
    assert again.splits == {"train": ("walk-1",), "test": ("walk-2",)}
    assert again.world == World()
    assert list(again.recordings) == ["walk-1", "walk-2"]
    assert len(again.recordings["walk-2"].frames) == 4
    np.testing.assert_array_equal(again.gt("walk-1").position_m, gt_of(4).position_m)
    assert again.map_folder == scene.folder / "map"


def test_no_ground_truth(scene):
    scene.gt_path("walk-1").unlink()
    assert scene.gt("walk-1") is None


def test_round_trip_of_everything(tmp_path):
    origin = GeodeticOrigin(22.33, 114.26, 12.5)
    name = 'Piazza "San Marco"\n#1 \\ ü'
    scene = Scene.create(tmp_path / "s", name, is_outdoor=False, world=World(False, False, origin))
    scene.with_recording("a", "train").with_recording("b", "test").with_excluded("c", "x").save()
    again = Scene.open(tmp_path / "s")
    assert again.name == name
    assert again.world == World(False, False, origin)
    assert again.splits == {"train": ("a",), "test": ("b",)}
    assert again.excluded == {"c": "x"}


def test_a_recording_is_in_one_split(scene):
    moved = scene.with_recording("walk-1", "test")
    assert moved.splits == {"train": (), "test": ("walk-2", "walk-1")}
    assert moved.with_recording("walk-1", None).splits == {"train": (), "test": ("walk-2",)}
    excluded = moved.with_excluded("walk-2", "bad")
    assert excluded.excluded == {"walk-2": "bad"}
    assert excluded.with_recording("walk-2", "train").excluded == {}


def test_saving_keeps_comments(scene):
    path = scene.folder / "scene.toml"
    path.write_text("# Captured in May.\n" + path.read_text())
    Scene.open(scene.folder).with_recording("walk-3", "train").save()
    text = path.read_text()
    assert text.startswith("# Captured in May.\n")
    assert Scene.open(scene.folder).splits["train"] == ("walk-1", "walk-3")


def test_hidden_folders_are_no_recordings(scene):
    (scene.folder / "recordings" / ".walk-9.partial").mkdir()
    assert scene.recording_ids == ["walk-1", "walk-2"]


def test_a_scene_is_never_overwritten(scene):
    with pytest.raises(FormatError, match=r"scene.toml: expected to make a new scene"):
        Scene.create(scene.folder, "x", is_outdoor=True)


@pytest.mark.parametrize("id_", ["", "../x", "a/b", ".a", "a b", "x" * 101])
def test_ids_are_folder_names(id_, scene):
    with pytest.raises(ParameterError, match="expected a recording's id"):
        scene.with_recording(id_, "train")


def test_unknown_split(scene):
    with pytest.raises(ParameterError, match="expected a split of train, test, got 'val'"):
        scene.with_recording("walk-1", "val")


def test_no_scene(tmp_path):
    with pytest.raises(FormatError, match="expected a scene's folder, found none"):
        Scene.open(tmp_path / "none")
    with pytest.raises(FormatError, match=r"scene.toml: expected a file, found none"):
        Scene.open(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("version = 1", "version = 2", "expected version = 1, got 2"),
        ('name = "Courtyard"', "name = 3", "expected name to be text, got 3"),
        ('name = "Courtyard"\n', "", "expected name to be text, got nothing"),
        ("is_outdoor = true", 'is_outdoor = "yes"', "expected is_outdoor to be true or false"),
        ("is_outdoor = true", "is_outdoor = true\ncolour = 1", "got 'colour'"),
        ('train = ["walk-1"]', "train = [1]", "expected splits.train to be a list of ids"),
        ('train = ["walk-1"]', 'val = ["walk-1"]', "expected the splits train, test, got 'val'"),
        ("[world]", "[excluded]\na = 1\n[world]", "expected excluded.a to be a reason"),
        ("[world]", "[world]\norigin = {latitude_deg = 1}", "expected longitude_deg to be a numb"),
        ("[world]", "[world", r"scene.toml:\d+: expected TOML"),
    ],
)
def test_malformed_scene_toml(old, new, problem, scene):
    edit(scene.folder / "scene.toml", old, new)
    with pytest.raises(FormatError, match=problem):
        Scene.open(scene.folder)


def test_a_full_disk_spares_what_was_there(scene, monkeypatch):
    before = (scene.folder / "scene.toml").read_text(), scene.gt_path("walk-1").read_text()

    def fail(path, content):
        path.touch()
        raise FormatError(path, "cannot be written: No space left on device")

    monkeypatch.setattr("vioapr.files.text.write_bytes", fail)
    with pytest.raises(FormatError, match="No space left"):
        scene.with_recording("walk-9", "train").save()
    with pytest.raises(FormatError, match="No space left"):
        scene.write_gt("walk-1", gt_of(2))
    after = (scene.folder / "scene.toml").read_text(), scene.gt_path("walk-1").read_text()
    assert after == before
    assert not list(scene.folder.rglob("*.partial"))
