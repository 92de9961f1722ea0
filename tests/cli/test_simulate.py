import pytest
from PIL import Image

from vioapr.scene.scene import Scene


@pytest.mark.slow
def test_a_scene_with_its_previews(run, rendering, tmp_path):
    out = tmp_path / "yard"
    code, text, err = run(
        *("simulate", "courtyard", "--out", out, "--preset", "small", "--workers", "1"),
        *("--duration-s", "3", "--rate-hz", "2", "--train", "1", "--test", "1"),
        *("--width-px", "96", "--height-px", "72", "--people", "1"),
    )
    assert code == 0, err
    assert "train-01: 6 images, sunny" in text
    assert Scene.open(out).splits == {"train": ("train-01",), "test": ("test-01",)}
    for name in ("preview.png", "routes.png"):
        with Image.open(out / name) as image:
            assert min(image.size) > 200
    code, text, err = run("scene", "check", out)
    assert code == 0, text


def test_what_cannot_be_is_refused(fails, tmp_path):
    line = fails("simulate", "courtyard", "--out", tmp_path / "yard", "--rate-hz", "0")
    assert line.startswith("--rate-hz: expected")
