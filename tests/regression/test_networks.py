"""Sizes and names of the networks, and what they do in evaluation."""

import sys
import types

import pytest
import torch
from tests.regression.toy import spec

from vioapr.errors import MissingExtraError, ParameterError
from vioapr.regression.networks import build, timm_backbone
from vioapr.regression.networks.blocks import InvertedResidual
from vioapr.regression.networks.efficientnet import EfficientNetB0
from vioapr.regression.networks.mobilenet import MobileNetV3Large
from vioapr.regression.networks.resnet import ResNet34
from vioapr.schemas.regressor import RegressorSpec


def count(module):
    return sum(parameter.numel() for parameter in module.parameters())


@pytest.mark.slow
def test_parameter_counts_of_the_paper():
    posenet = build(RegressorSpec("posenet", ("a",)))
    assert round(count(posenet) / 1e6, 2) == 22.35
    # Stored; stages of EfficientNet-B0 that MS-Transformer does not use are not trained.
    ms_transformer = build(RegressorSpec("ms-transformer", ("a", "b")))
    assert round(count(ms_transformer) / 1e6) == 17
    trained = sum(p.numel() for p in ms_transformer.parameters() if p.requires_grad)
    assert round(trained / 1e6) == 14


@pytest.mark.parametrize(
    ("backbone", "parameters", "classifier", "names"),
    [
        # torchvision's counts, which include a classifier of 1000 classes.
        (ResNet34, 21_797_672, 512 * 1000 + 1000, 216),
        (EfficientNetB0, 5_288_548, 1280 * 1000 + 1000, 358),
        (MobileNetV3Large, 5_483_032, 960 * 1280 + 1280 + 1280 * 1000 + 1000, 308),
    ],
)
def test_backbones_are_those_of_torchvision(backbone, parameters, classifier, names):
    network = backbone()
    assert count(network) == parameters - classifier
    assert len(network.state_dict()) == names
    assert network(torch.zeros(1, 3, 64, 64)).shape == (1, backbone.CHANNELS, 2, 2)


@pytest.mark.parametrize(
    ("backbone", "name", "shape"),
    [
        (ResNet34, "layer3.0.downsample.0.weight", (256, 128, 1, 1)),
        (EfficientNetB0, "features.3.1.block.2.fc1.weight", (10, 240, 1, 1)),
        (MobileNetV3Large, "features.11.block.2.fc2.weight", (480, 120, 1, 1)),
    ],
)
def test_names_of_weights_are_those_of_torchvision(backbone, name, shape):
    assert tuple(backbone().state_dict()[name].shape) == shape


def test_inverted_residuals_pass_their_input_on_at_first():
    features = torch.rand(2, 16, 8, 8)
    inverted = InvertedResidual(16, 64, 16, 3, 1, torch.nn.ReLU, None).eval()
    narrowing = InvertedResidual(16, 64, 16, 3, 2, torch.nn.ReLU, None).eval()
    torch.testing.assert_close(inverted(features), features)
    assert narrowing(features).abs().max() > 0


def test_maps_of_ms_transformer_have_the_papers_sizes():
    fine, coarse = EfficientNetB0().eval().forward_maps(torch.zeros(1, 3, 224, 224))
    assert fine.shape == (1, 40, 28, 28)
    assert coarse.shape == (1, 112, 14, 14)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["posenet", "mobile", "ms-transformer"])
@pytest.mark.parametrize("rotation", ["log-quat", "quat", "6d"])
def test_predictions_are_poses(model, rotation):
    torch.manual_seed(0)
    network = build(spec(model, rotation=rotation)).eval()
    network.set_unit(0, torch.tensor([100.0, 0.0, 0.0]), 2.0)
    with torch.inference_mode():
        prediction = network(torch.randn(3, 3, 32, 32))
    assert prediction.position_m.shape == (3, 3)
    assert (prediction.position_m[:, 0] > 50).all()
    norms = torch.linalg.vector_norm(prediction.quat_xyzw, dim=-1)
    torch.testing.assert_close(norms, torch.ones(3))
    assert (prediction.sigma_position_m > 0).all()
    assert (prediction.sigma_orientation_rad > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("model", ["posenet", "mobile", "ms-transformer"])
def test_dropout_works_in_training_only(model):
    """In geomapnet's PoseNet it worked at test time, too."""
    torch.manual_seed(0)
    network = build(spec(model, dropout=0.5))
    images = torch.randn(4, 3, 32, 32)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.momentum = 0.0  # so that only dropout can make a difference
    network.train()
    assert not torch.equal(
        network.forward_raw(images).position, network.forward_raw(images).position
    )
    network.eval()
    first, second = (network.forward_raw(images) for _ in range(2))
    assert torch.equal(first.position, second.position)
    assert torch.equal(first.rotation, second.rotation)


def test_ms_transformer_answers_for_the_scene_that_it_sees():
    torch.manual_seed(0)
    network = build(spec("ms-transformer", scenes=("a", "b"))).eval()
    network.set_unit(0, torch.tensor([1000.0, 0.0, 0.0]), 1.0)
    network.set_unit(1, torch.tensor([-1000.0, 0.0, 0.0]), 1.0)
    images = torch.randn(2, 3, 32, 32)
    raw = network.forward_raw(images)
    seen = raw.scene_logits.argmax(dim=-1)
    x = network.to_prediction(raw).position_m[:, 0]
    assert ((x > 0) == (seen == 0)).all()
    for scene in (0, 1):  # in training, the true one counts
        chosen = network.forward_raw(images, torch.full((2,), scene))
        assert torch.equal(chosen.position, raw.position) == bool((seen == scene).all())


def test_one_model_a_scene_but_for_ms_transformer():
    with pytest.raises(ParameterError, match="learns one scene, got 2"):
        build(spec("posenet", scenes=("a", "b")))


def test_unknown_names():
    with pytest.raises(ParameterError, match="expected one of posenet, ms-transformer, mobile"):
        build(spec("resnet"))
    with pytest.raises(ParameterError, match="expected one of log-quat, quat, 6d, got 'euler'"):
        build(spec(rotation="euler"))


def test_timm_is_asked_for_where_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "timm", None)
    with pytest.raises((MissingExtraError, ParameterError), match="timm"):
        build(spec("timm:resnet18"))


def test_any_backbone_of_timm(monkeypatch):
    """timm itself needs a torchvision that fits: here is one with its interface."""

    class Tokens(torch.nn.Module):
        num_features = 12

        def forward(self, images):
            return images.new_ones(len(images), 5, self.num_features)

    def create_model(name, **options):
        if name != "vit_tiny":
            raise RuntimeError(f"Unknown model ({name})")
        assert options == {"pretrained": False, "num_classes": 0, "global_pool": ""}
        return Tokens()

    monkeypatch.setitem(sys.modules, "timm", types.SimpleNamespace(create_model=create_model))
    network = build(spec("timm:vit_tiny")).eval()
    assert network(torch.zeros(2, 3, 32, 32)).position_m.shape == (2, 3)
    assert isinstance(network.backbone, timm_backbone.TimmBackbone)
    with pytest.raises(ParameterError, match="timm:none: Unknown model"):
        build(spec("timm:none"))
