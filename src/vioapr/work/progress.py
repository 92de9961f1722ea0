"""How long work reports its progress: the types, and reports that nobody sees.

A function with one loop takes a `Tick`, and says how often it calls it. A function with several
stages takes a `Progress`, and opens it once a stage, with the stage's title and number of steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

Tick = Callable[[], object]
"""Called after every step."""


class Advance(Protocol):
    """Called after a step, or, with their number, after several; serves as a `Tick`."""

    def __call__(self, steps: int = 1, /) -> object:
        """Count steps as done."""
        ...


Progress = Callable[[str, int], AbstractContextManager[Advance]]
"""From a stage's title and number of steps, a context that yields what counts them."""


def ignore(steps: int = 1, /) -> None:
    """Count nothing: the `Tick` and `Advance` of work that nobody watches."""


@contextmanager
def silent(title: str, total: int) -> Iterator[Advance]:
    """Show nothing: the `Progress` of work that nobody watches."""
    yield ignore
