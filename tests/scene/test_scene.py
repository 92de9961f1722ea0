"""Scenes: scene.toml, splits and ground truth."""

import errno

import numpy as np
import pytest
from tests.scene.scenes import edit, gt_of, make_scene

from vioapr.errors import (
    AlreadyExistsError,
    FileError,
    FileMissingError,
    ParameterError,
    UnwritableError,
    VersionError,
)
from vioapr.scene.scene import Scene
from vioapr.schemas.scene import GeodeticOrigin, World


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
    with pytest.raises(AlreadyExistsError, match=r"scene.toml: expected to make a new scene"):
        Scene.create(scene.folder, "x", is_outdoor=True)


@pytest.mark.parametrize("id_", ["", "../x", "a/b", ".a", "a b", "x" * 101])
def test_ids_are_folder_names(id_, scene):
    with pytest.raises(ParameterError, match="expected a recording's id"):
        scene.with_recording(id_, "train")


def test_unknown_split(scene):
    with pytest.raises(ParameterError, match="expected a split of train, test, got 'val'"):
        scene.with_recording("walk-1", "val")


def test_no_scene(tmp_path):
    with pytest.raises(FileMissingError, match="expected a scene's folder, found none"):
        Scene.open(tmp_path / "none")
    with pytest.raises(FileMissingError, match=r"scene.toml: expected a file, found none"):
        Scene.open(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("version = 1", "version = 2", "expected version 1, got 2"),
        ('name = "Courtyard"', "name = 3", "scene.toml: name: expected text, got 3"),
        ('name = "Courtyard"\n', "", "scene.toml: expected a member 'name', found none"),
        (
            "is_outdoor = true",
            'is_outdoor = "yes"',
            "is_outdoor: expected true or false",
        ),
        ("is_outdoor = true", "is_outdoor = true\ncolour = 1", "got 'colour'"),
        ('train = ["walk-1"]', "train = [1]", r"splits.train\[0\]: expected text, got 1"),
        ('train = ["walk-1"]', 'val = ["walk-1"]', "splits: expected only train, test, got 'val'"),
        ("[world]", "[excluded]\na = 1\n[world]", "excluded.a: expected text, got 1"),
        (
            "[world]",
            "[world]\norigin = {latitude_deg = 1}",
            "world.origin: .*'longitude_deg'",
        ),
        ("[world]", "[world", r"scene.toml:\d+: expected TOML"),
    ],
)
def test_malformed_scene_toml(old, new, problem, scene):
    edit(scene.folder / "scene.toml", old, new)
    with pytest.raises(FileError, match=problem) as error:
        Scene.open(scene.folder)
    assert isinstance(error.value, VersionError) == (new == "version = 2")


def test_a_full_disk_spares_what_was_there(scene, monkeypatch):
    before = (scene.folder / "scene.toml").read_text(), scene.gt_path("walk-1").read_text()

    def full(path, content):
        path.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    with pytest.raises(UnwritableError, match="No space left"):
        scene.with_recording("walk-9", "train").save()
    with pytest.raises(UnwritableError, match="No space left"):
        scene.write_gt("walk-1", gt_of(2))
    after = (scene.folder / "scene.toml").read_text(), scene.gt_path("walk-1").read_text()
    assert after == before
    assert not list(scene.folder.rglob("*.partial"))
