"""What a user has in a scene is there after mapping: ground truth, files in the map's folder."""

import json
import shutil

import numpy as np
import pytest
from tests.room import QUICK

from vioapr.cli.map_scene import print_summary
from vioapr.errors import AlreadyExistsError
from vioapr.mapping import publishing
from vioapr.mapping.pipeline import map_scene
from vioapr.report.map_report import write_map_report
from vioapr.scene.gt_origin import origin_path
from vioapr.scene.scene import Scene
from vioapr.trajectory import Trajectory

pytestmark = pytest.mark.slow

pytest.importorskip("pycolmap", reason="pycolmap is not installed")


@pytest.fixture
def scene(mapped_room, copy_of):
    """A mapped scene: mapping it again only publishes."""
    return copy_of(mapped_room[0])


def other_gt():
    return Trajectory(np.arange(2.0), np.full((2, 3), 7.0), np.eye(4)[[3, 3]])


def bytes_of(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_mapping_says_that_it_wrote_ground_truth(scene):
    for id_ in ("a", "b", "t"):
        origin = scene.gt_origin(id_)
        assert origin is not None
        assert origin.writer == "mapping"
    note = json.loads(origin_path(scene.gt_path("a")).read_text())
    assert note["format"] == "vioapr ground truth origin"


def test_its_own_ground_truth_is_replaced(scene):
    summary = map_scene(scene, QUICK)
    assert (summary.gt_folder, summary.kept_gt, summary.gt_backup) == ("gt", [], "")
    assert scene.gt_origin("a") is not None


@pytest.mark.parametrize("writer", ["simulator", "importer", None])
def test_ground_truth_of_others_is_kept_with_its_world(scene, capsys, writer):
    expected = {id_: scene.gt_path(id_).read_bytes() for id_ in "abt"}
    scene.write_gt("b", other_gt(), writer)
    before, toml = bytes_of(scene.folder / "gt"), (scene.folder / "scene.toml").read_bytes()
    summary = map_scene(scene, QUICK)
    assert bytes_of(scene.folder / "gt") == before
    assert (scene.folder / "scene.toml").read_bytes() == toml
    assert (summary.gt_folder, summary.kept_gt) == ("map/gt", ["b"])
    print_summary(summary)
    said = " ".join(capsys.readouterr().out.split())
    assert "ground truth in gt/ of b is not mapping's and was kept" in said
    assert "the map's is in map/gt/: --replace-gt puts it into gt/" in said
    assert expected == {id_: (scene.map_folder / f"gt/{id_}.tum").read_bytes() for id_ in "abt"}
    # The report compares with the map's own.
    page = write_map_report(Scene.open(scene.folder), summary)
    vio = json.loads((page.parent / "vio.json").read_text())
    assert all(track["ate_m"] < 0.03 for track in vio["tracks"])


def test_ground_truth_that_was_edited_or_is_older_is_the_users(scene):
    edited = scene.gt_path("a")
    edited.write_text(edited.read_text() + "# checked by hand\n")
    origin_path(scene.gt_path("t")).unlink()  # as older versions left it
    before = bytes_of(scene.folder / "gt")
    assert map_scene(scene, QUICK).kept_gt == ["a", "t"]
    assert bytes_of(scene.folder / "gt") == before


def test_it_is_replaced_on_request_and_backed_up(scene):
    expected = scene.gt_path("b").read_bytes()
    for number in (1, 2):
        scene.write_gt("b", other_gt(), "simulator", "by a test")
        before = bytes_of(scene.folder / "gt")
        summary = map_scene(scene, QUICK, replace_gt=True)
        assert (summary.gt_folder, summary.gt_backup) == ("gt", f"gt.backup-{number}")
        assert scene.gt_path("b").read_bytes() == expected
        kept = bytes_of(scene.folder / f"gt.backup-{number}")
        assert kept == {path: before[path] for path in kept}
        assert {str(path) for path in kept} == {"b.tum", "b.origin.json"}
    assert not (scene.folder / "map" / "gt").exists()


def test_ground_truth_of_others_is_not_removed_where_the_map_has_none(scene, monkeypatch):
    monkeypatch.setattr(publishing, "ground_truth", lambda *args: None)
    scene.write_gt("b", other_gt(), "simulator")
    map_scene(scene, QUICK)
    assert scene.gt_path("b").exists()
    scene.write_gt("b", other_gt(), "mapping")
    map_scene(scene, QUICK)
    assert not list((scene.folder / "gt").iterdir())


def test_files_of_the_user_in_the_maps_folder_stay(scene):
    folder = scene.map_folder
    (folder / "notes.txt").write_text("mine")
    (folder / "views" / "deep").mkdir(parents=True)
    (folder / "views" / "deep" / "one.png").write_bytes(b"mine")
    (folder / "link").symlink_to("notes.txt")
    map_scene(scene, QUICK)
    assert (folder / "notes.txt").read_text() == "mine"
    assert (folder / "views" / "deep" / "one.png").read_bytes() == b"mine"
    assert (folder / "link").is_symlink()
    assert not list(scene.folder.glob(".map*.partial"))


@pytest.mark.parametrize("note", ["missing", "of others"])
def test_a_map_of_others_is_refused_before_the_work(scene, note):
    path = scene.map_folder / "map.json"
    path.unlink() if note == "missing" else path.write_text("{}")
    shutil.rmtree(scene.folder / ".mapping")
    before = bytes_of(scene.map_folder)
    with pytest.raises(AlreadyExistsError, match="holds a map that vioapr did not make .* move"):
        map_scene(scene, QUICK)
    assert bytes_of(scene.map_folder) == before


def test_what_was_imported_meanwhile_stays_in_the_scene(scene):
    """`scene.toml` is read again before the world is written to it."""
    before = Scene.open(scene.folder)
    Scene.open(scene.folder).with_excluded("later", "imported while it was mapped").save()
    map_scene(before, QUICK)
    assert "later" in Scene.open(scene.folder).excluded
