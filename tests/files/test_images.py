"""A few bytes tell an image's size, and whether it is whole."""

import io

import numpy as np
import pytest
from PIL import Image
from tests.scene.scenes import jpeg

from vioapr.errors import FileMissingError, FormatError
from vioapr.files.images import decode_problem, probe_bytes, probe_image, read_grey


def encode(width, height, **options):
    buffer = io.BytesIO()
    pixels = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(buffer, **options)
    return buffer.getvalue()


def exif(size):
    """Metadata of a given size, as a thumbnail would be."""
    data = Image.Exif()
    data[0x010E] = "x" * size
    return data


@pytest.mark.parametrize(
    "content",
    [
        encode(200, 120, format="jpeg"),
        encode(200, 120, format="jpeg", progressive=True),
        encode(200, 120, format="jpeg", exif=exif(60_000)),
        encode(200, 120, format="jpeg") + b"\0\0\0\0",
        encode(200, 120, format="png"),
    ],
    ids=["jpeg", "progressive", "thumbnail", "padded", "png"],
)
def test_size_of_whole_images(content, tmp_path):
    path = tmp_path / "image"
    path.write_bytes(content)
    expected = (200, 120, None, 8, "rgb", 1)
    assert probe_image(path) == expected
    assert probe_bytes(content) == expected
    assert probe_image(path).obstacle is None
    assert decode_problem(path) is None


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "an empty file"),
        (b"hello", "got something else"),
        (jpeg()[:20], "is it truncated"),
        (encode(200, 120, format="jpeg")[:-1], "truncated: the image's end is missing"),
        (encode(200, 120, format="jpeg")[:6000], "truncated: the image's end is missing"),
        (encode(200, 120, format="png")[:-5], "truncated: the image's end is missing"),
        (encode(200, 120, format="png")[:12], "is it truncated"),
    ],
)
def test_what_crashes_leave(content, problem, tmp_path):
    path = tmp_path / "image"
    path.write_bytes(content)
    assert problem in probe_image(path).problem
    assert problem in probe_bytes(content).problem


def test_missing_and_unreadable_files(tmp_path):
    assert "found no file" in probe_image(tmp_path / "none.jpg").problem
    assert "cannot be read: Is a directory" in probe_image(tmp_path).problem


def test_damage_within_an_image_shows_when_it_is_decoded(tmp_path):
    content = bytearray(encode(200, 120, format="png"))
    content[3000:3100] = bytes(100)
    path = tmp_path / "image.png"
    path.write_bytes(content)
    assert probe_image(path).problem is None
    assert "cannot be decoded" in decode_problem(path)


@pytest.mark.parametrize("suffix", ["jpg", "png"])
@pytest.mark.parametrize("longest_px", [50, 77, 200, 400])
def test_a_grey_image_is_scaled_down_only(tmp_path, suffix, longest_px):
    ramp = np.linspace(0, 255, 200)[None, :, None] * np.ones((90, 1, 3))
    path = tmp_path / f"ramp.{suffix}"
    Image.fromarray(ramp.astype(np.uint8)).save(path)
    grey = read_grey(path, longest_px)
    size = np.array(grey.pixels.shape[::-1])
    assert size.max() == min(longest_px, 200)
    np.testing.assert_allclose(size * grey.scale, [200, 90])
    middle = (np.arange(size[0]) + 0.5) * grey.scale[0] - 0.5
    np.testing.assert_allclose(grey.pixels[size[1] // 2], 255 * middle / 199, atol=4)


def test_a_broken_grey_image(tmp_path):
    path = tmp_path / "half.jpg"
    Image.new("L", (300, 200), 90).save(path)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(FormatError, match="can be decoded"):
        read_grey(path, 100)
    with pytest.raises(FileMissingError):
        read_grey(tmp_path / "none.jpg", 100)
