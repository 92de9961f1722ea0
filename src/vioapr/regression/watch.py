"""Watching a training: what it tells somebody, without PyTorch."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from vioapr.schemas.regressor import EpochRecord


class StepsOfEpoch(NamedTuple):
    """How an epoch goes.

    Attributes:
        epoch: Its number, from 1.
        step: Steps of it that are done.
        steps: All that it has.
        loss: Mean of those that are done.
        images_per_s: Of all processes together.
    """

    epoch: int
    step: int
    steps: int
    loss: float
    images_per_s: float


class Watch(Protocol):
    """Watches a training from its first process."""

    def is_due(self) -> bool:
        """Whether to be told of the last step; a GPU waits while the loss is fetched."""
        ...

    def tell_steps(self, done: StepsOfEpoch) -> None:
        """Hear how an epoch goes."""
        ...

    def tell_epoch(self, epoch: int, steps: int, record: EpochRecord) -> None:
        """Hear that an epoch, counted from 1, is done, and how many steps it had."""
        ...
