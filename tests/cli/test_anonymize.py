"""`vioapr scene anonymize` and `vioapr import ... --anonymize`: what they say, and when."""

import numpy as np
import pytest

from vioapr.cli import scene as verb
from vioapr.errors import MissingExtraError
from vioapr.files import published
from vioapr.files.images import encode_image, read_rgb
from vioapr.scene import faces
from vioapr.scene.faces import Face


class OneFace:
    """Finds a face in the middle of every picture that is not blurred yet."""

    def find(self, pixels):
        return [Face(10, 10, 30, 30)] if pixels[20, 20].min() > 250 else []


@pytest.fixture
def source(tmp_path):
    """A folder of three pictures and their poses."""
    folder = tmp_path / "walk"
    folder.mkdir()
    pixels = np.full((40, 40, 3), 60, np.uint8)
    pixels[18:22, 18:22] = 255
    for row in range(3):
        (folder / f"{row}.png").write_bytes(encode_image("x.png", pixels))
    lines = (f"{row} {row} 0 0 1 0 0 0" for row in range(3))
    (tmp_path / "poses.tum").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def words(source, tmp_path):
    poses = tmp_path / "poses.tum"
    out = tmp_path / "scene"
    return "import", "images", source, "--poses", poses, "--out", out, "--place", "indoor"


def test_an_import_blurs_what_it_wrote_and_goes_on(run, words, source, tmp_path, monkeypatch):
    monkeypatch.setattr(verb, "FaceDetector", OneFace)
    monkeypatch.setattr("vioapr.cli.import_.find_network", lambda: None)
    code, text, err = run(*words)
    assert code == 0, err
    assert "blurred" not in text
    image = tmp_path / "scene" / "recordings" / "walk" / "images" / "0.png"
    assert read_rgb(image)[20, 20].tolist() == [255] * 3
    code, text, err = run(*words, "--anonymize")  # an import that was stopped before it
    assert code == 0, err
    assert "walk: 3 faces in 3 images of 3 blurred" in text
    assert read_rgb(image)[20, 20].max() < 200
    assert read_rgb(source / "0.png")[20, 20].tolist() == [255] * 3
    code, text, _ = run("scene", "anonymize", tmp_path / "scene", "--keep-originals")
    assert code == 0
    assert "walk: 3 faces in 3 images of 3 blurred" in text
    assert not (tmp_path / "scene" / "originals").exists()  # there was nothing left to do


def test_without_the_detector_nothing_is_imported(fails, words, tmp_path, monkeypatch):
    monkeypatch.setattr(published, "find_spec", lambda name: None)
    line = fails(*words, "--anonymize")
    assert "vioapr[anonymize]" in line
    assert not (tmp_path / "scene").exists()
    with pytest.raises(MissingExtraError):
        faces.find_network()
