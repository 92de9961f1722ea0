"""How a training goes, in lines for a file: every epoch, and now and then within a long one."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from vioapr.cli.progress_lines import Pace, format_duration

if TYPE_CHECKING:
    from vioapr.regression.watch import StepsOfEpoch
    from vioapr.schemas.regressor import EpochRecord


class TrainingLines:
    """Prints lines with loss, validation error, rate and time left."""

    def __init__(
        self,
        epochs: int,
        write: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count time.

        Args:
            epochs: Those that the run will have, with those of an earlier process.
            write: Prints a line.
            clock: Seconds since some moment.
        """
        self._epochs, self._write, self._pace = epochs, write, Pace(clock)
        self._epochs_before: int | None = None

    def is_due(self) -> bool:
        """Whether a line is due within an epoch."""
        return self._pace.is_due()

    def tell_steps(self, done: StepsOfEpoch) -> None:
        """Print how an epoch goes."""
        share = done.step / done.steps
        self._write(
            f"training: epoch {done.epoch} of {self._epochs}, step {done.step} of {done.steps}: "
            f"loss {done.loss:.4g}, {done.images_per_s:.0f} images/s, "
            f"ETA {self._time_left(done.epoch - 1 + share, done.epoch)}"
        )

    def tell_epoch(self, epoch: int, steps: int, record: EpochRecord) -> None:
        """Print how an epoch went."""
        error = ""
        if record.validation_position_m is not None:
            error = (
                f", validation {record.validation_position_m:.3f} m, "
                f"{record.validation_orientation_deg:.2f} deg"
            )
        self._write(
            f"training: epoch {epoch} of {self._epochs}, step {steps} of {steps}: "
            f"loss {record.loss:.4g}{error}, {record.images_per_s:.0f} images/s, "
            f"ETA {self._time_left(epoch, epoch)}"
        )

    def _time_left(self, done: float, epoch: int) -> str:
        """The time left, from that of the epochs that this process has done.

        Args:
            done: Epochs, with those of an earlier process.
            epoch: The current one, from 1.
        """
        if self._epochs_before is None:
            self._epochs_before = epoch - 1
        own = done - self._epochs_before
        return format_duration(self._pace.elapsed_s / own * (self._epochs - done))
