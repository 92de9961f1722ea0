"""Regressors on disk: equal after loading, and clear about what is wrong."""

import json

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from tests.regression.toy import spec

from vioapr.errors import DiskFullError, FileMissingError, FormatError, VersionError
from vioapr.regression import checkpoint
from vioapr.regression.checkpoint import load, load_backbone_weights, save_regressor
from vioapr.regression.networks import build
from vioapr.regression.networks.mobilenet import MobileNetV3Large
from vioapr.schemas.regressor import RegressorHeader, RunIdentity, StateHeader, Trained


@pytest.fixture
def saved(tmp_path):
    torch.manual_seed(0)
    network = build(spec())
    network.set_unit(0, torch.tensor([1.0, 2.0, 3.0]), 4.0)
    path = tmp_path / "run" / "regressor.safetensors"
    save_regressor(path, network, spec(), Trained(epoch=3))
    return path, network


def test_saved_and_loaded(saved):
    path, network = saved
    for given in (path, path.parent):
        loaded = load(given)
        assert loaded.spec == spec()
        assert loaded.trained == Trained(epoch=3)
        assert not loaded.network.training
        images = torch.randn(2, 3, 32, 32)
        for mine, theirs in zip(loaded.network(images), network.eval()(images), strict=True):
            assert torch.equal(mine, theirs)


def test_a_note_for_people(saved):
    note = json.loads(saved[0].with_suffix(".json").read_text())
    assert note["format"] == "vioapr regressor"
    assert note["spec"]["scenes"] == ["Box"]


@pytest.mark.slow
@pytest.mark.parametrize("kept", [0, 4, 100, 0.5, 0.99])
def test_half_written(saved, kept):
    path, _ = saved
    content = path.read_bytes()
    size = kept if isinstance(kept, int) else int(kept * len(content))
    path.write_bytes(content[:size])
    with pytest.raises(FormatError, match="expected a vioapr regressor; broken or half-written"):
        load(path)


def test_something_else(saved, tmp_path):
    path, _ = saved
    with pytest.raises(FileMissingError, match="found no file of this name"):
        load(tmp_path / "none.safetensors")
    save_file({"a": torch.zeros(1)}, path)
    with pytest.raises(FormatError, match="got other safetensors"):
        load(path)
    run = RunIdentity(spec=spec(), params={}, samples="")
    checkpoint.save_tensors(path, {}, StateHeader(run=run))
    expected = 'expected "format": "vioapr regressor", got .vioapr training state.'
    with pytest.raises(FormatError, match=expected):
        load(path)


OLD_HEADER = {
    "format": "vioapr regressor",
    "version": 1,
    "spec": {"model": "mobile", "scenes": ["Box"], "rotation": "6d", "resize": 36, "crop": 32,
             "dropout": None, "orientation_layers": 6},
    "trained": {
        "epoch": 2,
        "params": {"epochs": 2, "augmentation": {"jitter": 0.5}},
        "last_epoch": {"loss": 3.5, "lr": 0.001, "images_per_s": 25.3, "validation_score": 2.75},
        "images": 32,
    },
}  # fmt: skip
"""As regressors have it that were written before headers were typed."""


def test_the_header_of_an_older_file_is_read_and_written_the_same(saved):
    path, network = saved
    tensors = {name: value.clone() for name, value in network.state_dict().items()}
    save_file(tensors, path, metadata={"vioapr": json.dumps(OLD_HEADER)})
    loaded = load(path)
    assert loaded.spec == spec()
    assert loaded.trained.last_epoch.validation_score == 2.75
    save_regressor(path, network, loaded.spec, loaded.trained)
    with safe_open(path, framework="pt") as file:
        assert json.loads(file.metadata()["vioapr"]) == OLD_HEADER
    assert json.loads(path.with_suffix(".json").read_text()) == OLD_HEADER


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"spec": {"model": "mobile"}}, "spec: expected a member 'scenes', found none"),
        ({"spec": {"model": "mobile", "scenes": []}}, "specification: scenes: expected at least"),
        ({"spec": {"model": "net", "scenes": ["A"]}}, "specification: unknown model 'net'"),
        ({"spec": {"model": "mobile", "scenes": ["A"], "crop": "wide"}}, "spec.crop: expected"),
        (
            {"trained": {"epoch": "two"}},
            "trained.epoch: expected a whole number or nothing, got 'two'",
        ),
    ],
)
def test_a_broken_header_says_which_member(saved, change, expected):
    path, _ = saved
    save_file({"a": torch.zeros(1)}, path, metadata={"vioapr": json.dumps(OLD_HEADER | change)})
    with pytest.raises(FormatError) as caught:
        load(path)
    assert expected in str(caught.value)


def test_weights_that_do_not_fit_their_specification(saved):
    path, network = saved
    save_regressor(path, network, spec("posenet"))
    with pytest.raises(FormatError, match=r"another network: \d+ missing \(backbone\.bn1"):
        load(path)


def test_a_newer_version(saved, monkeypatch):
    path, network = saved
    monkeypatch.setattr(RegressorHeader, "VERSION", 2)
    save_regressor(path, network, spec())
    monkeypatch.undo()
    with pytest.raises(VersionError, match="expected version 1, got 2: a newer vioapr's"):
        load(path)


def test_a_full_disk_spares_what_was_there(saved, monkeypatch):
    path, network = saved
    before = path.read_bytes()

    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint, "save_file", fail)
    with pytest.raises(DiskFullError, match="cannot be written: .*No space left"):
        save_regressor(path, network, spec(), Trained(epoch=4))
    assert path.read_bytes() == before
    assert load(path).trained == Trained(epoch=3)


def imagenet_weights():
    """As torchvision publishes them: with a classifier."""
    torch.manual_seed(9)
    weights = MobileNetV3Large().state_dict()
    return weights | {"classifier.0.weight": torch.zeros(1280, 960)}


@pytest.mark.slow
@pytest.mark.parametrize("form", ["pth", "nested", "safetensors", "old"])
def test_pretrained_weights_of_a_backbone(tmp_path, form):
    weights = imagenet_weights()
    path = tmp_path / ("w.safetensors" if form == "safetensors" else "w.pth")
    if form == "safetensors":
        save_file(weights, path)
    else:
        if form == "old":  # before PyTorch 0.4.1 batches were not counted
            weights = {k: v for k, v in weights.items() if "num_batches" not in k}
        torch.save({"state_dict": weights} if form == "nested" else weights, path)
    network = build(spec())
    load_backbone_weights(network, path)
    own = network.backbone.state_dict()
    assert all(torch.equal(own[k], v) for k, v in weights.items() if k in own)


def test_wrong_weights_say_which_keys(tmp_path):
    path = tmp_path / "w.pth"
    weights = imagenet_weights()
    del weights["features.0.0.weight"]
    weights["layer1.0.conv1.weight"] = torch.zeros(1)
    weights["features.1.block.0.0.weight"] = torch.zeros(3, 3)
    torch.save(weights, path)
    with pytest.raises(FormatError) as caught:
        load_backbone_weights(build(spec()), path)
    text = str(caught.value)
    assert "expected weights of MobileNetV3Large" in text
    assert "1 missing (features.0.0.weight)" in text
    assert "1 unknown (layer1.0.conv1.weight)" in text
    assert "features.1.block.0.0.weight (3, 3) instead of (16, 1, 3, 3)" in text


def test_broken_weights(tmp_path):
    path = tmp_path / "w.pth"
    torch.save(imagenet_weights(), path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(FormatError, match="broken, or cut off"):
        load_backbone_weights(build(spec()), path)
    torch.save([1, 2], path)
    with pytest.raises(FormatError, match="expected a state_dict"):
        load_backbone_weights(build(spec()), path)
    with pytest.raises(FileMissingError, match="found no file"):
        load_backbone_weights(build(spec()), tmp_path / "none.pth")
