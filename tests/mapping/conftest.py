"""A small scene, mapped once for all tests that look at the result."""

from __future__ import annotations

import pickle
import shutil

import pytest
from tests.room import QUICK, SMALL
from tests.shared import shared_folder

from vioapr.scene.scene import Scene
from vioapr.simulation.rooms import make_room_scene


@pytest.fixture(scope="session")
def room(tmp_path_factory):
    """A scene that is not mapped yet, and the true poses of its recordings."""
    return make_room_scene(tmp_path_factory.mktemp("room") / "scene")


@pytest.fixture(scope="session")
def small_room(tmp_path_factory):
    """The same with fewer images, for what is mapped from the beginning."""
    return make_room_scene(tmp_path_factory.mktemp("small") / "scene", images=SMALL)


@pytest.fixture(scope="session")
def mapped_room(room, tmp_path_factory):
    """A mapped copy of it: the scene, the summary and the true poses."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    from vioapr.mapping.pipeline import map_scene

    with shared_folder(tmp_path_factory, "mapped") as shared:
        folder, kept = shared / "scene", shared / "summary"
        if not kept.exists():
            shutil.copytree(room[0].folder, folder)
            kept.write_bytes(pickle.dumps(map_scene(Scene.open(folder), QUICK)))
    return Scene.open(folder), pickle.loads(kept.read_bytes()), room[1]


@pytest.fixture
def copy_of(tmp_path):
    """Copies a scene, so that a test may spoil it."""

    def copy(scene):
        folder = tmp_path / "copy"
        shutil.copytree(scene.folder, folder)
        return Scene.open(folder)

    return copy
