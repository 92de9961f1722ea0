"""The training loop.

Everything that is random is a function of the seed and the epoch, and every epoch ends with the
whole state on disk: a run that was killed goes on as if it had not been.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

import torch
from lightning_fabric import Fabric
from torch import Tensor
from torch.optim import Optimizer

from vioapr.errors import FormatError, ParameterError, TrainingError
from vioapr.regression.batches import Batch, BatchSource
from vioapr.regression.checkpoint import save_regressor
from vioapr.regression.distributed import (
    ending_together,
    mean_of_processes,
    start_fabric,
    synchronize_norms,
)
from vioapr.regression.files import REGRESSOR_FILE, STATE_FILE
from vioapr.regression.journal import Journal
from vioapr.regression.learner import Learner, Run
from vioapr.regression.networks import PoseNetwork
from vioapr.regression.params import Stage
from vioapr.regression.state import OptimizerStates, restore_state, save_state
from vioapr.regression.validation import validate


def train(run: Run, *, resume: bool = False) -> Journal:
    """Train a network, and leave the best regressor and the last state in a folder.

    Args:
        run: What about.
        resume: Go on from the state in the folder, bit-equal to a run that was not stopped.

    Returns:
        What happened in every epoch.

    Raises:
        TrainingError: The loss became infinite, or memory ran out.
        ParameterError: The state in the folder is of another run, or there is one already.
        FormatError: A checkpoint is broken or cannot be written.
    """
    _check(run, resume)
    learner = Learner(run.network, run.params.loss)
    learner.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    journal, optimizer_states = Journal.empty(), {}
    if resume:
        journal, optimizer_states = restore_state(run, learner)
    fabric = start_fabric(run.params)
    with ending_together(fabric):
        _learn(run, fabric, learner, journal, optimizer_states)
    return journal


def _learn(
    run: Run, fabric: Fabric, learner: Learner, journal: Journal, optimizer_states: OptimizerStates
) -> None:
    """The epochs that are left."""
    # Before there is an optimizer: a state that it is given goes where the parameters are.
    learner.to(fabric.device)
    synchronize_norms(learner, fabric)
    part = (fabric.global_rank, fabric.world_size)
    source = BatchSource(
        run.samples, run.spec.crop, run.params.augmentation, run.params.batch_size,
        run.params.seed, fabric.device, part,
    )  # fmt: skip
    for _ in range(len(source) * len(journal.epochs)):
        run.tick()
    with journal.tensorboard(run.folder, fabric.is_global_zero):
        for stage in run.params.stages:
            if len(journal.epochs) >= stage.last:
                continue
            if stage.is_of_positions:
                learner.learn_positions_alone()
            is_begun = stage.first < len(journal.epochs)
            optimizer = _make_optimizer(run, learner, optimizer_states if is_begun else {})
            _run_stage(run, fabric, learner, optimizer, source, stage, journal)


def _make_optimizer(run: Run, learner: Learner, states: OptimizerStates) -> Optimizer:
    parameters = [p for p in learner.parameters() if p.requires_grad]
    optimizer = torch.optim.Adam(
        parameters, lr=run.params.lr, eps=run.params.eps,
        weight_decay=run.params.weight_decay, fused=True,
    )  # fmt: skip
    # Adam in one pass walks through memory: a state must lie there as its parameter does.
    states = {
        number: {name: _laid_out_as(parameters[number], value) for name, value in state.items()}
        for number, state in states.items()
    }
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": states, "param_groups": groups})
    return optimizer


def _laid_out_as(parameter: Tensor, value: Tensor) -> Tensor:
    """A tensor of the parameter's shape with its strides; others, such as counts, as they are."""
    if value.shape != parameter.shape:
        return value
    return torch.empty_like(parameter).copy_(value)


def _run_stage(
    run: Run,
    fabric: Fabric,
    learner: Learner,
    optimizer: Optimizer,
    source: BatchSource,
    stage: Stage,
    journal: Journal,
) -> None:
    """Its epochs that are left."""
    wrapped, optimizer = fabric.setup(learner, optimizer, _reapply_compile=False)
    step = torch.compile(wrapped) if run.params.compile else wrapped
    source = source.varied_by(stage.augmentation)
    for epoch in range(len(journal.epochs), stage.last):
        record = _run_epoch(run, fabric, step, learner, optimizer, source, stage, epoch)
        if fabric.is_global_zero:
            _finish_epoch(run, learner, optimizer, journal, record)
        else:
            journal.add(record)
        if fabric.broadcast(journal.is_stale(run.params.patience)):
            break


def _check(run: Run, resume: bool) -> None:
    state = run.folder / STATE_FILE
    if state.exists() and not resume:
        raise ParameterError(
            f"{run.folder}: expected a folder without a training run, found {STATE_FILE}: "
            f"--resume goes on with it, another --out begins anew"
        )
    if resume and not state.exists():
        raise FormatError(state, "expected the state of a training run to resume, found none")
    processes = run.params.devices * run.params.nodes
    if len(run.samples) < processes:
        raise ParameterError(
            f"devices: expected at most {len(run.samples)}, the training images, got {processes}"
        )
    turns = run.params.augmentation.turn_deg > 0
    if turns and not (run.samples.camera == run.samples.camera).all():
        raise TrainingError(
            "turn_deg: expected known intrinsics of all training images, some have none in "
            "frames.csv: train without turns"
        )


def _run_epoch(
    run: Run,
    fabric: Fabric,
    step: Callable[[Batch], Tensor],
    learner: Learner,
    optimizer: Optimizer,
    source: BatchSource,
    stage: Stage,
    epoch: int,
) -> dict[str, float]:
    """One pass over the samples; returns what happened."""
    # What is dropped is not the same in every process, as it is not in every image.
    torch.manual_seed((run.params.seed + fabric.global_rank) * 1_000_003 + epoch)
    learner.train()
    began, images = time.perf_counter(), 0
    total = torch.zeros((), device=fabric.device)
    lr = 0.0
    for number, batch in enumerate(source.epoch(epoch)):
        done = (epoch - stage.first) * len(source) + number
        lr = run.params.lr_at(done, stage.epochs * len(source))
        for group in optimizer.param_groups:
            group["lr"] = lr
        with _explained(run):
            loss = step(_channels_last(batch))
            fabric.backward(loss)
            optimizer.step()
            optimizer.zero_grad()
        total += mean_of_processes(fabric, loss)
        images += len(batch.images) * fabric.world_size
        if fabric.device.type == "cpu":  # elsewhere looking at every step would wait for it
            _check_loss(run, fabric, total, epoch, number)
        run.tick()
    _check_loss(run, fabric, total, epoch, len(source) - 1)
    record = {
        "loss": float(total) / len(source),
        "lr": lr,
        "images_per_s": images / (time.perf_counter() - began),
    }
    if run.validation is not None and fabric.is_global_zero:
        found = validate(learner.network, run.validation, run.spec.crop)
        record |= {f"validation_{name}": value for name, value in found.items()}
    return record


def _channels_last(batch: Batch) -> Batch:
    return batch._replace(images=batch.images.contiguous(memory_format=torch.channels_last))


def _check_loss(run: Run, fabric: Fabric, total: Tensor, epoch: int, step: int) -> None:
    # All processes have the same total; the first says what is wrong with it.
    if not fabric.is_global_zero or bool(torch.isfinite(total)):
        return
    state = run.folder / STATE_FILE
    kept = (
        f"the last good state, of epoch {epoch}, is {state}"
        if epoch
        else "no epoch was finished before"
    )
    raise TrainingError(
        f"the loss is not a number in epoch {epoch + 1}, step {step + 1}: "
        f"try a lower --lr than {run.params.lr:g}; {kept}"
    )


@contextlib.contextmanager
def _explained(run: Run) -> Iterator[None]:
    """Running out of memory, said so that one knows what to do."""
    try:
        yield
    except RuntimeError as error:
        is_memory = isinstance(error, torch.OutOfMemoryError) or "not enough memory" in str(error)
        if not is_memory:
            raise
        smaller = max(run.params.batch_size // 2, 1)
        raise TrainingError(
            f"out of memory at a batch of {run.params.batch_size} images of {run.spec.crop} "
            f"pixels: try --batch-size {smaller}"
        ) from None


def _finish_epoch(
    run: Run, learner: Learner, optimizer: Optimizer, journal: Journal, record: dict[str, float]
) -> None:
    """Write the state, and the regressor if it is the best so far."""
    journal.add(record)
    if journal.is_best_last:
        _save_best(run, learner.network, journal)
    save_state(run, learner, optimizer, journal)


def _save_best(run: Run, network: PoseNetwork, journal: Journal) -> None:
    """The regressor, its uncertainties corrected by the validation recordings."""
    last = journal.epochs[-1]
    before = network.sigma_scale.clone()
    if run.validation is not None:
        factors = [last[f"validation_sigma_{name}"] for name in ("position", "orientation")]
        network.sigma_scale *= torch.tensor(factors, device=before.device)
    trained = {
        "epoch": len(journal.epochs), "params": run.params.to_json(), "last_epoch": last,
        "images": len(run.samples),
    }  # fmt: skip
    save_regressor(run.folder / REGRESSOR_FILE, network, run.spec, trained)
    network.sigma_scale.copy_(before)
