"""`vioapr train` and `vioapr predict` on a small scene: what they leave, and what they refuse."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
for package in ("safetensors", "lightning_fabric", "tensorboard"):
    pytest.importorskip(package, reason=f"{package} is not installed")

from safetensors.torch import save_file  # noqa: E402
from tests.regression.toy import make_scene, spec  # noqa: E402

from vioapr.formats.registry import read_trajectory  # noqa: E402
from vioapr.fusion.calibrated import read_calibration  # noqa: E402
from vioapr.regression.checkpoint import load_tensors, save_regressor  # noqa: E402
from vioapr.regression.networks import build  # noqa: E402
from vioapr.regression.networks.efficientnet_lite import EfficientNetLite0  # noqa: E402
from vioapr.regression.pretrained import has_pretrained, has_xfeat  # noqa: E402
from vioapr.scene.scene import Scene  # noqa: E402
from vioapr.schemas.regressor import RegressorHeader, StateHeader  # noqa: E402

SMALL = ("--model", "mobile", "--resize", 36, "--crop", 32, "--batch-size", 8, "--lr", 1e-3)
FRAMES = 12


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("scenes") / "box", train=2, test=2, frames=FRAMES)


@pytest.fixture
def scene(made, tmp_path):
    """A copy, that a test may spoil."""
    return Scene.open(shutil.copytree(made.folder, tmp_path / "box"))


@pytest.fixture(scope="module")
def regressor(tmp_path_factory):
    """A file of an untrained regressor, which predicts as well as any."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("regressor") / "regressor.safetensors"
    save_regressor(path, build(spec()), spec())
    return path


def weights_in(folder):
    return load_tensors(folder / "regressor.safetensors", RegressorHeader)[0]


def are_equal(one, other):
    mine, theirs = weights_in(one), weights_in(other)
    return mine.keys() == theirs.keys() and all(torch.equal(mine[k], theirs[k]) for k in mine)


def content_of(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_from_training_to_evaluation(run, scene, tmp_path):
    """As in the documentation, with the default folders."""
    code, out, err = run("train", scene.folder, *SMALL, "--epochs", 2, "--validation", "train-2")
    assert code == 0, err
    folder = scene.folder / "models" / "mobile"
    names = {path.name for path in folder.iterdir()}
    assert names == {
        "regressor.safetensors", "regressor.json", "MODEL_CARD.md", "state.safetensors",
        "state.json", "tensorboard",
    }  # fmt: skip
    assert (scene.folder / ".cache" / "images-36" / "train-1.npy").exists()
    assert "2 epochs" in out
    assert "on the validation recordings" in out
    # Without a terminal, a line an epoch says how it goes.
    told = [line for line in err.splitlines() if line.startswith("training: ")]
    assert [line.split(",")[0] for line in told] == [f"training: epoch {n} of 2" for n in (1, 2)]
    assert all(word in told[-1] for word in ("loss ", "validation ", " images/s", "ETA 0 s"))
    note = json.loads((folder / "regressor.json").read_text())
    assert note["trained"]["images"] == FRAMES
    assert note["spec"]["model"] == "mobile"
    code, out, err = run("predict", scene.folder, "--model", folder)
    assert code == 0, err
    walks = scene.folder / "walks" / "test"
    assert f"vioapr evaluate {walks}" in out
    for id_ in ("test-1", "test-2"):
        assert {path.name for path in (walks / id_).glob("[!.]*")} == {
            "apr_mobile.tum", "apr_mobile.sigma.csv", "gt.tum", "vio_arkit.tum",
        }  # fmt: skip
        poses = read_trajectory(walks / id_ / "apr_mobile.tum")
        np.testing.assert_allclose(poses.timestamp_s, 0.2 * np.arange(FRAMES))
        table = np.loadtxt(walks / id_ / "apr_mobile.sigma.csv", delimiter=",", skiprows=1)
        assert table.shape == (FRAMES, 3)
        assert (table[:, 1:] > 0).all()
    code, out, err = run("evaluate", walks, "--methods", "apr,vio-apr")
    assert code == 0, err
    assert "2 walks" in out


@pytest.mark.slow
def test_splits_names_and_folders_of_predictions(run, scene, regressor, tmp_path):
    arguments = ("predict", scene.folder, "--model", regressor, "--out", tmp_path / "out")
    assert run(*arguments, "--split", "all", "--name", "net")[0] == 0
    found = sorted(path.parent.name for path in (tmp_path / "out").rglob("apr_net.tum"))
    assert found == ["test-1", "test-2", "train-1", "train-2"]
    assert run(*arguments, "--split", "train", "--batch-size", 5)[0] == 0
    poses = [
        read_trajectory(tmp_path / "out" / "train-1" / f"apr_{name}.tum").position_m
        for name in ("net", "mobile")
    ]
    np.testing.assert_allclose(*poses, atol=1e-4)


@pytest.mark.slow
def test_recordings_without_ground_truth_or_vio(run, scene, regressor, tmp_path):
    scene.gt_path("test-1").unlink()
    code, out, err = run("predict", scene.folder, "--model", regressor, "--out", tmp_path / "out")
    assert code == 0, err
    assert {path.name for path in (tmp_path / "out" / "test-1").glob("[!.]*")} == {
        "apr_mobile.tum", "apr_mobile.sigma.csv", "vio_arkit.tum",
    }  # fmt: skip
    assert "vioapr evaluate" not in out


def test_a_scene_that_the_regressor_does_not_know(run, regressor, tmp_path):
    garden = make_scene(tmp_path / "garden", train=1, frames=2, name="Garden")
    code, out, err = run("predict", garden.folder, "--model", regressor)
    assert code == 0, err
    assert "note: 'Garden' is none of the scenes that this regressor knows: 'Box'" in out


@pytest.mark.slow
def test_a_scene_is_calibrated_with_a_model(run, fails, regressor, tmp_path):
    garden = make_scene(tmp_path / "garden", train=1, test=2, frames=40, name="Garden")
    out = tmp_path / "calibration.toml"
    words = ("calibrate", garden.folder, "--model", regressor, "--out", out)
    code, text, err = run(*words)
    assert code == 0, err
    (pair,) = read_calibration(out).pairs
    assert (pair.tracker, pair.regressor) == ("arkit", "mobile")
    assert pair.made_from.walks == ("test/test-1", "test/test-2")
    assert "arkit with mobile: 2 walks" in text
    # Predictions of before are kept; training recordings are used under protest.
    code, text, err = run(*words, "--overwrite", "--split", "train")
    assert code == 0, err
    assert "give others where you can" in " ".join(err.split())
    assert read_calibration(out).pairs[0].made_from.walks == ("train/train-1",)
    assert "expected train, test or all, got 'some'" in fails(
        *words, "--overwrite", "--split", "some"
    )


@pytest.mark.slow
def test_training_never_reads_test_recordings(run, made, scene, tmp_path):
    """Nor those held out: with their content spoilt, the same network comes out."""
    arguments = (*SMALL, "--epochs", 1, "--out")
    assert run("train", made.folder, *arguments, tmp_path / "whole")[0] == 0
    for id_ in ("test-1", "test-2"):
        for path in [*scene.recording_folder(id_).rglob("*"), scene.gt_path(id_)]:
            if path.is_file():
                path.write_bytes(b"spoilt")
    code, _, err = run("train", scene.folder, *arguments, tmp_path / "spoilt")
    assert code == 0, err
    assert are_equal(tmp_path / "whole", tmp_path / "spoilt")
    assert not list((scene.folder / ".cache").rglob("test-*"))


@pytest.mark.slow
def test_resuming_after_a_kill(run, scene, tmp_path):
    """Killed by the system, in the middle of an epoch or of writing a file."""
    arguments = ("train", scene.folder, *SMALL, "--epochs", 6, "--out")
    assert run(*arguments, tmp_path / "whole")[0] == 0
    out = tmp_path / "killed"
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", "vioapr", *map(str, (*arguments, out))]
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 120
        while not (out / "state.json").exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    done = len(load_tensors(out / "state.safetensors", StateHeader)[1].epochs)
    assert 1 <= done < 6
    code, text, err = run(*arguments, out, "--resume")
    assert code == 0, err
    assert "6 epochs" in text
    assert are_equal(tmp_path / "whole", out)


@pytest.mark.slow
def test_a_run_is_not_overwritten(run, fails, scene, tmp_path):
    arguments = ("train", scene.folder, *SMALL, "--epochs", 1, "--out", tmp_path / "run")
    assert run(*arguments)[0] == 0
    before = content_of(tmp_path / "run")
    assert "found state.safetensors: --resume goes on with it" in fails(*arguments)
    line = fails(*arguments, "--resume", "--epochs", 2)
    assert "same params: epochs 1 then, 2 now" in line
    line = fails(*arguments, "--resume", "--model", "posenet")
    assert "same spec: model mobile then, posenet now" in line
    assert content_of(tmp_path / "run") == before


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["missing", "broken"])
def test_an_image_that_cannot_be_read(fails, scene, regressor, tmp_path, damage):
    for id_ in ("train-2", "test-2"):
        path = scene.recording_folder(id_) / "images" / "003.png"
        if damage == "missing":
            path.unlink()
        else:
            path.write_bytes(path.read_bytes()[:200])
    expected = {
        "missing": "images/003.png: expected an image, found no file of this name",
        "broken": "images/003.png: expected an image that can be decoded",
    }[damage]
    assert expected in fails("train", scene.folder, *SMALL, "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()
    out = tmp_path / "out"
    assert expected in fails("predict", scene.folder, "--model", regressor, "--out", out)
    # The recording before the broken one is predicted, and nothing of the broken one.
    assert (out / "test-1" / "apr_mobile.tum").exists()
    assert not (out / "test-2").exists()


def test_weights_of_another_network(fails, scene, tmp_path):
    path = tmp_path / "weights.safetensors"
    weights = build(spec()).backbone.state_dict()
    weights["layer1.0.conv1.weight"] = weights.pop("features.0.0.weight")
    save_file(weights, path)
    line = fails("train", scene.folder, *SMALL, "--weights", path, "--out", tmp_path / "run")
    assert "weights.safetensors: expected weights of MobileNetV3Large" in line
    assert "1 missing (features.0.0.weight); 1 unknown (layer1.0.conv1.weight)" in line
    line = fails("train", scene.folder, *SMALL, "--weights", tmp_path / "none.pth")
    assert "none.pth: expected weights, found no file of this name" in line
    assert not (tmp_path / "run").exists()


def test_no_training_images(fails, scene, tmp_path):
    arguments = ("train", scene.folder, *SMALL, "--out", tmp_path / "run")
    line = fails(*arguments, "--validation", "train-1,train-2")
    assert "validation: expected to leave recordings to learn from, none is left" in line
    assert "'test-1': expected one of the split 'train'" in fails(
        *arguments, "--validation", "test-1"
    )
    scene.gt_path("train-1").unlink()
    assert "train-1.tum: expected ground truth, found none: run vioapr map" in fails(*arguments)
    for id_ in ("train-1", "train-2"):
        scene = scene.with_recording(id_, None)
    scene.save()
    line = fails(*arguments)
    assert "expected images with ground truth in the split 'train', found none" in line
    assert not (tmp_path / "run").exists()


def test_the_default_network_is_the_pretrained_one_where_it_is_installed(
    run, scene, tmp_path, monkeypatch
):
    """The stand-in for its weights is an untrained file: their package may be missing here."""
    from vioapr.cli import train as cli_train
    from vioapr.regression import run as regression_run

    torch.manual_seed(0)
    torch.save(EfficientNetLite0().state_dict(), tmp_path / "imagenet.pth")
    monkeypatch.setattr(regression_run, "find_pretrained", lambda _: tmp_path / "imagenet.pth")
    few = ("--resize", 32, "--crop", 32, "--batch-size", 8, "--epochs", 1)
    for is_installed, model in ((True, "efficientnet-lite0"), (False, "posenet")):
        monkeypatch.setattr(cli_train, "has_pretrained", lambda known=is_installed: known)
        code, out, err = run("train", scene.folder, *few)
        assert code == 0, err
        assert f"model: {model}" in out
        note = json.loads((scene.folder / "models" / model / "regressor.json").read_text())
        assert note["spec"]["model"] == model


def test_what_training_refuses(fails, scene, tmp_path):
    arguments = ("train", scene.folder, "--out", tmp_path / "run")
    line = fails(*arguments, "--model", "resnet")
    assert "unknown model 'resnet': expected one of posenet, ms-transformer, mobile" in line
    assert "expected 32 <= crop <= resize" in fails(*arguments, "--crop", 300)
    assert "lr: expected a number above 0, got 0" in fails(*arguments, "--lr", 0)
    line = fails(*arguments, "--loss", "l3")
    assert "--loss" in line
    assert "learnable-l2" in line
    line = fails("train", scene.folder, scene.folder, "--model", "ms-transformer")
    assert "expected scenes of different names, got Box, Box" in line
    assert "SCENE ...: expected at least one scene's folder, got none" in fails("train")
    assert "none: " in fails("train", tmp_path / "none")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_regressor_that_cannot_be_read(fails, scene, regressor, tmp_path):
    out = tmp_path / "out"

    def message(path):
        return fails("predict", scene.folder, "--model", path, "--out", out)

    assert "none: expected a vioapr regressor, found no file" in message(tmp_path / "none")
    half = tmp_path / "half.safetensors"
    half.write_bytes(regressor.read_bytes()[:100_000])
    assert "half.safetensors: expected a vioapr regressor; broken or half-written" in message(half)
    other = tmp_path / "other.safetensors"
    save_regressor(other, build(spec()), spec("posenet"))
    assert "other.safetensors: expected the weights of another network: " in message(other)
    assert "missing (backbone.bn1" in message(other)
    assert not out.exists()


def test_recordings_that_cannot_be_predicted(fails, scene, regressor):
    arguments = ("predict", scene.folder, "--model", regressor)
    line = fails(*arguments, "--split", "validation")
    assert "--split" in line
    assert "'validation'" in line
    for id_ in ("test-1", "test-2"):
        scene = scene.with_recording(id_, None)
    scene.save()
    assert "expected recordings in the split 'test', found none" in fails(*arguments)


def test_predictions_of_before_stay_where_new_ones_fail(run, fails, scene, regressor, tmp_path):
    arguments = ("predict", scene.folder, "--model", regressor, "--out", tmp_path / "out")
    assert run(*arguments)[0] == 0
    before = content_of(tmp_path / "out")
    (scene.recording_folder("test-1") / "images" / "000.png").unlink()
    assert "found no file of this name" in fails(*arguments)
    assert content_of(tmp_path / "out") == before


@pytest.mark.slow
def test_predictions_are_kept_and_another_models_are_not_replaced(
    run, fails, scene, regressor, tmp_path
):
    out = tmp_path / "out"
    arguments = ("predict", scene.folder, "--out", out, "--model")
    assert run(*arguments, regressor)[0] == 0
    before = content_of(out)
    path = out / "test-2" / "apr_mobile.tum"
    expected = path.read_bytes()
    path.unlink()  # as if it had been killed before the second recording
    code, text, err = run(*arguments, regressor)
    assert code == 0, err
    assert "test-1: predicted before by this model, kept" in text
    assert "test-2: predicted" not in text
    assert path.read_bytes() == expected
    torch.manual_seed(1)
    other = tmp_path / "other.safetensors"
    save_regressor(other, build(spec()), spec())
    line = fails(*arguments, other)
    assert "apr_mobile.tum: exists, by another model: choose another --name" in line
    assert "or give --overwrite" in line
    assert {k: v for k, v in content_of(out).items() if k in before}.keys() == before.keys()
    assert path.read_bytes() == expected
    assert run(*arguments, other, "--overwrite")[0] == 0
    assert path.read_bytes() != expected
    path.write_text("# mine\n")
    line = fails(*arguments, other)
    assert "apr_mobile.tum: exists, and vioapr did not write it" in line
    assert path.read_text() == "# mine\n"


@pytest.mark.slow
def test_ground_truth_beside_predictions_follows_the_scene_but_not_over_the_users(
    run, fails, scene, regressor, tmp_path
):
    out = tmp_path / "out"
    arguments = ("predict", scene.folder, "--out", out, "--model", regressor)
    assert run(*arguments)[0] == 0
    path = out / "test-1" / "gt.tum"
    gt = scene.gt("test-1")
    scene.write_gt("test-1", gt.at_rows(np.arange(5)))
    assert run(*arguments)[0] == 0
    assert len(read_trajectory(path)) == 5
    path.write_text("0 0 0 0 0 0 0 1\n")
    assert "gt.tum: exists, and vioapr did not write it" in fails(*arguments)
    assert path.read_text() == "0 0 0 0 0 0 0 1\n"


@pytest.mark.slow
@pytest.mark.parametrize("model", ["retrieval", "points"])
def test_fitted_models(model, run, fails, scene, tmp_path):
    if not (has_pretrained() and has_xfeat()):
        pytest.skip("the weights of the extra `points` are not installed")
    out = tmp_path / "fitted"
    words = ["train", scene.folder, "--model", model, "--out", out]
    code, text, err = run(*words)
    assert code == 0, err
    assert "fitted in" in text
    assert "exists: name another folder by --out" in fails(*words)
    walks = tmp_path / "walks"
    code, _, err = run("predict", scene.folder, "--model", out, "--out", walks, "--name", "net")
    assert code == 0, err
    assert len(read_trajectory(walks / "test-1" / "apr_net.tum")) == FRAMES
    assert "is not trained" in fails(*words[:-1], tmp_path / "other", "--epochs", 3)
    other = {"retrieval": "--map-mb", "points": "--index-mb"}[model]
    assert other in fails(*words[:-1], tmp_path / "other", other, 1)
