"""Running COLMAP in a process of its own: where it cannot write, it ends its process.

A full disk shows in a thread of COLMAP's, which nobody can catch there. So that a user gets a
message and not a crash, each long call runs in a child process, which reports its progress and
dies with its parent.
"""

from __future__ import annotations

import ctypes
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from typing import Any

from vioapr.errors import MappingError, VioAprError

_SERVE = "import sys; sys.path[:] = {path!r}; from vioapr.work.child import serve; serve()"
_DEATH_SIGNAL = 1
"""Linux's PR_SET_PDEATHSIG."""


def run_isolated(
    function: Callable[..., Any], *arguments: Any, tick: Callable[[], object], **options: Any
) -> Any:
    """Call a function in a process of its own.

    Args:
        function: One of a module's; it takes a further argument `tick`.
        arguments: Its arguments; they are pickled.
        tick: Called whenever the function calls its own.
        options: Its keyword arguments, likewise.

    Returns:
        What it returned, which must be plain data.

    Raises:
        MappingError: It raised an error of ours, or its process died.
    """
    command = [sys.executable, "-c", _SERVE.format(path=sys.path)]
    with tempfile.TemporaryFile() as log:
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log)
        try:
            answer = _talk(child, pickle.dumps((function, arguments, options)), tick)
        finally:
            child.kill()
            child.wait()
        if "result" in answer:
            return answer["result"]
        if "error" in answer:
            raise MappingError(answer["error"])
        log.seek(0)
        raise MappingError(_explain(log.read().decode(errors="replace")))


def _talk(child: subprocess.Popen[bytes], job: bytes, tick: Callable[[], object]) -> dict[str, Any]:
    """Send the job and follow it to its answer; empty if the child dies."""
    assert child.stdin is not None  # both are pipes
    assert child.stdout is not None
    with child.stdin, child.stdout:
        try:
            child.stdin.write(job)
            child.stdin.close()
        except BrokenPipeError:
            return {}
        for line in child.stdout:
            message = json.loads(line)
            if "tick" not in message:
                return message
            tick()
    return {}


def _explain(log: str) -> str:
    """What COLMAP wrote before its process ended, as one sentence."""
    reasons = re.findall(r"what\(\):\s*(.+)", log) or re.findall(r"^\w*Error.*", log, re.MULTILINE)
    reason = reasons[-1].strip() if reasons else "no reason given"
    return (
        f"COLMAP's process ended: {reason[:300]}. Is the disk or the memory full? What was "
        "finished before is kept: run again to resume"
    )


def serve() -> None:
    """The child's side: take a job from standard input, report on standard output."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
    # Whatever else prints must not get between the messages.
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)

    def send(message: dict[str, Any]) -> None:
        out.write(json.dumps(message) + "\n")

    function, arguments, options = pickle.loads(sys.stdin.buffer.read())
    try:
        result = function(*arguments, **options, tick=lambda: send({"tick": 1}))
    except VioAprError as error:
        send({"error": str(error)})
    else:
        send({"result": result})
