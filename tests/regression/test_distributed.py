"""Two processes learn what one learns from the same batches."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from tests.regression import training_script
from tests.regression.toy import make_scene
from torch import nn

from vioapr.cli import main
from vioapr.errors import ParameterError
from vioapr.regression.checkpoint import load, load_tensors
from vioapr.regression.distributed import SharedBatchNorm, synchronize_norms
from vioapr.regression.state import Journal
from vioapr.schemas.regressor import STATE_FILE, StateHeader

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
SETTINGS = ["--model", "mobile", "--resize", "36", "--crop", "32", "--dropout", "0"]
SETTINGS += ["--batch-size", "16", "--lr", "1e-3"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("scenes") / "box", train=2, frames=32)


def run_python(*arguments):
    """What a program of its own prints and returns; its processes must all have ended."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        env=environment, cwd=ROOT, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


def run_script(scene, out, model, devices, epochs, batch):
    arguments = [str(value) for value in (scene.folder, out, model, devices, epochs, batch)]
    if devices == 1:
        training_script.main(*arguments)
    else:
        done = run_python(training_script.__file__, *arguments)
        assert done.returncode == 0, done.stderr
    return load_tensors(out / STATE_FILE, StateHeader)


def flattened(tensors, ending):
    return torch.cat([value.flatten() for name, value in tensors.items() if name.endswith(ending)])


@pytest.mark.parametrize("model", ["mobile", "ms-transformer"])
def test_one_step(scene, tmp_path, model):
    """Equal gradients, which Adam's first mean is a tenth of, and statistics of the batch."""
    (one, said), (two, also_said) = (
        run_script(scene, tmp_path / str(devices), model, devices, epochs=1, batch=32)
        for devices in (1, 2)
    )
    assert said.epochs[0].loss == pytest.approx(also_said.epochs[0].loss, rel=1e-4)
    assert one.keys() == two.keys()
    gradients = [flattened(tensors, ".exp_avg") for tensors in (one, two)]
    torch.testing.assert_close(*gradients, rtol=0, atol=2e-3 * float(gradients[0].abs().max()))
    difference = torch.linalg.vector_norm(gradients[0] - gradients[1])
    assert difference < 3e-3 * torch.linalg.vector_norm(gradients[0])
    for ending in (".running_mean", ".running_var"):
        torch.testing.assert_close(
            flattened(one, ending), flattened(two, ending), rtol=1e-3, atol=1e-5
        )


def test_several_epochs_and_what_is_kept(scene, tmp_path):
    """The last one is of positions alone."""
    (_, one), (_, two) = (
        run_script(scene, tmp_path / str(devices), "mobile", devices, epochs="2+1", batch=16)
        for devices in (1, 2)
    )
    assert len(one.epochs) == len(two.epochs) == 3
    for mine, theirs in zip(one.epochs, two.epochs, strict=True):
        assert mine.loss == pytest.approx(theirs.loss, rel=0.02)
        assert mine.validation_score == pytest.approx(theirs.validation_score, rel=0.02)
    images = torch.randn(4, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    found = [load(tmp_path / name).network(images).position_m for name in "12"]
    torch.testing.assert_close(*found, rtol=0, atol=0.02)


def test_the_command_line(scene, tmp_path, monkeypatch):
    """Also going on with two processes where one was stopped."""
    common = ["train", str(scene.folder), *SETTINGS, "--epochs", "2"]
    assert main([*common, "--out", str(tmp_path / "one")]) == 0
    monkeypatch.setattr(Journal, "add", stop_after_one_epoch(Journal.add))
    assert main([*common, "--out", str(tmp_path / "stopped")]) == 130
    for name, flags in (("two", []), ("stopped", ["--resume"])):
        out = tmp_path / name
        done = run_python("-m", "vioapr", *common, "--out", out, "--devices", "2", *flags)
        assert done.returncode == 0, done.stderr
        # Only the first process speaks.
        assert done.stdout.count("regressor: ") == 1
    one, *others = (
        load_tensors(tmp_path / name / STATE_FILE, StateHeader)[1].epochs
        for name in ("one", "two", "stopped")
    )
    losses = [pytest.approx(record.loss, rel=0.02) for record in one]
    assert [[record.loss for record in epochs] for epochs in others] == [losses, losses]


def stop_after_one_epoch(original):
    def add(journal, record):
        if journal.epochs:
            raise KeyboardInterrupt
        original(journal, record)

    return add


def test_all_processes_end_where_one_fails(scene, tmp_path):
    (tmp_path / "run" / "regressor.safetensors").mkdir(parents=True)
    done = run_python(
        "-m", "vioapr", "train", scene.folder, *SETTINGS, "--epochs", "2", "--devices", "2",
        "--out", tmp_path / "run",
    )  # fmt: skip
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert "expected a folder without a regressor, found regressor.safetensors" in lines[0]
    assert "Traceback" not in done.stderr


def test_norms_of_a_kind_of_their_own_are_refused():
    class NormWithActivation(nn.BatchNorm2d):
        pass

    class TwoProcesses:
        world_size, device = 2, torch.device("cpu")

    with pytest.raises(ParameterError, match="expected 1 for a network with NormWithActivation"):
        synchronize_norms(nn.Sequential(NormWithActivation(3)), TwoProcesses())


def test_norms_keep_their_parameters():
    """An optimizer that was made before must go on changing them."""

    class TwoProcesses:
        world_size, device = 2, torch.device("cpu")

    network = nn.Sequential(nn.Conv2d(3, 3, 1), nn.BatchNorm2d(3), nn.BatchNorm2d(3))
    network[2].weight.requires_grad_(False)
    before = dict(network.named_parameters())
    synchronize_norms(network, TwoProcesses())
    after = dict(network.named_parameters())
    assert all(after[name] is value for name, value in before.items())
    assert type(network[1]).__name__ == "SharedBatchNorm"


@pytest.fixture
def alone():
    """This process as the only one of a group."""
    store = torch.distributed.HashStore()
    torch.distributed.init_process_group("gloo", store=store, rank=0, world_size=1)
    yield
    torch.distributed.destroy_process_group()


def test_pytorchs_own_shared_norm_is_not_for_cpus(alone):
    """If this fails, PyTorch's serves: SharedBatchNorm can go."""
    with pytest.raises(ValueError, match="expected input tensor to be on GPU"):
        nn.SyncBatchNorm(5)(torch.zeros(6, 5, 4, 3))


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_shared_norm_is_pytorchs_in_mixed_precision_too(alone, dtype):
    torch.manual_seed(0)
    images = (2 * torch.randn(6, 5, 4, 3) + 1).to(dtype)
    own, theirs = SharedBatchNorm(5), nn.BatchNorm2d(5)
    found, expected = own(images), theirs(images)
    assert found.dtype == dtype
    torch.testing.assert_close(found, expected)
    torch.testing.assert_close(own.running_mean, theirs.running_mean)
    torch.testing.assert_close(own.running_var, theirs.running_var)
