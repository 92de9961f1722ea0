"""The training loop.

Everything that is random is a function of the seed and the epoch. The whole state is kept after
every epoch, and within one from time to time: a run that was killed goes on as if it had not been.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext

import msgspec
import torch
from lightning_fabric import Fabric
from torch import Tensor
from torch.optim import Optimizer

from vioapr.errors import TrainingError
from vioapr.regression.batches import Batch, BatchSource
from vioapr.regression.checkpoint import save_regressor
from vioapr.regression.checkpointing import (
    CheckpointClock,
    random_states,
    set_random_state,
)
from vioapr.regression.distributed import (
    ending_together,
    mean_of_processes,
    start_fabric,
    synchronize_norms,
)
from vioapr.regression.losses import Learner
from vioapr.regression.networks import PoseNetwork
from vioapr.regression.params import Stage, TrainingParams
from vioapr.regression.prediction import validate
from vioapr.regression.run import Run, check_run
from vioapr.regression.state import (
    EpochProgress,
    Journal,
    OptimizerStates,
    RestoredState,
    restore_state,
    save_state,
)
from vioapr.regression.watch import StepsOfEpoch
from vioapr.schemas.regressor import REGRESSOR_FILE, STATE_FILE, EpochRecord, Trained
from vioapr.work.locks import locked_folder
from vioapr.work.processes import is_first_process
from vioapr.work.stopping import PendingStop, stop_put_off


def train(run: Run, *, resume: bool = False) -> Journal:
    """Train a network, and leave the best regressor and the last state in a folder.

    Args:
        run: Network, images and parameters.
        resume: Go on from the state in the folder, bit-equal to a run that was not stopped.

    Returns:
        The journal of all epochs.

    Raises:
        TrainingError: The loss became infinite, or memory ran out.
        ParameterError: The state in the folder is of another run, or there is one already.
        LockedError: Another process trains in the folder.
        FileError: A checkpoint is missing, broken or cannot be written.
        Stopped: It was asked to end; the state is kept.
    """
    check_run(run, resume=resume)
    with locked_folder(run.folder) if is_first_process() else nullcontext():
        check_run(run, resume=resume)  # another process may have begun meanwhile
        return _train_alone(run, resume=resume)


def _train_alone(run: Run, *, resume: bool) -> Journal:
    """Train in a folder that no other run is in; see `train`."""
    learner = Learner(run.network, run.params.loss)
    learner.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    restored = restore_state(run, learner) if resume else RestoredState(Journal(), {})
    journal, states, progress = restored
    fabric = start_fabric(run.params)
    with (
        ending_together(fabric),
        journal.tensorboard(run.folder, fabric.is_global_zero),
        stop_put_off() if fabric.world_size == 1 else nullcontext(PendingStop()) as pending,
    ):
        clock = CheckpointClock(fabric, 60 * run.params.checkpoint_minutes, pending)
        # Before there is an optimizer: a state that it is given goes where the parameters are.
        learner.to(fabric.device)
        synchronize_norms(learner, fabric)
        source = BatchSource(
            run.samples, run.spec.crop, run.params.augmentation, run.params.batch_size,
            run.params.seed, fabric.device, (fabric.global_rank, fabric.world_size),
        )  # fmt: skip
        begun_steps = 0 if progress is None else progress.steps
        for _ in range(len(source) * len(journal.epochs) + begun_steps):
            run.tick()
        for stage in run.params.stages:
            if len(journal.epochs) < stage.last:
                is_begun = stage.first < len(journal.epochs) or progress is not None
                train_stage(
                    run, fabric, learner, source, stage, journal, states if is_begun else {},
                    clock, progress,
                )  # fmt: skip
                progress = None
    return journal


def train_stage(
    run: Run,
    fabric: Fabric,
    learner: Learner,
    source: BatchSource,
    stage: Stage,
    journal: Journal,
    states: OptimizerStates,
    clock: CheckpointClock,
    progress: EpochProgress | None = None,
) -> None:
    """Train the epochs of a stage that are left, and write state and regressor after each.

    Args:
        run: Whose stage.
        fabric: The processes.
        learner: On their device.
        source: Of the batches.
        stage: Which.
        journal: Of the epochs so far; every epoch is added to it.
        states: The optimizer's, of a stage that was begun before.
        clock: Says when to keep the state within an epoch.
        progress: Of the first of these epochs, if it was begun before.
    """
    if stage.is_of_positions:
        learner.learn_positions_alone()
    optimizer = make_optimizer(run.params, learner, states)
    wrapped, optimizer = fabric.setup(learner, optimizer, _reapply_compile=False)
    step = torch.compile(wrapped) if run.params.compile else wrapped
    varied = source.varied_by(stage.augmentation)
    for epoch in range(len(journal.epochs), stage.last):
        # Every process drops out other units.
        torch.manual_seed((run.params.seed + fabric.global_rank) * 1_000_003 + epoch)
        learner.train()
        begun = progress or EpochProgress(torch.zeros((), device=fabric.device))
        progress = None
        for _ in train_epoch(run, fabric, step, optimizer, varied, stage, epoch, begun):
            keep_begun_epoch(run, fabric, learner, optimizer, journal, begun, clock)
        record = EpochRecord(
            float(begun.total) / len(source),
            optimizer.param_groups[0]["lr"],
            begun.images / begun.seconds,
        )
        if run.validation is not None and fabric.is_global_zero:
            found = validate(learner.network, run.validation, run.spec.crop)
            known = {f"validation_{name}": value for name, value in found.items()}
            record = msgspec.structs.replace(record, **known)
        journal.add(record)
        if run.watch is not None and fabric.is_global_zero:
            run.watch.tell_epoch(epoch + 1, len(source), record)
        if fabric.is_global_zero:
            if journal.is_best_last:
                save_best(run, learner.network, journal)
            save_state(run, learner, optimizer, journal)
        clock.restart()
        if fabric.broadcast(journal.is_stale(run.params.patience)):
            break


def make_optimizer(params: TrainingParams, learner: Learner, states: OptimizerStates) -> Optimizer:
    """Make Adam for the parameters that learn, in a given state or at its start."""
    parameters = [p for p in learner.parameters() if p.requires_grad]
    optimizer = torch.optim.Adam(
        parameters, lr=params.lr, eps=params.eps, weight_decay=params.weight_decay, fused=True
    )
    # Adam in one pass walks through memory: a state must lie there as its parameter does. Others,
    # such as counts, stay as they are.
    laid_out = {
        number: {
            name: torch.empty_like(parameters[number]).copy_(value)
            if value.shape == parameters[number].shape
            else value
            for name, value in state.items()
        }
        for number, state in states.items()
    }
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": laid_out, "param_groups": groups})
    return optimizer


def train_epoch(
    run: Run,
    fabric: Fabric,
    step: Callable[[Batch], Tensor],
    optimizer: Optimizer,
    source: BatchSource,
    stage: Stage,
    epoch: int,
    progress: EpochProgress,
) -> Iterator[None]:
    """Train one pass over the samples, or what is left of it; yields after every step but the last.

    Args:
        run: Whose epoch.
        fabric: The processes.
        step: From a batch to its loss.
        optimizer: Of what learns.
        source: Of the batches.
        stage: That the epoch is of.
        epoch: Its number in the run, from 0.
        progress: How far it has come; kept up to date.

    Raises:
        TrainingError: The loss became infinite, or memory ran out.
    """
    if progress.random is not None:
        set_random_state(fabric, progress.random)
    progress.total = progress.total.to(fabric.device)
    began = time.perf_counter()
    for number, batch in enumerate(source.epoch(epoch, progress.steps), progress.steps):
        done = (epoch - stage.first) * len(source) + number
        lr = run.params.lr_at(done, stage.epochs * len(source))
        for group in optimizer.param_groups:
            group["lr"] = lr
        pictures = batch.images.contiguous(memory_format=torch.channels_last)
        try:
            loss = step(batch._replace(images=pictures))
            fabric.backward(loss)
            optimizer.step()
            optimizer.zero_grad()
        except RuntimeError as error:
            if not isinstance(error, torch.OutOfMemoryError) and "not enough memory" not in str(
                error
            ):
                raise
            raise TrainingError(
                f"out of memory at a batch of {run.params.batch_size} images of {run.spec.crop} "
                f"pixels: try `batch_size` {max(run.params.batch_size // 2, 1)}"
            ) from None
        progress.total += mean_of_processes(fabric, loss)
        progress.images += len(batch.images) * fabric.world_size
        progress.steps = number + 1
        # On a GPU, looking at every step would wait for it.
        if fabric.device.type == "cpu" or number == len(source) - 1:
            check_loss(run, fabric, progress.total, epoch, number)
        run.tick()
        now = time.perf_counter()
        progress.seconds, began = progress.seconds + now - began, now
        if run.watch is not None and fabric.is_global_zero and run.watch.is_due():
            loss_so_far = float(progress.total) / (number + 1)
            rate = progress.images / progress.seconds
            run.watch.tell_steps(
                StepsOfEpoch(epoch + 1, number + 1, len(source), loss_so_far, rate)
            )
        if number < len(source) - 1:  # else the epoch is kept as a whole
            yield


def keep_begun_epoch(
    run: Run,
    fabric: Fabric,
    learner: Learner,
    optimizer: Optimizer,
    journal: Journal,
    progress: EpochProgress,
    clock: CheckpointClock,
) -> None:
    """Keep the state within an epoch if it is time to, and end if that was asked for.

    Raises:
        Stopped: It was.
        TrainingError: The loss became infinite.
        UnwritableError: The state cannot be written; the one before stays.
    """
    if not clock.is_due():
        return
    progress.random = random_states(fabric)
    if fabric.is_global_zero:
        check_loss(run, fabric, progress.total, len(journal.epochs), progress.steps - 1)
        save_state(run, learner, optimizer, journal, progress)
    clock.restart()
    clock.raise_if_stopping(run.folder)


def check_loss(run: Run, fabric: Fabric, total: Tensor, epoch: int, step: int) -> None:
    """Stop a run whose loss is no longer a number; all processes have the same.

    Raises:
        TrainingError: It is infinite or NaN; raised in the first process.
    """
    if not fabric.is_global_zero or bool(torch.isfinite(total)):
        return
    kept = "no epoch was finished before"
    if epoch:
        kept = f"the last good state, of epoch {epoch}, is {run.folder / STATE_FILE}"
    raise TrainingError(
        f"the loss is not a number in epoch {epoch + 1}, step {step + 1}: "
        f"try a lower `lr` than {run.params.lr:g}; {kept}"
    )


def save_best(run: Run, network: PoseNetwork, journal: Journal) -> None:
    """Write the regressor, its uncertainties corrected by the validation recordings.

    The network itself stays as it is.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    last = journal.epochs[-1]
    before = network.sigma_scale.clone()
    if last.validation_sigma_position is not None:
        factors = [last.validation_sigma_position, last.validation_sigma_orientation]
        network.sigma_scale *= torch.tensor(factors, device=before.device)
    trained = Trained(
        len(journal.epochs), run.params.to_json(), last, len(run.samples), run.weights
    )
    save_regressor(run.folder / REGRESSOR_FILE, network, run.spec, trained)
    network.sigma_scale.copy_(before)
