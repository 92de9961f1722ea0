"""The state within an epoch: kept by time and when stopped, and gone on from bit-equal."""

import errno
import os
import signal
from types import SimpleNamespace

import pytest
import torch
from tests.regression.toy import make_scene, params, spec

from vioapr.errors import DiskFullError, FormatError, LockedError, ParameterError
from vioapr.regression import checkpoint
from vioapr.regression.checkpoint import load, load_tensors, save_tensors
from vioapr.regression.checkpointing import CheckpointClock
from vioapr.regression.data import load_samples, split_frames
from vioapr.regression.networks import build
from vioapr.regression.params import PositionStageParams
from vioapr.regression.run import Run, set_units
from vioapr.regression.training import train
from vioapr.schemas.base import decode
from vioapr.schemas.regressor import REGRESSOR_FILE, STATE_FILE, StateHeader, note_of
from vioapr.work.locks import locked_folder
from vioapr.work.stopping import PendingStop, Stopped

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    scene = make_scene(tmp_path_factory.mktemp("scenes") / "box", train=1, frames=32)
    return load_samples([scene], split_frames([scene], "train"), 36)


def run_in(folder, samples, **values):
    """A run of 4 steps an epoch, with dropout, whose state is kept after every step."""
    run_spec = spec(dropout=0.5)
    run_params = params(**{"batch_size": 8, "checkpoint_minutes": 0.0, **values})
    torch.manual_seed(run_params.seed)
    network = build(run_spec)
    set_units(network, samples)
    return Run(run_spec, network, samples, None, folder, run_params)


@pytest.fixture
def make_run(samples, tmp_path):
    def make(name="run", **values):
        return run_in(tmp_path / name, samples, **values)

    return make


TWO_STAGES = {"epochs": 2, "schedule": "cosine", "position_stage": PositionStageParams(1)}


@pytest.fixture(scope="module")
def whole(samples, tmp_path_factory):
    """A run of two stages that nothing stopped."""
    run = run_in(tmp_path_factory.mktemp("whole") / "run", samples, **TWO_STAGES)
    torch.set_num_threads(1)  # as in the tests: sums of more threads differ in their last bits
    train(run)
    return run


def stopping_at(run, step, stop):
    """The run, which calls `stop` at the end of a step, before its state is kept."""
    steps = []

    def tick():
        steps.append(1)
        if len(steps) == step:
            stop()

    return run._replace(tick=tick)


def interrupt():
    raise KeyboardInterrupt


def state_of(run):
    return load_tensors(run.folder / STATE_FILE, StateHeader)


def assert_same_result(one, other):
    (mine, my_header), (theirs, their_header) = state_of(one), state_of(other)
    assert mine.keys() == theirs.keys()
    assert all(torch.equal(mine[name], theirs[name]) for name in mine)
    for first, second in zip(my_header.epochs, their_header.epochs, strict=True):
        assert (first.loss, first.lr) == (second.loss, second.lr)
    mine, theirs = (load(run.folder).network.state_dict() for run in (one, other))
    assert all(torch.equal(mine[name], theirs[name]) for name in mine)


@pytest.mark.parametrize("stopped_at", [2, 3, 4, 6, 10])
def test_an_epoch_goes_on_where_it_was(whole, make_run, stopped_at):
    """Also twice, and in the second stage: step 10 is of the third epoch."""
    values = TWO_STAGES
    with pytest.raises(KeyboardInterrupt):
        train(stopping_at(make_run(**values), stopped_at, interrupt))
    begun = state_of(make_run())[1].begun
    assert (0 if begun is None else begun.steps) == (stopped_at - 1) % 4
    ticks = []
    again = make_run(**values)
    again = again._replace(tick=lambda: ticks.append(1))
    with pytest.raises(KeyboardInterrupt):
        train(stopping_at(make_run(**values), stopped_at + 1, interrupt), resume=True)
    train(again, resume=True)
    assert len(ticks) == 12  # those that were done before, too
    assert_same_result(whole, again)


def test_checkpoints_do_not_change_the_result(make_run):
    often, never = make_run("often"), make_run("never", checkpoint_minutes=1e6)
    train(often)
    train(never)
    assert_same_result(often, never)


def test_the_first_state_is_kept_within_a_minute_then_by_the_given_time():
    now = [100.0]
    fabric = SimpleNamespace(world_size=1)
    clock = CheckpointClock(fabric, 300.0, PendingStop(), lambda: now[0])
    assert not clock.is_due()
    now[0] = 144.0
    assert not clock.is_due()
    now[0] = 146.0
    assert clock.is_due()
    clock.restart()
    now[0] = 445.0
    assert not clock.is_due()
    now[0] = 447.0
    assert clock.is_due()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_stopped_loses_nothing(make_run, number):
    """However long the time between checkpoints is."""
    from vioapr.work.stopping import SIGNALS, raise_on_signals

    values = {"checkpoint_minutes": 1e6}
    whole = make_run("whole", **values)
    train(whole)
    before = {one: signal.getsignal(one) for one in SIGNALS}
    raise_on_signals()
    try:
        run = stopping_at(make_run(**values), 3, lambda: os.kill(os.getpid(), number))
        with pytest.raises(Stopped) as caught:
            train(run)
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    assert caught.value.signal_number == number
    assert caught.value.advice == (
        f"the training's state is kept in {run.folder}: `resume` goes on with it"
    )
    begun = state_of(run)[1].begun
    assert begun is not None
    assert (begun.steps, begun.images) == (3, 24)
    again = make_run(**values)
    train(again, resume=True)
    assert_same_result(whole, again)


def test_a_full_disk_keeps_the_state_before(make_run, monkeypatch):
    whole = make_run("whole")
    train(whole)
    saves = []
    original = checkpoint.save_file

    def save(tensors, path, metadata):
        saves.append(path)
        if len(saves) == 4:
            raise checkpoint.SafetensorError(
                f"Error while serializing: I/O error: No space left (os error {errno.ENOSPC})"
            )
        original(tensors, path, metadata=metadata)

    monkeypatch.setattr(checkpoint, "save_file", save)
    with pytest.raises(DiskFullError, match="No space left"):
        train(make_run())
    monkeypatch.undo()
    assert not list(make_run().folder.glob(".*.partial"))
    again = make_run()
    train(again, resume=True)
    assert_same_result(whole, again)


def test_one_process_trains_in_a_folder(make_run):
    run = make_run()
    with locked_folder(run.folder), pytest.raises(LockedError, match=f"process {os.getpid()} "):
        train(run)
    train(run)


def test_a_regressor_without_state_is_not_overwritten(make_run):
    run = make_run(epochs=1)
    train(run)
    for path in (run.folder / STATE_FILE, note_of(run.folder / STATE_FILE)):
        path.unlink()
    before = (run.folder / REGRESSOR_FILE).read_bytes()
    with pytest.raises(ParameterError, match=r"found regressor\.safetensors and no state"):
        train(make_run(epochs=1))
    assert (run.folder / REGRESSOR_FILE).read_bytes() == before


def test_the_copy_of_the_header_is_mended(make_run):
    """Killed between the two files, it would be of an epoch before."""
    run = make_run(epochs=1)
    train(run)
    path = note_of(run.folder / STATE_FILE)
    expected = path.read_text()
    path.write_text("{}")
    train(make_run(epochs=1), resume=True)
    assert path.read_text() == expected
    assert len(decode(path, expected, StateHeader).epochs) == 1


def test_a_begun_epoch_without_its_tensors(make_run):
    with pytest.raises(KeyboardInterrupt):
        train(stopping_at(make_run(), 3, interrupt))
    path = make_run().folder / STATE_FILE
    tensors, header = load_tensors(path, StateHeader)
    save_tensors(path, {k: v for k, v in tensors.items() if k != "progress.random"}, header)
    with pytest.raises(FormatError, match="state of a begun epoch, lacks 'progress.random'"):
        train(make_run(), resume=True)


def test_model_files_are_readable_as_the_umask_says(make_run):
    run = make_run(epochs=1)
    before = os.umask(0o022)
    try:
        train(run)
    finally:
        os.umask(before)
    for name in (REGRESSOR_FILE, STATE_FILE, "regressor.json", "state.json"):
        assert (run.folder / name).stat().st_mode & 0o777 == 0o644


def test_time_between_checkpoints_is_no_part_of_the_result(make_run):
    train(make_run(epochs=1, checkpoint_minutes=3.0))
    train(make_run(epochs=1, checkpoint_minutes=7.0), resume=True)
    with pytest.raises(ParameterError, match="checkpoint_minutes: expected at least 0"):
        params(checkpoint_minutes=-1.0)
