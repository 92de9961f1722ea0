"""Pictures as people have them are converted on import, or named; none is read wrongly."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageOps
from tests.importers.sources import COUNT, make_images, make_nerfstudio, read_walks, texts
from tests.scene.scenes import jpeg, make_scene

from vioapr.errors import FormatError, ParameterError
from vioapr.files.images import probe_bytes, probe_image, read_rgb
from vioapr.importers.base import ImportOptions
from vioapr.importers.images import IMPORTER as IMAGES
from vioapr.importers.nerfstudio import IMPORTER as NERFSTUDIO
from vioapr.importers.pictures import PictureReader, find_range
from vioapr.importers.write import WriteSettings, write_recording
from vioapr.scene.check import check_scene

RAMP = np.linspace(0, 1, 16 * 12).reshape(12, 16)
COLOUR = np.stack([255 * RAMP, 255 * (1 - RAMP), 128 + 0 * RAMP], axis=-1).astype(np.uint8)


def encoded(image, format="png", **options):
    buffer = io.BytesIO()
    image.save(buffer, format=format, **options)
    return buffer.getvalue()


def grey_16(values):
    return encoded(Image.fromarray(np.asarray(values).astype(np.uint16)))


def png(width, height, bits, colour, content):
    """A PNG of any header, whose pixels may be fewer than it says."""

    def chunk(kind, content):
        tail = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + tail

    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(content)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def rgb_16(values):
    """A PNG of 16 bits a channel, which Pillow cannot write."""
    values = np.asarray(values).astype(">u2")
    rows = b"".join(b"\0" + row.tobytes() for row in values)
    return png(values.shape[1], values.shape[0], 16, 2, rows)


def oriented(value, format="jpeg", size=(16, 12)):
    exif = Image.Exif()
    exif[0x0112] = value
    exif[0x010E] = "a phone"
    pixels = np.arange(size[0] * size[1]).reshape(size[1], size[0]).astype(np.uint8)
    return encoded(Image.fromarray(pixels), format, exif=exif)


def import_folder(tmp_path, contents, suffix=".png", **settings):
    """Frames, their images' pixels and the walk of a folder that holds some contents."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k, content in enumerate(contents):
        (folder / f"{k:02d}{suffix}").write_bytes(content)
    (found,) = read_walks(IMAGES, folder, rate_hz=1.0)
    scene = write_recording(make_scene(tmp_path / "scene", 3), found, WriteSettings(**settings))
    assert not check_scene(scene.folder, decode=True).errors, "what import writes passes"
    recording = scene.recording("pictures")
    paths = [recording.image_path(row) for row in np.flatnonzero(recording.frames.has_image)]
    return recording.frames, [read_rgb(path) for path in paths], found


def test_16_bit_grey_becomes_8_bits_by_the_range_of_all(tmp_path):
    contents = [grey_16(RAMP * 500), grey_16(RAMP * 4000), grey_16(RAMP * 1000)]
    frames, pixels, found = import_folder(tmp_path, contents)
    assert frames.has_image.all()
    # 12 bits: 4095 is white in all images, so that they can be compared.
    np.testing.assert_allclose(pixels[1][..., 0], RAMP * 4000 / 4095 * 255, atol=1)
    np.testing.assert_allclose(pixels[0][..., 0], RAMP * 500 / 4095 * 255, atol=1)
    assert (
        "images: 3 are 16-bit grey with values from 0 to 4000: 0 to 4095 became 0 to 255"
        in texts(found, warnings=False)
    )
    assert not texts(found, warnings=True)


@pytest.mark.parametrize(
    ("lowest", "highest", "black", "white"),
    [
        (0, 65535, 0, 65535),
        (3, 1000, 0, 1023),
        (0, 255, 0, 255),
        (0, 300, 0, 511),
        (29000, 31000, 29000, 31000),
        (0, 0, 0, 255),
        (7, 7, 7, 8),
    ],
)
def test_range_of_16_bit_grey(lowest, highest, black, white):
    found = find_range([np.array([lowest, highest])])
    assert found == (black, white, lowest, highest)


def test_values_beyond_the_range_of_the_samples_are_said(tmp_path):
    contents = [grey_16(RAMP * 200)] * 40
    contents[1] = grey_16(RAMP * 900)
    _, pixels, found = import_folder(tmp_path, contents)
    assert pixels[1].max() == 255
    assert "1 16-bit ones hold values beyond 0 to 255" in texts(found, warnings=True)


def test_16_bit_grey_is_refused_where_images_are_read(tmp_path):
    path = tmp_path / "deep.png"
    for content in (grey_16(RAMP * 4000), rgb_16(np.stack([RAMP * 65535] * 3, axis=-1))):
        path.write_bytes(content)
        assert probe_image(path).problem is None
        assert "expected 8 bits a channel, got 16" in probe_image(path).obstacle
        with pytest.raises(FormatError, match=r"got 16: import the images, which converts them"):
            read_rgb(path)


def test_16_bit_images_in_a_scene_fail_the_check(tmp_path):
    scene = make_scene(tmp_path / "scene", 3)
    path = next((scene.recording_folder("walk-1") / "images").iterdir())
    path.write_bytes(grey_16(RAMP))
    assert ["got 16" in problem.text for problem in check_scene(scene.folder).errors] == [True]


def test_16_bit_colour_keeps_its_upper_bits(tmp_path):
    values = np.stack([RAMP * 65535, RAMP * 30000, RAMP * 0], axis=-1)
    _, pixels, found = import_folder(tmp_path, [rgb_16(values)] * 2)
    np.testing.assert_allclose(pixels[0], values / 257, atol=1.5)
    assert "2 have 16 bits a channel: the upper 8 were kept" in texts(found, warnings=False)


def test_16_bit_colour_of_which_the_upper_bits_are_empty_is_broken():
    dark = rgb_16(np.stack([RAMP * 4095] * 3, axis=-1))
    assert "its 16 bits are hardly used" in PictureReader().read(dark).problem


@pytest.mark.parametrize(
    ("content", "suffix", "text"),
    [
        (encoded(Image.fromarray(COLOUR).convert("CMYK"), "jpeg", quality=95), ".jpg", "CMYK"),
        (encoded(Image.fromarray(COLOUR).quantize(200)), ".png", "palette"),
    ],
)
def test_other_kinds_become_rgb(content, suffix, text, tmp_path):
    _, pixels, found = import_folder(tmp_path, [content] * 2, suffix)
    assert np.abs(pixels[0].astype(int) - COLOUR).mean() < 12
    assert f"images: 2 were {text} images, and became RGB" in texts(found, warnings=False)


def test_alpha(tmp_path):
    alpha = np.full((12, 16, 1), 255, dtype=np.uint8)
    opaque = encoded(Image.fromarray(np.concatenate([COLOUR, alpha], axis=-1)))
    alpha[:, :8] = 0
    clear = encoded(Image.fromarray(np.concatenate([COLOUR, alpha], axis=-1)))
    frames, pixels, found = import_folder(tmp_path, [opaque, clear])
    np.testing.assert_array_equal(pixels[0], COLOUR)
    np.testing.assert_array_equal(pixels[1][:, 8:], COLOUR[:, 8:])
    assert (pixels[1][:, :8] == 0).all()
    assert frames.has_image.all()
    assert "images: 1 are partly transparent" in texts(found, warnings=False)


def test_black_and_white_pictures(tmp_path):
    _, pixels, _ = import_folder(tmp_path, [encoded(Image.fromarray(RAMP > 0.5))] * 2)
    assert set(np.unique(pixels[0]).tolist()) == {0, 255}


@pytest.mark.parametrize("value", range(1, 9))
def test_pixels_stay_as_the_sensor_gave_them(value, tmp_path):
    frames, pixels, found = import_folder(tmp_path, [oriented(value)] * 2, ".jpg")
    assert (frames.intrinsics.width == 16).all()
    with Image.open(io.BytesIO(oriented(1))) as stored:
        np.testing.assert_array_equal(pixels[0][..., 0], np.asarray(stored))
    is_said = "EXIF orientation: pixels are kept" in texts(found, warnings=False)
    assert is_said == (value != 1)
    images = tmp_path / "scene/recordings/pictures/images"
    # No viewer, and no other program, turns them.
    assert probe_image(images / "00.jpg").orientation == 1
    with Image.open(images / "00.jpg") as kept:
        assert kept.getexif()[0x010E] == "a phone"


@pytest.mark.parametrize("format", ["jpeg", "png"])
def test_orientation_of_images(format):
    for value in range(1, 9):
        assert probe_bytes(oriented(value, format)).orientation == value
    assert probe_bytes(oriented(9, format)).orientation == 1


@pytest.mark.parametrize(
    ("said", "value", "size"),
    [
        ((16, 12), 6, (16, 12)),
        ((12, 16), 6, (12, 16)),
        ((24, 32), 8, (12, 16)),
        ((12, 16), 5, (12, 16)),
        ((12, 16), 7, (12, 16)),
        ((12, 16), 3, (16, 12)),
        (None, 6, (16, 12)),
    ],
)
def test_the_intrinsics_decide_whether_an_orientation_counts(said, value, size):
    content = oriented(value, "png")
    picture = PictureReader().read(content, said)
    assert picture.size == size
    assert probe_bytes(picture.image)[:2] == size
    with Image.open(io.BytesIO(content)) as stored, Image.open(io.BytesIO(picture.image)) as kept:
        shown = ImageOps.exif_transpose(stored) if size[0] < size[1] else stored
        np.testing.assert_array_equal(np.asarray(kept), np.asarray(shown))


def test_upright_intrinsics_with_turned_pictures(tmp_path):
    source = make_nerfstudio(tmp_path / "capture")
    text = (source / "transforms.json").read_text()
    text = text.replace('"w": 16, "h": 12', '"w": 12, "h": 16').replace(
        '"cx": 8, "cy": 6', '"cx": 6, "cy": 8'
    )
    (source / "transforms.json").write_text(text)
    for path in (source / "images").iterdir():
        path.write_bytes(oriented(6))
    (found,) = read_walks(NERFSTUDIO, source)
    scene = write_recording(make_scene(tmp_path / "scene", 3), found)
    cameras = np.array(scene.recording("capture").frames.intrinsics)
    assert cameras[:, 0].tolist() == [12, 16, 20, 21, 6, 8]
    note = "images: 20 were turned as their EXIF orientation says, to fit the intrinsics"
    assert note in texts(found, warnings=False)


def test_what_follows_a_picture_is_cut_off(tmp_path):
    contents = [jpeg() + b"\0\0\0\x18ftypmp42" + bytes(range(256)) * 9, jpeg()]
    frames, _, found = import_folder(tmp_path, contents, ".jpg")
    assert frames.has_image.all()
    path = tmp_path / "scene/recordings/pictures/images/00.jpg"
    assert path.read_bytes() == jpeg()
    assert "1 have other data after their end" in texts(found, warnings=False)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "an empty file"),
        (jpeg()[:-20], "truncated"),
        (grey_16(RAMP)[:-20], "truncated"),
        (b"%PDF-1.4 this is no picture", "got something else"),
        (b"\0\0\0\x18ftypheic" + bytes(90), "got HEIC or AVIF: convert it to JPEG first"),
        (b"RIFF\x10\0\0\0WEBPVP8 ", "got WebP: convert it"),
        (b"II*\0" + bytes(50), "got TIFF: convert it"),
        (b"<html>not found</html>", "got something else"),
    ],
)
def test_what_is_no_picture_costs_its_frame_the_image(content, problem, tmp_path):
    frames, _, found = import_folder(tmp_path, [jpeg(), content, jpeg()], ".jpg")
    assert frames.has_image.tolist() == [True, False, True]
    warning = texts(found, warnings=True)
    assert "images: 1 are missing or broken, their frames have none: 01.jpg: " in warning
    assert problem in warning


def test_damage_within_a_16_bit_picture_costs_its_frame_the_image(tmp_path):
    content = bytearray(grey_16(np.random.default_rng(0).integers(0, 65535, (40, 40))))
    content[800:1200] = bytes(400)
    frames, _, found = import_folder(tmp_path, [grey_16(RAMP), bytes(content)])
    assert frames.has_image.tolist() == [True, False]
    assert "01.png: cannot be decoded" in texts(found, warnings=True)


def test_huge_pictures_name_the_limit_and_what_raises_it(tmp_path):
    small = encoded(Image.fromarray(COLOUR))
    huge = png(2000, 1500, 1, 0, bytes(100))
    frames, _, found = import_folder(tmp_path, [small, huge], max_megapixels=2.0)
    assert frames.has_image.tolist() == [True, False]
    warning = texts(found, warnings=True)
    assert "3 megapixels, and images up to 2 are imported" in warning
    assert "raise `max_megapixels`" in warning


@pytest.mark.slow
def test_pictures_larger_than_pillows_own_limit_are_read(tmp_path):
    path = tmp_path / "large.png"
    Image.new("1", (10_000, 10_000)).save(path)
    assert read_rgb(path, (4, 4)).shape == (4, 4, 3)
    path.write_bytes(png(25_000, 20_000, 1, 0, bytes(100)))
    with pytest.raises(FormatError, match=r"500 megapixels, and at most 400 are read"):
        read_rgb(path)


def test_limits_of_megapixels():
    with pytest.raises(ParameterError, match=r"max_megapixels: at most 400 can be read, got 500"):
        ImportOptions(max_megapixels=500)
    with pytest.raises(ParameterError, match=r"focal_px: expected a number above 0, got -3"):
        ImportOptions(focal_px=-3)


def test_links_where_nothing_is_to_be_done(tmp_path):
    contents = [encoded(Image.fromarray(COLOUR)), grey_16(RAMP * 4000)]
    frames, pixels, _ = import_folder(tmp_path, contents, link=True)
    images = tmp_path / "scene/recordings/pictures/images"
    assert (images / "00.png").stat().st_nlink == 2
    assert (images / "01.png").stat().st_nlink == 1
    assert frames.has_image.all()
    assert pixels[1].max() > 200


@pytest.mark.parametrize("link", [False, True])
def test_symbolic_links_are_followed(link, tmp_path):
    source = make_images(tmp_path / "s")
    real = (source / "images").rename(source / "real")
    (source / "images").mkdir()
    for path in sorted(real.iterdir()):
        (source / "images" / path.name).symlink_to(f"../real/{path.name}")
    (found,) = read_walks(IMAGES, source / "images", poses=source / "vio.tum")
    scene = write_recording(make_scene(tmp_path / "scene", 3), found, WriteSettings(link=link))
    assert not check_scene(scene.folder).errors
    image = scene.recording("images").image_path(4)
    assert not image.is_symlink()
    assert image.read_bytes() == jpeg(shade=4)
    assert scene.recording("images").frames.has_image.sum() == COUNT


@pytest.mark.parametrize("kind", range(6))
def test_damaged_pictures_are_named_and_never_raise(kind, tmp_path):
    """Bytes changed, cut and added at random: what is taken can be read, the rest has a problem."""
    contents = [
        jpeg(),
        grey_16(RAMP * 4000),
        oriented(6),
        oriented(6, "png"),
        encoded(Image.fromarray(COLOUR).convert("CMYK"), "jpeg"),
        encoded(Image.fromarray(COLOUR).quantize(20)),
    ]
    rng = np.random.default_rng(kind)
    taken = 0
    for _ in range(120):
        content = bytearray(contents[kind])
        for _ in range(int(rng.integers(1, 6))):
            content[int(rng.integers(len(content)))] = int(rng.integers(256))
        if rng.random() < 0.3:
            content = content[: int(rng.integers(len(content)))] + b"\xff\xd9"
        picture = PictureReader().read(bytes(content), (12, 16))
        assert (picture.image is None) == (picture.problem is not None)
        if picture.image is not None:
            probe = probe_bytes(picture.image)
            assert (probe.obstacle, (probe.width, probe.height)) == (None, picture.size)
            taken += 1
    assert 0 < taken < 120
