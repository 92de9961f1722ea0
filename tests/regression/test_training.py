"""The training loop: it learns, resumes bit-equal, and says what went wrong."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tests.regression.toy import make_scene, params, spec

from vioapr.errors import FileMissingError, FormatError, ParameterError, TrainingError
from vioapr.geometry import quaternion
from vioapr.regression import training
from vioapr.regression.augmentation import middle_crop
from vioapr.regression.batches import Batch, BatchSource, epoch_order
from vioapr.regression.checkpoint import load, load_tensors, save_tensors
from vioapr.regression.data import load_samples, split_frames
from vioapr.regression.losses import Learner
from vioapr.regression.networks import build
from vioapr.regression.params import AugmentationParams, LossParams, PositionStageParams
from vioapr.regression.run import Run, set_units
from vioapr.regression.training import train
from vioapr.schemas.regressor import STATE_FILE, StateHeader


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("scenes") / "box", train=2, frames=32)


@pytest.fixture(scope="module")
def samples(scene):
    first, second = split_frames([scene], "train")
    return load_samples([scene], [first], 36), load_samples([scene], [second], 36)


@pytest.fixture
def make_run(samples, tmp_path):
    def make(name="run", model="mobile", validates=True, **values):
        run_spec = spec(model, **values.pop("spec", {}))
        run_params = params(**values)
        torch.manual_seed(run_params.seed)
        network = build(run_spec)
        set_units(network, samples[0])
        checked = samples[1] if validates else None
        return Run(run_spec, network, samples[0], checked, tmp_path / name, run_params)

    return make


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "loss", "lr", "steps"),
    [
        ("posenet", "learnable", 1e-4, 40),
        ("mobile", "learnable", 1e-3, 80),
        ("mobile", "geometric", 1e-3, 80),
        ("ms-transformer", "learnable-l2", 1e-4, 40),
    ],
)
def test_every_model_can_learn_one_batch_by_heart(samples, model, loss, lr, steps):
    torch.manual_seed(0)
    chosen = np.arange(8)
    network = build(spec(model, dropout=0.0))
    set_units(network, samples[0])
    learner = Learner(network, LossParams(loss=loss))
    optimizer = torch.optim.Adam([p for p in learner.parameters() if p.requires_grad], lr=lr)
    position_m = torch.as_tensor(samples[0].position_m[chosen], dtype=torch.float32)
    quat = torch.as_tensor(samples[0].quat_xyzw[chosen], dtype=torch.float32)
    images = middle_crop(torch.from_numpy(samples[0].read(chosen)), 32)
    batch = Batch(images, position_m, quat, torch.zeros(8, dtype=torch.int64))
    for step in range(steps):
        optimizer.param_groups[0]["lr"] = lr * (1 - step / steps)
        optimizer.zero_grad()
        learner(batch).backward()
        optimizer.step()
    found = network.to_prediction(network.forward_raw(images))
    off_m = torch.linalg.vector_norm(found.position_m - position_m, dim=-1)
    spread_m = torch.linalg.vector_norm(position_m - position_m.mean(dim=0), dim=-1)
    assert off_m.median() < 0.15 * spread_m.median()
    assert quaternion.angle_between_deg(found.quat_xyzw, quat).median() < 3


def weights_of(run):
    return load_tensors(run.folder / STATE_FILE, StateHeader)[0]


@pytest.mark.slow
@pytest.mark.parametrize(("epochs", "stopped_at"), [(3, 1), (3, 3), (3, 5), (1, 3), (1, 5)])
def test_a_killed_run_goes_on_as_if_it_had_not_been(make_run, epochs, stopped_at):
    """Also between its two stages, and in the second one."""
    values = {"epochs": epochs, "position_stage": PositionStageParams(3 - epochs)}
    whole = make_run("whole", **values, spec={"dropout": 0.5})
    train(whole)
    killed = make_run("killed", **values, spec={"dropout": 0.5})
    steps = []

    def tick():
        steps.append(1)
        if len(steps) == stopped_at:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(killed._replace(tick=tick))
    has_state = (killed.folder / STATE_FILE).exists()
    assert has_state == (stopped_at > 2)
    again = make_run("killed", **values, spec={"dropout": 0.5})
    journal = train(again, resume=has_state)
    expected, found = weights_of(whole), weights_of(again)
    assert expected.keys() == found.keys()
    assert all(torch.equal(expected[name], found[name]) for name in expected)
    assert len(journal.epochs) == 3
    mine, theirs = (load(run.folder).network.state_dict() for run in (whole, again))
    assert all(torch.equal(mine[name], theirs[name]) for name in mine)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["mobile", "ms-transformer"])
def test_the_second_stage_teaches_positions_alone(make_run, model):
    states = []
    for second in (0, 2):
        run = make_run(
            f"{second}", model, epochs=1, position_stage=PositionStageParams(second),
            loss=LossParams("learnable-l2"), schedule="step", eps=1e-10,
        )  # fmt: skip
        epochs = train(run).epochs
        states.append(weights_of(run))
    before, after = (
        {name: value for name, value in state.items() if name.startswith("learner.")}
        for state in states
    )
    changed = {name for name in before if not torch.equal(before[name], after[name])}
    heads = {"heads.position", "heads.log_sigma"}
    if model == "ms-transformer":
        heads = {"position_head.0", "position_head.2", "log_sigma"}
    assert changed == {
        f"learner.network.{head}.{part}" for head in heads for part in ("weight", "bias")
    }
    # Its loss is of the position alone, and its learning rate begins again.
    assert epochs[2].loss < epochs[1].loss
    assert [record.lr for record in epochs] == pytest.approx([1e-4, 1e-3, 1e-5])


@pytest.mark.slow
def test_a_state_from_before_there_were_two_stages(make_run):
    run = make_run(epochs=1)
    train(run)
    path = run.folder / STATE_FILE
    tensors, header = load_tensors(path, StateHeader)
    for name in ("eps", "position_stage"):
        del header.run.params[name]
    save_tensors(path, tensors, header)
    assert len(train(make_run(epochs=1), resume=True).epochs) == 1
    with pytest.raises(ParameterError, match="same params: eps 1e-08 then, 1e-10 now"):
        train(make_run(epochs=1, eps=1e-10), resume=True)


@pytest.mark.slow
def test_the_seed_decides(make_run):
    runs = [make_run(f"run-{k}", epochs=1, seed=seed) for k, seed in enumerate((1, 1, 2))]
    for run in runs:
        train(run)
    first, second, other = (weights_of(run) for run in runs)
    name = "learner.network.heads.position.weight"
    assert all(torch.equal(first[key], second[key]) for key in first)
    assert not torch.equal(first[name], other[name])


@pytest.mark.slow
def test_the_best_epoch_is_kept(make_run, monkeypatch):
    scores = iter([3.0, 1.0, 2.0])
    factors = {"sigma_position": 2.0, "sigma_orientation": 3.0}

    def validate(*_):
        return {"score": next(scores), "position_m": 1.0, "orientation_deg": 1.0, **factors}

    monkeypatch.setattr(training, "validate", validate)
    run = make_run(epochs=3)
    assert train(run).best == 1
    loaded = load(run.folder)
    assert loaded.trained.epoch == 2
    # Stated uncertainties grow by what validation found; training goes on without.
    expected = 2**0.5 * torch.tensor([2.0, 3.0])
    torch.testing.assert_close(loaded.network.sigma_scale, expected)
    torch.testing.assert_close(run.network.sigma_scale, torch.full((2,), 2**0.5))


@pytest.mark.slow
def test_without_validation_the_last_epoch_is_kept(make_run):
    run = make_run(validates=False, epochs=2)
    train(run)
    assert load(run.folder).trained.epoch == 2


@pytest.mark.slow
def test_patience(make_run, monkeypatch):
    scores = iter([1.0, 2.0, 3.0, 4.0, 5.0])
    factors = dict.fromkeys(
        ("sigma_position", "sigma_orientation", "position_m", "orientation_deg"), 1.0
    )
    monkeypatch.setattr(training, "validate", lambda *_: {"score": next(scores), **factors})
    assert len(train(make_run(epochs=5, patience=2)).epochs) == 3


@pytest.mark.slow
def test_a_loss_that_is_no_number(make_run, monkeypatch):
    run = make_run(epochs=3)
    steps = []
    original = Learner.forward

    def forward(learner, batch):
        steps.append(1)
        loss = original(learner, batch)
        return loss * float("nan") if len(steps) == 4 else loss

    monkeypatch.setattr(Learner, "forward", forward)
    with pytest.raises(TrainingError, match=r"epoch 2, step 2: try a lower `lr` than 0\.001"):
        train(run)
    # What the first epoch left is whole, and training can go on from it.
    monkeypatch.undo()
    assert len(train(make_run(epochs=3), resume=True).epochs) == 3


@pytest.mark.slow
def test_changed_images_are_not_resumed_with(make_run):
    run = make_run(epochs=1)
    train(run)
    changed = run._replace(samples=dataclasses.replace(run.samples, fingerprint="other"))
    with pytest.raises(ParameterError, match="images and poses, they have changed"):
        train(changed, resume=True)


def test_out_of_memory(make_run, monkeypatch):
    def forward(*_):
        raise RuntimeError("DefaultCPUAllocator: not enough memory: you tried to allocate 9 bytes")

    monkeypatch.setattr(Learner, "forward", forward)
    with pytest.raises(TrainingError, match="batch of 16 images of 32 pixels: try `batch_size` 8"):
        train(make_run())


@pytest.mark.slow
def test_runs_are_not_overwritten_or_mixed(make_run):
    run = make_run(epochs=1)
    with pytest.raises(FileMissingError, match="to resume, found none"):
        train(run, resume=True)
    train(run)
    with pytest.raises(ParameterError, match="`resume` goes on with it"):
        train(make_run(epochs=1))
    with pytest.raises(ParameterError, match="same params: lr 0.001 then, 0.01 now"):
        train(make_run(epochs=1, lr=0.01), resume=True)
    with pytest.raises(ParameterError, match="same spec: model mobile then, posenet now"):
        train(make_run(epochs=1, model="posenet"), resume=True)
    (run.folder / STATE_FILE).write_bytes(b"half")
    with pytest.raises(FormatError, match="broken or half-written"):
        train(make_run(epochs=1), resume=True)


def test_turns_need_intrinsics(make_run, samples):
    unknown = dataclasses.replace(samples[0], camera=samples[0].camera * np.nan)
    run = make_run(augmentation=AugmentationParams(turn_deg=5))._replace(samples=unknown)
    with pytest.raises(TrainingError, match="expected known intrinsics"):
        train(run)


def test_more_devices_than_images(make_run):
    with pytest.raises(ParameterError, match="devices: expected at most 32, the training images"):
        train(make_run(devices=64, batch_size=64))


@pytest.mark.slow
def test_images_a_second_are_those_that_there_were(make_run, monkeypatch):
    """Fewer than a batch."""
    clock = iter([10.0, 14.0])
    monkeypatch.setattr(training, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    (record,) = train(make_run(epochs=1, batch_size=64)).epochs
    assert record.images_per_s == 32 / 4


@pytest.mark.slow
def test_tensorboard_logs_are_written(make_run):
    run = make_run(epochs=1)
    train(run)
    assert list((run.folder / "tensorboard").glob("events.out.tfevents*"))


def test_every_image_comes_at_most_once_an_epoch():
    batches = epoch_order(20, 8, seed=1, epoch=0)
    assert [len(batch) for batch in batches] == [8, 8]
    assert len(np.unique(np.concatenate(batches))) == 16
    assert not np.array_equal(batches[0], epoch_order(20, 8, seed=1, epoch=1)[0])
    assert [len(batch) for batch in epoch_order(5, 8, seed=1, epoch=0)] == [5]


def test_processes_share_a_batch(samples):
    """Two halves, drawn by two processes, are the batch that one process draws."""
    sources = [
        BatchSource(samples[0], 32, AugmentationParams(), 16, 5, torch.device("cpu"), part)
        for part in ((0, 1), (0, 2), (1, 2))
    ]
    whole, *halves = (next(iter(source.epoch(2))) for source in sources)
    for mine, first, second in zip(whole, *halves, strict=True):
        assert torch.equal(mine, torch.cat([first, second]))


@pytest.mark.parametrize(
    ("schedule", "rates"),
    [
        ("constant", [1.0, 1.0, 1.0, 1.0]),
        ("step", [1.0, 0.1, 0.01, 0.01]),
        ("cosine", [0.1, 0.7961, 0.2742, 0.0]),
    ],
)
def test_schedules(schedule, rates):
    """At the beginning, after a third, two thirds, and at the very end."""
    run = params(lr=1.0, schedule=schedule)
    found = [run.lr_at(step, 300) for step in (0, 100, 200, 299.99)]
    np.testing.assert_allclose(found, rates, atol=2e-4)


def test_odd_parameters():
    for values, text in (
        ({"epochs": 0}, "epochs: expected at least 1"),
        ({"lr": 0.0}, "lr: expected a number above 0"),
        ({"batch_size": 15, "devices": 2}, "multiple of the 2 devices"),
        ({"eps": 0.0}, "eps: expected above 0"),
        (
            {"patience": 2, "position_stage": PositionStageParams(1)},
            "patience: expected 0 where there are position_epochs",
        ),
    ):
        with pytest.raises(ParameterError, match=text):
            params(**values)
    with pytest.raises(ParameterError, match="position_epochs: expected at least 0, got -1"):
        PositionStageParams(-1)
    with pytest.raises(ParameterError, match="position_hue: expected 0 to 0.5, got 0.6"):
        PositionStageParams(1, position_hue=0.6)
