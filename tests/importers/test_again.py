"""The same import, run again, keeps what is there; another one never replaces it."""

import pytest
from tests.importers.sources import make_stray

from vioapr.errors import AlreadyExistsError, LockedError
from vioapr.importers.base import ImportOptions
from vioapr.importers.registry import get_importer, import_source
from vioapr.scene.scene import Scene
from vioapr.work.locks import locked_folder
from vioapr.work.progress import silent


def run(source, out, **options):
    given = ImportOptions(**options)
    return list(
        import_source(get_importer("stray"), source, out, given, place="outdoor", progress=silent)
    )


def content_of(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_the_same_import_keeps_what_is_there(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    before = content_of(out)
    (again,) = run(source, out)
    assert [finding.text for finding in again.findings] == [
        "imported before, by the same import: kept as it is"
    ]
    assert again.split == "train"
    assert content_of(out) == before
    assert not list(out.glob(".lock"))


def test_a_recording_that_was_moved_to_another_split_stays_there(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    Scene.open(out).with_recording("scan", "test").save()
    (again,) = run(source, out)
    assert again.split == "test"
    assert Scene.open(out).splits["test"] == ("scan",)


@pytest.mark.parametrize("other", ["source", "options"])
def test_another_import_of_the_same_id_is_refused(tmp_path, other):
    out = tmp_path / "scene"
    source = make_stray(tmp_path / "scan")
    run(source, out, id="walk")
    before = content_of(out)
    if other == "source":
        source, options = make_stray(tmp_path / "other"), {}
    else:
        options = {"split": "test"}
    with pytest.raises(AlreadyExistsError, match="a recording of this id exists"):
        run(source, out, id="walk", **options)
    assert content_of(out) == before


def test_one_import_at_a_time(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    with locked_folder(out), pytest.raises(LockedError, match="in use by process"):
        run(source, out)
    run(source, out)


def test_what_a_kill_left_of_a_new_scene_is_in_nobodys_way(tmp_path):
    out = tmp_path / "scene"
    out.mkdir()
    (out / ".scene.toml.0123abcd.partial").touch()
    run(make_stray(tmp_path / "scan"), out)
    assert not list(out.glob(".*"))


def test_a_split_that_is_changed_while_images_are_copied_stays(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    steps = import_source(
        get_importer("stray"), make_stray(tmp_path / "two"), out, ImportOptions(),
        progress=lambda title, total: changing(out),
    )  # fmt: skip
    list(steps)
    assert "gone" in Scene.open(out).excluded
    assert Scene.open(out).splits["train"] == ("scan", "two")


def changing(out):
    Scene.open(out).with_excluded("gone", "by another process").save()
    return silent("", 0)
