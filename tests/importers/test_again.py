"""The same import, run again, keeps what is there; another one never replaces it."""

import json
import os

import pytest
from tests.importers.sources import make_stray, map_of, walk
from tests.scene.scenes import jpeg

from vioapr.errors import AlreadyExistsError, FormatError, LockedError, UnwritableError
from vioapr.formats import tum
from vioapr.importers import write
from vioapr.importers.base import ImportOptions
from vioapr.importers.registry import get_importer, import_source
from vioapr.importers.write import IMPORT_FILE
from vioapr.scene.scene import Scene
from vioapr.work.locks import locked_folder
from vioapr.work.progress import silent


def run(source, out, *, overwrite=False, importer="stray", **options):
    steps = import_source(
        get_importer(importer), source, out, ImportOptions(**options),
        place="outdoor", overwrite=overwrite, progress=silent,
    )  # fmt: skip
    return list(steps)


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


KEPT = (
    "the source has changed since the recording was imported, which is kept as it was: "
    "give `overwrite` to import it again"
)


def change_poses(source):
    path = source / "odometry.csv"
    path.write_text(path.read_text().replace("0.1,", "0.11,", 1))


def shorten(source):
    make_stray(source, 12)
    for number in range(12, 20):
        (source / "rgb" / f"{number:06d}.jpg").unlink()


def change_image(source):
    path = source / "rgb" / "000003.jpg"
    path.write_bytes(jpeg(shade=200))
    os.utime(path, ns=(1, 1))


def change_camera(source):
    path = source / "camera_matrix.csv"
    path.write_text(path.read_text().replace("21", "22"))


@pytest.mark.parametrize("change", [change_poses, shorten, change_image, change_camera])
def test_a_source_that_has_changed_is_told_and_imported_again_if_asked_to(tmp_path, change):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    before = content_of(out)
    change(source)
    (kept,) = run(source, out)
    assert [(finding.text, finding.is_warning) for finding in kept.findings] == [(KEPT, True)]
    assert content_of(out) == before
    run(source, out, overwrite=True)
    run(source, tmp_path / "fresh" / "scene")
    assert content_of(out) == content_of(tmp_path / "fresh" / "scene")
    assert content_of(out) != before
    (again,) = run(source, out)
    assert again.findings[0].text == "imported before, by the same import: kept as it is"


def test_files_that_say_the_same_are_no_change(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    path = source / "odometry.csv"
    path.write_text(path.read_text().replace("\n", "\r\n"))
    (source / "notes.txt").write_text("mine")
    (again,) = run(source, out)
    assert not again.findings[0].is_warning


def test_a_change_is_an_error_if_warnings_are(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out, strict=True)
    shorten(source)
    with pytest.raises(FormatError, match="has changed since .* give `overwrite`"):
        run(source, out, strict=True)


def test_ground_truth_and_pictures_of_other_folders_count_too(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    gt = tmp_path / "gt.tum"
    tum.write(gt, map_of(walk()))
    images = {"importer": "images", "gt": gt, "poses": source / "odometry.csv", "metric": True}
    run(source / "rgb", out, **images)
    tum.write(gt, map_of(walk(12)))
    (kept,) = run(source / "rgb", out, **images)
    assert kept.findings[0].text == KEPT
    run(source / "rgb", out, overwrite=True, **images)
    assert len(Scene.open(out).gt("rgb")) == 12


def test_of_an_earlier_version_the_source_is_not_known(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    note = out / "recordings" / "scan" / IMPORT_FILE
    noted = json.loads(note.read_text())
    del noted["content"]
    note.write_text(json.dumps(noted))
    shorten(source)
    (again,) = run(source, out)
    assert not again.findings[0].is_warning


def test_a_recording_that_is_replaced_stays_in_its_split(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    Scene.open(out).with_recording("scan", "test").save()
    shorten(source)
    run(source, out, overwrite=True)
    assert Scene.open(out).splits["test"] == ("scan",)
    assert len(Scene.open(out).recording("scan").frames) == 12


@pytest.mark.parametrize("name", ["notes.txt", "images/mine.jpg", "labels/1.txt"])
def test_what_no_import_wrote_is_not_replaced(tmp_path, name):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    path = out / "recordings" / "scan" / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    shorten(source)
    before = content_of(out)
    with pytest.raises(AlreadyExistsError, match=rf"{name}: no import wrote it"):
        run(source, out, overwrite=True)
    assert content_of(out) == before


def test_a_recording_that_no_import_wrote_is_not_replaced(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    (out / "recordings" / "scan" / IMPORT_FILE).unlink()
    with pytest.raises(AlreadyExistsError, match="a recording of this id exists"):
        run(source, out, overwrite=True)


def test_a_failure_while_it_is_replaced_leaves_the_recording_and_its_ground_truth(
    tmp_path, monkeypatch
):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    images = {"importer": "images", "poses": source / "odometry.csv", "gt": tmp_path / "gt.tum"}
    tum.write(images["gt"], map_of(walk()))
    run(source / "rgb", out, metric=True, **images)
    before = content_of(out)
    tum.write(images["gt"], map_of(walk(12)))

    def fail(folder, partial):
        raise UnwritableError(folder, "cannot be written: No space left on device")

    monkeypatch.setattr(write, "replace_folder", fail)
    with pytest.raises(UnwritableError):
        run(source / "rgb", out, overwrite=True, metric=True, **images)
    assert content_of(out) == before


def test_a_crash_between_the_renames_is_mended(tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "scene"
    run(source, out)
    before = content_of(out)
    folder = out / "recordings" / "scan"
    folder.rename(folder.with_name(".scan.old"))
    run(source, out)
    assert content_of(out) == before
