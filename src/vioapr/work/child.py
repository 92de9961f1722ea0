"""Running COLMAP in a process of its own: where it cannot write, it ends its process.

A full disk shows in a thread of COLMAP's, which nobody can catch there. So that a user gets a
message and not a crash, each long call runs in a child process, which reports its progress and
dies with its parent.

The process, the call and its result are `concurrent.futures`'. It does not give three things,
which are here: progress comes through a pipe of its own; the child's output goes to a log, which
says why the child died; and the parent's main module is hidden while the child starts, which
would import it otherwise, so that a script without `if __name__ == "__main__"` would call itself.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import re
import signal
import sys
import tempfile
import traceback
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeVar

from vioapr.errors import MappingError, VioAprError
from vioapr.work.progress import Tick

T = TypeVar("T")

_DEATH_SIGNAL = 1
"""Linux's PR_SET_PDEATHSIG."""

_THREADS = "OPENBLAS_NUM_THREADS"

_reports: Connection | None = None
"""In a child: where its ticks go."""


def run_in_child(
    function: Callable[..., T], *arguments: object, tick: Tick, **options: object
) -> T:
    """Call a function in a process of its own, which is killed if this call is interrupted.

    Args:
        function: One of a module's; it takes a further argument `tick`.
        arguments: Its arguments; they are pickled.
        tick: Called whenever the function calls its own.
        options: Its keyword arguments; they are pickled.

    Returns:
        The function's result, which is pickled.

    Raises:
        VioAprError: The function raised it.
        MappingError: The function raised an error that is not ours, or its process died; says
            COLMAP's last words.
    """
    context = multiprocessing.get_context("spawn")
    reports, childs_end = context.Pipe(duplex=False)
    with tempfile.TemporaryDirectory() as folder, reports:
        log = Path(folder) / "log"
        log.touch()
        given = (childs_end, log, os.getpid())
        with ProcessPoolExecutor(1, context, _prepare, given) as pool:
            with hidden_main_module(), _one_linear_algebra_thread():
                future = pool.submit(_call, function, arguments, options)
            childs_end.close()  # then the child's copy is the last, and its end is seen here
            _count_ticks(reports, tick)
            try:
                return future.result()
            except VioAprError:
                raise
            except Exception as error:
                # What COLMAP, or Python, wrote before the process ended.
                text = log.read_text(encoding="utf-8", errors="replace")
                reasons = re.findall(r"what\(\):\s*(.+)", text)
                reasons = reasons or re.findall(r"^\w*Error.*", text, re.MULTILINE)
                reason = reasons[-1].strip() if reasons else "no reason given"
                raise MappingError(
                    f"COLMAP's process ended: {reason[:300]}. Is the disk or the memory full? "
                    "What was finished before is kept: run again to resume"
                ) from error


def _count_ticks(reports: Connection, tick: Tick) -> None:
    """Pass a child's ticks on until it closes the pipe, or dies; kill it if interrupted."""
    pid = None
    try:
        with suppress(EOFError):
            pid = reports.recv()
            while True:
                reports.recv()
                tick()
    except BaseException:
        # The pool would wait for the end of the call.
        with suppress(EOFError, ProcessLookupError):
            os.kill(pid or reports.recv(), signal.SIGKILL)
        raise


@contextmanager
def hidden_main_module() -> Iterator[None]:
    """Hide the main module from processes that are started meanwhile, so they do not run it."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextmanager
def _one_linear_algebra_thread() -> Iterator[None]:
    """NumPy keeps to one thread in processes that are started meanwhile.

    They have threads of their own, and more of OpenBLAS's would wait for each other.
    """
    before = os.environ.get(_THREADS)
    os.environ.setdefault(_THREADS, "1")
    try:
        yield
    finally:
        if before is None:
            del os.environ[_THREADS]


def _prepare(reports: Connection, log: Path, parent_pid: int) -> None:
    """In the child, first of all: die with the parent, write to the log, say the own number."""
    global _reports
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent_pid:  # it died before
        os._exit(1)
    output = os.open(log, os.O_WRONLY | os.O_APPEND)
    os.dup2(output, 1)
    os.dup2(output, 2)
    reports.send(os.getpid())
    _reports = reports


def _call(
    function: Callable[..., T], arguments: Sequence[object], options: Mapping[str, object]
) -> T:
    """In the child: do the work, and close the pipe."""
    assert _reports is not None  # set by `_prepare`
    reports = _reports
    with reports:
        try:
            return function(*arguments, **options, tick=lambda: reports.send(None))
        except Exception:
            traceback.print_exc()  # to the log
            raise
