"""The state of a training after every epoch: journal, weights and optimizer, in one file.

An interrupted training goes on from it. TensorBoard shows the journal.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from torch import Tensor
from torch.optim import Optimizer

from vioapr.errors import ParameterError
from vioapr.regression.checkpoint import load_tensors, save_tensors
from vioapr.regression.losses import Learner
from vioapr.regression.params import TrainingParams
from vioapr.regression.run import Run
from vioapr.schemas.base import to_plain
from vioapr.schemas.regressor import STATE_FILE, EpochRecord, RunIdentity, StateHeader
from vioapr.work.steps import describe_changes

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

TENSORBOARD_FOLDER = "tensorboard"

OptimizerStates = dict[int, dict[str, Tensor]]
"""Of parameters by their numbers."""

NOT_OF_THE_RESULT = {"devices", "nodes", "compile", "patience"}
"""Parameters that may be others when a run is resumed."""


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
            self._writer.close()
            self._writer = None


def identity_of(run: Run) -> RunIdentity:
    """Say what must be the same for a run to be resumed."""
    params = run.params.to_json()
    decisive = {name: value for name, value in params.items() if name not in NOT_OF_THE_RESULT}
    return RunIdentity(spec=run.spec, params=decisive, samples=run.samples.fingerprint)


def save_state(run: Run, learner: Learner, optimizer: Optimizer, journal: Journal) -> None:
    """Write all that is needed to go on after the last epoch.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    tensors = {f"learner.{name}": value for name, value in learner.state_dict().items()}
    for number, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": value for name, value in state.items()}
    header = StateHeader(run=identity_of(run), epochs=tuple(journal.epochs))
    save_tensors(run.folder / STATE_FILE, tensors, header)


def restore_state(run: Run, learner: Learner) -> tuple[Journal, OptimizerStates]:
    """Set a learner to the state in the run's folder.

    Returns:
        The journal so far, and the state of the optimizer.

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
    return Journal(list(header.epochs)), states
