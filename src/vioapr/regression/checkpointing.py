"""When a training within an epoch keeps its state: by time, and when it is asked to stop."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import torch
from lightning_fabric import Fabric
from torch import Tensor

from vioapr.work.stopping import PendingStop, Stopped

FIRST_S = 45.0
"""The first checkpoint comes within a minute of training, whatever the time between others."""

_STEPS_BETWEEN_LOOKS = 10
"""Several processes look at the clock together, which makes them wait for each other."""


class CheckpointClock:
    """Says after which step the state is to be kept."""

    def __init__(
        self,
        fabric: Fabric,
        every_s: float,
        pending: PendingStop,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count.

        Args:
            fabric: The processes; they keep their states together.
            every_s: Seconds between checkpoints, at least 0.
            pending: Whether a stop was asked for.
            clock: Seconds since some moment.
        """
        self._fabric, self._every_s, self._clock = fabric, every_s, clock
        self._pending = pending
        self._due_s = clock() + min(every_s, FIRST_S)
        self._steps = 0

    @property
    def is_stopping(self) -> bool:
        """Whether the state is to be kept because the training is to end."""
        # A signal reaches several processes after different steps: they end without a state.
        return self._fabric.world_size == 1 and self._pending.signal_number is not None

    def is_due(self) -> bool:
        """Whether the state is to be kept now; called after every step, by all processes."""
        self._steps += 1
        if self._fabric.world_size > 1 and self._steps % _STEPS_BETWEEN_LOOKS:
            return False
        is_due = self._clock() >= self._due_s
        if self._fabric.world_size > 1:
            is_due = bool(self._fabric.broadcast(is_due))
        return is_due or self.is_stopping

    def raise_if_stopping(self, folder: Path) -> None:
        """End the training if that was asked for: its state is in this folder.

        Raises:
            Stopped: It was.
        """
        if self.is_stopping and self._pending.signal_number is not None:
            kept = f"the training's state is kept in {folder}: `resume` goes on with it"
            raise Stopped(self._pending.signal_number, kept)

    def restart(self) -> None:
        """Begin to count again: the state has just been kept."""
        self._due_s = self._clock() + self._every_s


def random_states(fabric: Fabric) -> Tensor:
    """The states of PyTorch's generators, of all processes, shape (processes, bytes), uint8."""
    states = [torch.get_rng_state()]
    if fabric.device.type == "cuda":
        states.append(torch.cuda.get_rng_state(fabric.device))
    own = torch.cat(states)
    if fabric.world_size == 1:
        return own[None]
    gathered = fabric.all_gather(own.to(fabric.device))
    assert isinstance(gathered, Tensor)
    return gathered.cpu()


def set_random_state(fabric: Fabric, states: Tensor) -> None:
    """Set this process's generators as `random_states` found them.

    With another number or kind of devices than then they stay as they are.
    """
    cpu_bytes = len(torch.get_rng_state())
    if len(states) != fabric.world_size:
        return
    own = states[fabric.global_rank]
    torch.set_rng_state(own[:cpu_bytes].clone())
    if fabric.device.type == "cuda" and len(own) > cpu_bytes:
        torch.cuda.set_rng_state(own[cpu_bytes:].clone(), fabric.device)
