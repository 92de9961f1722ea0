"""A small scene, mapped once for all tests that look at the result."""

from __future__ import annotations

import shutil

import pytest
from tests.room import QUICK

from vioapr.scene.scene import Scene
from vioapr.simulation.rooms import make_room_scene


@pytest.fixture(scope="session")
def room(tmp_path_factory):
    """A scene that is not mapped yet, and the true poses of its recordings."""
    return make_room_scene(tmp_path_factory.mktemp("room") / "scene")


@pytest.fixture(scope="session")
def mapped_room(room, tmp_path_factory):
    """A mapped copy of it: the scene, the summary and the true poses."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    from vioapr.mapping.pipeline import map_scene

    folder = tmp_path_factory.mktemp("mapped") / "scene"
    shutil.copytree(room[0].folder, folder)
    summary = map_scene(Scene.open(folder), QUICK)
    return Scene.open(folder), summary, room[1]


@pytest.fixture
def copy_of(tmp_path):
    """Copies a scene, so that a test may spoil it."""

    def copy(scene):
        folder = tmp_path / "copy"
        shutil.copytree(scene.folder, folder)
        return Scene.open(folder)

    return copy
