"""`vioapr import`, `vioapr scene check` and `vioapr scene info`."""

import json
import re

import pytest
from PIL import Image
from tests.importers.sources import (
    make_images,
    make_marvin,
    make_nerfstudio,
    make_stray,
)
from tests.scene.scenes import make_scene

from vioapr.importers.registry import IMPORTERS


@pytest.fixture
def scene(tmp_path):
    return make_scene(tmp_path / "scene", 9)


def test_check_of_a_whole_scene(run, scene):
    code, out, _ = run("scene", "check", scene.folder)
    assert code == 0
    assert "2 recordings, 18 frames, 18 images: nothing is wrong" in out


def test_check_prints_all_problems_and_fails(run, scene):
    (scene.folder / "recordings/walk-1/images/frame-3.jpg").unlink()
    (scene.folder / "recordings/walk-2/images/frame-0.jpg").write_bytes(b"")
    code, out, err = run("scene", "check", scene.folder)
    assert code == 2
    assert "walk-1/frames.csv:5: images/frame-3.jpg: expected an image, found no file" in out
    assert "walk-2/frames.csv:2: images/frame-0.jpg: expected an image, got an empty file" in out
    assert err.strip().endswith("2 problems in 2 recordings, 18 frames, 18 images")


def test_check_of_no_scene(fails, tmp_path):
    assert "expected a scene's folder, found none" in fails("scene", "check", tmp_path / "none")


@pytest.mark.slow
def test_info(run, scene, tmp_path):
    figure, table = tmp_path / "speeds.png", tmp_path / "info.json"
    code, out, _ = run("scene", "info", scene.folder, "--figure", figure, "--json", table)
    assert code == 0
    row = next(line for line in out.splitlines() if "Courtyard" in line and "outdoor" in line)
    assert re.split(r"\s{2,}", row) == [
        "outdoor", "Courtyard", "9", "9", "2", "0.0 x 4.0 x 0.0",
    ]  # fmt: skip
    assert "1.0 m/s" in out
    with Image.open(figure) as image:
        assert image.size[0] > 300
    (content,) = json.loads(table.read_text())
    assert content["images"] == {"train": 9, "test": 9}
    assert content["recordings"][0]["median_speed_m_s"] == 1


def test_info_of_several_scenes(run, scene, tmp_path):
    other = make_scene(tmp_path / "other", 3)
    figure = tmp_path / "speeds.svg"
    code, out, _ = run("scene", "info", scene.folder, other.folder, "--figure", figure)
    assert code == 0
    assert out.count("outdoor") == 2
    assert figure.read_text().lstrip().startswith("<?xml")


def test_info_of_another_kind_of_figure(fails, scene):
    message = fails("scene", "info", scene.folder, "--figure", "speeds.pdf")
    assert "--figure: expected a name ending in .png or .svg, got speeds.pdf" in message


def test_import_check_and_info_of_a_scan(run, tmp_path):
    source, out = make_stray(tmp_path / "scan"), tmp_path / "lab"
    code, text, _ = run("import", "stray", source, "--out", out, "--place", "indoor")
    assert code == 0
    assert "lab/recordings/scan (train)" in text
    assert "gravity: the tracker's +y is up" in text
    code, text, _ = run(
        "import", "stray", source, "--out", out, "--id", "again", "--split", "test",
        "--images", "link",
    )  # fmt: skip
    assert code == 0
    assert run("scene", "check", out)[0] == 0
    assert run("scene", "info", out)[0] == 0


def test_import_goes_by_other_names(run, tmp_path):
    source = make_nerfstudio(tmp_path / "capture")
    code, text, _ = run("import", "Polycam", source, "--out", tmp_path / "s", "--place", "indoor")
    assert code == 0
    assert "recordings/capture (train)" in text


def test_import_a_folder_with_a_trajectory(run, tmp_path):
    source = make_images(tmp_path / "s")
    code, text, _ = run(
        "import", "images", source / "images", "--poses", source / "vio.tum",
        "--gt", source / "gt.tum", "--out", tmp_path / "scene", "--place", "outdoor",
    )  # fmt: skip
    assert code == 0
    assert "20 frames: 20 with image, 20 with tracker's pose, 20 with ground truth" in text
    assert (tmp_path / "scene/gt/images.tum").exists()


def test_import_several_scenes(run, tmp_path):
    for name in ("Church", "Office"):
        make_marvin(tmp_path / "MARViN" / name)
    code, text, _ = run("import", "marvin", tmp_path / "MARViN", "--out", tmp_path / "scenes")
    assert code == 0
    assert "4 recordings imported" in text
    for name in ("Church", "Office"):
        assert run("scene", "check", tmp_path / "scenes" / name)[0] == 0


def test_import_keeps_what_was_imported_before_a_failure(run, tmp_path):
    make_marvin(tmp_path / "Church")
    for path in (tmp_path / "Church/test-1").iterdir():
        path.write_bytes(b"")
    code, _, err = run("import", "marvin", tmp_path / "Church", "--out", tmp_path / "out")
    assert code == 2
    assert "none of 20 images can be used" in err
    code, out, _ = run("scene", "check", tmp_path / "out")
    assert code == 0
    assert "note: " in out
    assert "the split test is empty" in out
    assert "1 recording, 20 frames, 20 images: nothing is wrong" in out


def test_import_says_flags_for_parameters(run, tmp_path):
    source = make_nerfstudio(tmp_path / "capture")
    _, text, _ = run("import", "nerfstudio", source, "--out", tmp_path / "s", "--place", "indoor")
    assert "if they are in metres, give --metric" in text
    _, text, _ = run(
        "import", "nerfstudio", source, "--out", tmp_path / "s", "--id", "b", "--metric",
        "--focal-px", "30",
    )  # fmt: skip
    assert "scale: metres, as you say" in text
    assert "focal length 30 pixels, as you say" in text


def test_strict_import_refuses_warnings_and_leaves_nothing(fails, tmp_path):
    source = make_nerfstudio(tmp_path / "capture")
    message = fails(
        "import", "nerfstudio", source, "--out", tmp_path / "s", "--place", "indoor", "--strict"
    )
    assert "refused, as --strict says: no timestamps" in message
    assert not list((tmp_path / "s").rglob("frames.csv"))


def test_import_says_what_is_missing(fails, tmp_path):
    out = tmp_path / "out"
    assert "unknown source 'kinect': expected one of " + ", ".join(IMPORTERS) in fails(
        "import", "kinect", tmp_path, "--out", out
    )
    assert "found nothing of this name" in fails("import", "stray", tmp_path / "x", "--out", out)
    assert "--poses has no meaning for stray" in fails(
        "import", "stray", tmp_path, "--out", out, "--poses", "a.tum"
    )
    source = make_stray(tmp_path / "scan")
    assert "give --place: outdoor or indoor" in fails("import", "stray", source, "--out", out)
    assert not out.exists()
