"""What happened in every epoch: kept in the checkpoint, shown in TensorBoard."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TENSORBOARD_FOLDER = "tensorboard"
_SCORE = "validation_score"


@dataclass(eq=False)
class Journal:
    """The records of all epochs so far.

    Attributes:
        epochs: Of each: loss, lr, images_per_s and, with validation recordings, their errors.
    """

    epochs: list[dict[str, float]]
    _writer: Any = None

    @staticmethod
    def empty() -> Journal:
        """Before the first epoch."""
        return Journal([])

    def add(self, record: dict[str, float]) -> None:
        """After an epoch."""
        self.epochs.append(record)
        if self._writer is not None:
            for name, value in record.items():
                group, _, rest = name.partition("_")
                tag = f"validation/{rest}" if group == "validation" else f"training/{name}"
                self._writer.add_scalar(tag, value, len(self.epochs))

    @property
    def best(self) -> int:
        """Row of the best epoch by the validation recordings; the last without them."""
        scores = [record.get(_SCORE) for record in self.epochs]
        known = [(score, row) for row, score in enumerate(scores) if score is not None]
        return min(known)[1] if known else len(self.epochs) - 1

    @property
    def is_best_last(self) -> bool:
        """Whether the last epoch is the best."""
        return self.best == len(self.epochs) - 1

    def is_stale(self, patience: int) -> bool:
        """Whether the best epoch is so many epochs ago; never, if 0."""
        return patience > 0 and len(self.epochs) - 1 - self.best >= patience

    @contextmanager
    def tensorboard(self, folder: Path, is_shown: bool) -> Iterator[None]:
        """Show what is added in TensorBoard, while this lasts."""
        if not is_shown:
            yield
            return
        from torch.utils.tensorboard import SummaryWriter

        # What a killed run wrote after its last checkpoint is dropped.
        self._writer = SummaryWriter(
            str(folder / TENSORBOARD_FOLDER), purge_step=len(self.epochs) + 1
        )
        try:
            yield
        finally:
            self._writer.close()
            self._writer = None
