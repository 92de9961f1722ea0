"""Being stopped from outside: signals become one exception, which work may put off for a moment."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
"""Ctrl-C, what the system and job schedulers send, and a terminal that is closed."""


class Stopped(KeyboardInterrupt):
    """The process was asked to end.

    A `KeyboardInterrupt`, as nothing that Ctrl-C unwinds should go on after another signal.

    Attributes:
        signal_number: Which signal asked.
        advice: What is kept and how to go on, where the work knows it; else "".
    """

    def __init__(self, signal_number: int, advice: str = "") -> None:
        """Say which signal it was; see the attributes."""
        self.signal_number, self.advice = signal_number, advice
        super().__init__(signal_number, advice)


def raise_on_signals() -> None:
    """Let signals that ask a process to end raise `Stopped`, so that it can tidy up.

    Signals that are ignored, as `nohup` does, stay so. For the main thread of a program.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise)


def _raise(number: int, frame: FrameType | None) -> None:
    raise Stopped(number)


class PendingStop:
    """Whether a stop was asked for, while it is put off.

    Attributes:
        signal_number: The signal that asked, or None.
    """

    def __init__(self) -> None:
        """Nothing was asked for yet."""
        self.signal_number: int | None = None


@contextmanager
def stop_put_off() -> Iterator[PendingStop]:
    """Put off being stopped, so that work can look for it where it may end; a second time ends it.

    In other threads than the main one, signals are not handled: nothing changes there.

    Yields:
        What says whether a stop was asked for.
    """
    pending = PendingStop()
    if threading.current_thread() is not threading.main_thread():
        yield pending
        return

    def note(number: int, frame: FrameType | None) -> None:
        if pending.signal_number is not None:
            raise Stopped(number)
        pending.signal_number = number

    before = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        # Python's own for Ctrl-C, or `raise_on_signals`; others are the program's choice.
        if handler in (signal.default_int_handler, _raise):
            signal.signal(number, note)
    try:
        yield pending
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
