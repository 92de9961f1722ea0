"""How far work has come, in lines for a file: one after ten seconds, then every half minute."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

FIRST_S, EVERY_S = 10.0, 30.0
"""Seconds before the first line, and between lines after it."""


class Pace:
    """Says when the next line is due."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin to count.

        Args:
            clock: Seconds since some moment.
        """
        self._clock = clock
        self._begin_s = clock()
        self._due_s = self._begin_s + FIRST_S

    @property
    def elapsed_s(self) -> float:
        """Since the beginning."""
        return self._clock() - self._begin_s

    def is_due(self) -> bool:
        """Whether a line is due; if so, the next one is due later."""
        if self._clock() < self._due_s:
            return False
        self._due_s = self._clock() + EVERY_S
        return True


class ProgressLines:
    """Prints a line now and then about work of many steps, and one at the end of long work."""

    def __init__(
        self,
        title: str,
        total: int,
        write: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count.

        Args:
            title: Of the work.
            total: Number of its steps.
            write: Prints a line.
            clock: Seconds since some moment.
        """
        self._title, self._total, self._write = title, total, write
        self._pace, self._done, self._has_spoken = Pace(clock), 0, False

    def advance(self, steps: int = 1, /) -> None:
        """Count steps as done, and print a line if one is due."""
        self._done += steps
        if self._pace.is_due():
            self._has_spoken = True
            self._write(self._line())

    def _line(self) -> str:
        elapsed_s = self._pace.elapsed_s
        left = max(self._total - self._done, 0)
        share = f" ({self._done / self._total:.0%})" if self._total else ""
        eta = format_duration(elapsed_s * left / self._done) if self._done else "unknown"
        rate = self._done / elapsed_s if elapsed_s else 0.0
        return (
            f"{self._title}: {self._done} of {self._total}{share}, {format_rate(rate)}, "
            f"{format_duration(elapsed_s)} so far, ETA {eta}"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and self._has_spoken:
            self._write(f"{self._title}: done in {format_duration(self._pace.elapsed_s)}")


def format_rate(per_s: float) -> str:
    """Steps a second, or, where they take longer, seconds a step."""
    return f"{per_s:.3g}/s" if per_s >= 1 or per_s == 0 else f"{1 / per_s:.3g} s each"


def format_duration(seconds: float) -> str:
    """A duration as people say it: `48 s`, `3 min 05 s`, `2 h 10 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
