"""The image cache: exact, made once, made again when images change, whole or not there."""

import io

import numpy as np
import pytest
from PIL import Image

from vioapr.errors import DiskFullError, FileMissingError, FormatError
from vioapr.regression import cache
from vioapr.regression.cache import cached_images, read_image


@pytest.fixture
def paths(tmp_path, rng):
    found = []
    for number in range(5):
        path = tmp_path / "images" / f"{number}.png"
        path.parent.mkdir(exist_ok=True)
        Image.fromarray(rng.integers(0, 255, (30, 50, 3), dtype=np.uint8)).save(path)
        found.append(path)
    return found


def test_pixels_are_those_of_pillow(paths, tmp_path):
    images = cached_images(paths, 16, tmp_path / "cache" / "a.npy")
    assert images.shape == (5, 16, 16, 3)
    assert images.dtype == np.uint8
    for image, path in zip(images, paths, strict=True):
        expected = Image.open(path).resize((16, 16), Image.Resampling.BILINEAR)
        assert np.array_equal(image, np.asarray(expected))


def test_decoded_once(paths, tmp_path, monkeypatch):
    file = tmp_path / "a.npy"
    first = np.array(cached_images(paths, 16, file))
    monkeypatch.setattr(cache, "read_image", lambda *_: pytest.fail("decoded again"))
    ticks = []
    assert np.array_equal(cached_images(paths, 16, file, lambda: ticks.append(1)), first)
    assert len(ticks) == 5


def test_made_again_when_an_image_or_the_size_changes(paths, tmp_path):
    file = tmp_path / "a.npy"
    before = np.array(cached_images(paths, 16, file))
    Image.new("RGB", (50, 30), (255, 0, 0)).save(paths[2])
    after = cached_images(paths, 16, file)
    assert not np.array_equal(after[2], before[2])
    assert np.array_equal(after[1], before[1])
    assert cached_images(paths, 8, file).shape == (5, 8, 8, 3)
    assert len(cached_images(paths[:3], 8, file)) == 3


def test_grey_and_transparent_images_become_rgb(tmp_path):
    for mode in ("L", "RGBA", "P"):
        path = tmp_path / f"{mode[:1]}.png"
        Image.new(mode, (20, 20)).save(path)
        assert read_image(path, 8).shape == (8, 8, 3)


def test_images_of_16_bits_are_to_be_imported(tmp_path):
    Image.new("I;16", (20, 20)).save(tmp_path / "a.png")
    with pytest.raises(FormatError, match="expected 8 bits a channel, got 16: import the images"):
        read_image(tmp_path / "a.png", 8)


def test_missing_and_broken_images(paths, tmp_path):
    file = tmp_path / "a.npy"
    content = paths[3].read_bytes()
    paths[3].write_bytes(content[: len(content) // 2])
    with pytest.raises(FormatError, match=r"3\.png: expected an image that can be decoded"):
        cached_images(paths, 16, file)
    paths[3].write_text("no image")
    with pytest.raises(FormatError, match=r"3\.png: expected an image that can be decoded"):
        cached_images(paths, 16, file)
    paths[3].unlink()
    with pytest.raises(FileMissingError, match=r"3\.png: expected an image, found no file"):
        cached_images(paths, 16, file)
    with pytest.raises(FileMissingError, match=r"3\.png: expected an image, found no file"):
        read_image(paths[3], 16)
    assert not list(tmp_path.glob("*.npy")) + list(tmp_path.glob(".*partial"))


def test_a_full_disk_leaves_nothing_half_done(paths, tmp_path, monkeypatch):
    file = tmp_path / "a.npy"

    class Full(io.BytesIO):
        def write(self, content):
            if self.tell() > 2000:
                raise OSError(28, "No space left on device")
            return super().write(content)

    opened = type(file).open

    def open_(path, mode="r", **options):
        return Full() if mode == "wb" else opened(path, mode, **options)

    monkeypatch.setattr(type(file), "open", open_)
    with pytest.raises(DiskFullError, match="cannot be written: No space left"):
        cached_images(paths, 16, file)
    monkeypatch.undo()
    assert len(cached_images(paths, 16, file)) == 5
