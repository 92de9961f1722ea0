"""The training loop.

Everything that is random is a function of the seed and the epoch, and every epoch ends with the
whole state on disk: a run that was killed goes on as if it had not been.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import torch
from lightning_fabric import Fabric
from torch import Tensor, nn

from vioapr.errors import FormatError, ParameterError, TrainingError
from vioapr.regression.batches import Batch, BatchSource
from vioapr.regression.checkpoint import (
    REGRESSOR_FILE,
    STATE_FILE,
    load_tensors,
    save_regressor,
    save_tensors,
)
from vioapr.regression.data import Samples
from vioapr.regression.distributed import (
    ending_together,
    mean_of_processes,
    start_fabric,
    synchronize_norms,
)
from vioapr.regression.journal import Journal
from vioapr.regression.losses import LossParams, PoseLoss
from vioapr.regression.networks import PoseNetwork
from vioapr.regression.params import TrainingParams
from vioapr.regression.spec import RegressorSpec
from vioapr.regression.validation import validate


class Learner(nn.Module):
    """A network with its loss: what a step runs forwards."""

    def __init__(self, network: PoseNetwork, loss: LossParams) -> None:
        """Of a network."""
        super().__init__()
        self.network, self.loss = network, PoseLoss(loss)

    def forward(self, batch: Batch) -> Tensor:
        """The mean loss of a batch."""
        raw = self.network.forward_raw(batch.images, batch.scene)
        with torch.autocast(batch.images.device.type, enabled=False):
            raw = raw._replace(**{
                name: value.float() for name, value in raw._asdict().items() if value is not None
            })  # fmt: skip
            position = self.network.to_unit(batch.position_m, batch.scene)
            return self.loss(self.network, raw, position, batch.quat_xyzw, batch.scene)


class Run(NamedTuple):
    """What a training run is about.

    Attributes:
        spec: The regressor's.
        network: With its first weights and its scenes' units.
        samples: To learn from.
        validation: To choose the best epoch by, or None: then the last one is.
        folder: Where checkpoints go.
        params: The loop's.
        tick: Called after every step.
    """

    spec: RegressorSpec
    network: PoseNetwork
    samples: Samples
    validation: Samples | None
    folder: Path
    params: TrainingParams
    tick: Callable[[], object] = lambda: None


def set_units(network: PoseNetwork, samples: Samples) -> None:
    """The units of all scenes, from their training cameras."""
    for scene in range(len(network.size_m)):
        position_m = samples.position_m[samples.scene == scene]
        size_m = float(position_m.std(axis=0).max())
        centre_m = torch.as_tensor(position_m.mean(axis=0), dtype=torch.float32)
        network.set_unit(scene, centre_m, max(size_m, 1e-3))


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
    optimizer = torch.optim.Adam(
        [p for p in learner.parameters() if p.requires_grad],
        lr=run.params.lr, weight_decay=run.params.weight_decay,
    )  # fmt: skip
    journal = Journal.empty()
    if resume:
        journal = _restore(run, learner, optimizer)
    fabric = start_fabric(run.params)
    with ending_together(fabric):
        _learn(run, fabric, learner, optimizer, journal)
    return journal


def _learn(run: Run, fabric: Fabric, learner: Learner, optimizer: Any, journal: Journal) -> None:
    """The epochs that are left."""
    synchronize_norms(learner, fabric)
    wrapped, optimizer = fabric.setup(learner, optimizer, _reapply_compile=False)
    step = torch.compile(wrapped) if run.params.compile else wrapped
    part = (fabric.global_rank, fabric.world_size)
    source = BatchSource(
        run.samples, run.spec.crop, run.params.augmentation, run.params.batch_size,
        run.params.seed, fabric.device, part,
    )  # fmt: skip
    _skip_ticks(run, len(source) * len(journal.epochs))
    with journal.tensorboard(run.folder, fabric.is_global_zero):
        for epoch in range(len(journal.epochs), run.params.epochs):
            record = _run_epoch(run, fabric, step, learner, optimizer, source, epoch)
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


def _skip_ticks(run: Run, steps: int) -> None:
    for _ in range(steps):
        run.tick()


def _run_epoch(
    run: Run,
    fabric: Fabric,
    step: Callable[[Batch], Tensor],
    learner: Learner,
    optimizer: Any,
    source: BatchSource,
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
        lr = run.params.lr_at(epoch * len(source) + number, run.params.epochs * len(source))
        for group in optimizer.param_groups:
            group["lr"] = lr
        with _explained(run):
            loss = step(_channels_last(batch))
            fabric.backward(loss)
            optimizer.step()
            optimizer.zero_grad()
        total += mean_of_processes(fabric, loss)
        images += run.params.batch_size
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
        found = validate(learner.network, run.validation, run.spec.crop, fabric.device)
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
    run: Run, learner: Learner, optimizer: Any, journal: Journal, record: dict[str, float]
) -> None:
    """Write the state, and the regressor if it is the best so far."""
    journal.add(record)
    if journal.is_best_last:
        _save_best(run, learner.network, journal)
    tensors = {f"learner.{name}": value for name, value in learner.state_dict().items()}
    for number, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": value for name, value in state.items()}
    content = {"run": _identity(run), "epochs": journal.epochs}
    save_tensors(run.folder / STATE_FILE, "state", tensors, content)


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


def _identity(run: Run) -> dict[str, Any]:
    """What must be the same for a run to be resumed."""
    kept = {"devices", "nodes", "compile", "patience"}
    params = {name: value for name, value in run.params.to_json().items() if name not in kept}
    return {
        "spec": {**run.spec.to_json(), "scenes": list(run.spec.scenes)},
        "params": params,
        "samples": run.samples.fingerprint,
    }


def _restore(run: Run, learner: Learner, optimizer: torch.optim.Adam) -> Journal:
    path = run.folder / STATE_FILE
    tensors, content = load_tensors(path, "state")
    own = _identity(run)
    for part, values in own.items():
        given = content.get("run", {}).get(part)
        if given != values:
            raise ParameterError(f"{path}: {_describe_change(part, given, values)}")
    learner.load_state_dict(
        {
            name.removeprefix("learner."): value
            for name, value in tensors.items()
            if name.startswith("learner.")
        }
    )
    states: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith("optimizer."):
            _, number, key = name.split(".", 2)
            states.setdefault(int(number), {})[key] = value
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": states, "param_groups": groups})
    return Journal(list(content["epochs"]))


def _describe_change(part: str, given: Any, values: Any) -> str:
    if part == "samples" or not isinstance(given, dict):
        return "expected to resume with the same images and poses, they have changed"
    changed = [name for name in values if given.get(name) != values[name]]
    return (
        f"expected to resume with the same {part}, {', '.join(changed)} differ: "
        f"{', '.join(str(given.get(name)) for name in changed)} then, "
        f"{', '.join(str(values[name]) for name in changed)} now"
    )
