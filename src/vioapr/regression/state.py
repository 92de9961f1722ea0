"""The state of a training, after every epoch and within: journal, weights, optimizer, in one file.

An interrupted training goes on from it. TensorBoard shows the journal.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from torch import Tensor
from torch.optim import Optimizer

from vioapr.errors import FormatError, ParameterError, UnwritableError
from vioapr.files.atomic import write_atomically
from vioapr.regression.checkpoint import load_tensors, save_tensors
from vioapr.regression.losses import Learner
from vioapr.regression.params import TrainingParams
from vioapr.regression.run import Run
from vioapr.schemas.base import encode, to_plain
from vioapr.schemas.regressor import (
    STATE_FILE,
    BegunEpoch,
    EpochRecord,
    RunIdentity,
    StateHeader,
    note_of,
)
from vioapr.work.processes import is_first_process
from vioapr.work.steps import describe_changes

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

TENSORBOARD_FOLDER = "tensorboard"

OptimizerStates = dict[int, dict[str, Tensor]]
"""Of parameters by their numbers."""

NOT_OF_THE_RESULT = {"devices", "nodes", "compile", "patience", "checkpoint_minutes"}
"""Parameters that may be others when a run is resumed."""


@dataclass(eq=False)
class EpochProgress:
    """How far an epoch has come.

    Attributes:
        total: Sum of the losses of its steps, a scalar.
        random: See `checkpointing.random_states`; None before the first step.
        steps: Batches that were learned from.
        images: In these.
        seconds: How long they took.
    """

    total: Tensor
    random: Tensor | None = None
    steps: int = 0
    images: int = 0
    seconds: float = 0.0


@dataclass(eq=False)
class Journal:
    """The records of all epochs so far.

    Attributes:
        epochs: In order.
    """

    epochs: list[EpochRecord] = field(default_factory=list)
    _writer: SummaryWriter | None = None

    def add(self, record: EpochRecord) -> None:
        """Enter an epoch that has ended."""
        self.epochs.append(record)
        if self._writer is not None:
            for name, value in to_plain(record).items():
                group, _, rest = name.partition("_")
                tag = f"validation/{rest}" if group == "validation" else f"training/{name}"
                self._writer.add_scalar(tag, value, len(self.epochs))

    @property
    def best(self) -> int:
        """Row of the best epoch by the validation recordings; the last without them."""
        scores = [record.validation_score for record in self.epochs]
        known = [(score, row) for row, score in enumerate(scores) if score is not None]
        return min(known)[1] if known else len(self.epochs) - 1

    @property
    def is_best_last(self) -> bool:
        """Whether the last epoch is the best."""
        return self.best == len(self.epochs) - 1

    def is_stale(self, patience: int) -> bool:
        """Whether the best epoch is at least `patience` epochs ago; never, if 0."""
        return patience > 0 and len(self.epochs) - 1 - self.best >= patience

    @contextmanager
    def tensorboard(self, folder: Path, is_shown: bool) -> Iterator[None]:
        """Show what is added in TensorBoard, while this lasts."""
        if not is_shown:
            yield
            return
        from torch.utils.tensorboard import SummaryWriter

        # Epochs that a killed run wrote after its last checkpoint are dropped.
        self._writer = SummaryWriter(
            str(folder / TENSORBOARD_FOLDER), purge_step=len(self.epochs) + 1
        )
        try:
            yield
        finally:
            writer, self._writer = self._writer, None
            try:
                writer.close()
            except OSError as error:
                raise UnwritableError.of(folder / TENSORBOARD_FOLDER, error) from None


def identity_of(run: Run) -> RunIdentity:
    """Say what must be the same for a run to be resumed."""
    params = run.params.to_json()
    decisive = {name: value for name, value in params.items() if name not in NOT_OF_THE_RESULT}
    return RunIdentity(spec=run.spec, params=decisive, samples=run.samples.fingerprint)


def save_state(
    run: Run,
    learner: Learner,
    optimizer: Optimizer,
    journal: Journal,
    progress: EpochProgress | None = None,
) -> None:
    """Write all that is needed to go on after the last epoch, or within the one that is begun.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    tensors = {f"learner.{name}": value for name, value in learner.state_dict().items()}
    for number, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": value for name, value in state.items()}
    begun = None
    if progress is not None:
        assert progress.random is not None  # it has had a step
        tensors |= {"progress.total": progress.total, "progress.random": progress.random}
        begun = BegunEpoch(progress.steps, progress.images, progress.seconds)
    header = StateHeader(run=identity_of(run), epochs=tuple(journal.epochs), begun=begun)
    save_tensors(run.folder / STATE_FILE, tensors, header)


class RestoredState(NamedTuple):
    """The state of a training, but for the learner's.

    Attributes:
        journal: So far.
        optimizer: The optimizer's.
        progress: Of the epoch that was begun, if one was.
    """

    journal: Journal
    optimizer: OptimizerStates
    progress: EpochProgress | None = None


def restore_state(run: Run, learner: Learner) -> RestoredState:
    """Set a learner to the state in the run's folder.

    Returns:
        The rest of the state.

    Raises:
        FileMissingError: There is no state.
        FormatError: It is broken.
        ParameterError: It is another run's.
    """
    path = run.folder / STATE_FILE
    tensors, header = load_tensors(path, StateHeader)
    own, noted = identity_of(run), header.run
    # A state that is older than a parameter was made with what is the default now.
    defaults = TrainingParams().to_json()
    for part, then, now in (
        ("spec", to_plain(noted.spec), to_plain(own.spec)),
        ("params", noted.params, own.params),
    ):
        if changes := describe_changes(then, now, defaults):
            raise ParameterError(f"{path}: expected to resume with the same {part}: {changes}")
    if noted.samples != own.samples:
        raise ParameterError(
            f"{path}: expected to resume with the same images and poses, they have changed"
        )
    learner.load_state_dict(
        {
            name.removeprefix("learner."): value
            for name, value in tensors.items()
            if name.startswith("learner.")
        }
    )
    states: OptimizerStates = {}
    for name, value in tensors.items():
        if name.startswith("optimizer."):
            _, number, key = name.split(".", 2)
            states.setdefault(int(number), {})[key] = value
    progress = None
    if header.begun is not None:
        try:
            kept = tensors["progress.total"], tensors["progress.random"]
        except KeyError as error:
            raise FormatError(path, f"expected the state of a begun epoch, lacks {error}") from None
        begun = header.begun
        progress = EpochProgress(*kept, begun.steps, begun.images, begun.seconds)
    # Killed between the two files, the copy of the header would be older.
    if is_first_process():
        write_atomically(note_of(path), encode(header, indent=1).encode())
    return RestoredState(Journal(list(header.epochs)), states, progress)
