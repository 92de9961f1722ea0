"""What is said when a verb is stopped, or the disk is full: what is kept, and how to go on."""

from __future__ import annotations

import signal
from collections.abc import Sequence

from vioapr.errors import DiskFullError
from vioapr.work.stopping import Stopped

_KEPT = {
    "scene": "images that were looked at are kept: run it again to go on",
    "build": "finished steps are kept: run it again to go on",
    "map": "finished steps are kept: run it again to go on",
    "import": "finished recordings are kept: run it again to go on",
    "predict": "finished recordings are kept: run it again to go on",
    "reproduce": "what is finished is kept: run it again to go on",
    "train": "a run that has a state.safetensors goes on with --resume, others begin again",
    "simulate": "nothing was left behind: run it again",
}
"""By the verb's first word."""

_WHOLE = "no file is half-written: run it again"


def advice_for(arguments: Sequence[str]) -> str:
    """Say what a verb that was stopped has kept, and how to go on."""
    return _KEPT.get(arguments[0] if arguments else "", _WHOLE)


def describe_stop(stop: KeyboardInterrupt, arguments: Sequence[str]) -> str:
    """Say that the program was stopped, what is kept, and how to go on."""
    is_terminated = isinstance(stop, Stopped) and stop.signal_number != signal.SIGINT
    # Of verbs that only train among other work, the whole goes on otherwise.
    known = ""
    if isinstance(stop, Stopped) and arguments[:1] == ["train"]:
        known = stop.advice.replace("`resume`", "--resume")
    advice = known or advice_for(arguments)
    return f"{'terminated' if is_terminated else 'interrupted'}: {advice}"


def exit_code_of(stop: KeyboardInterrupt) -> int:
    """The exit code by which shells tell a signal: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + (stop.signal_number if isinstance(stop, Stopped) else signal.SIGINT)


def describe_full_disk(error: BaseException, arguments: Sequence[str]) -> str:
    """What to do if an error, or one that it was made of, is a full disk; else ""."""
    found: BaseException | None = error
    while found is not None:
        if isinstance(found, DiskFullError):
            return f". Free some space; {advice_for(arguments)}"
        found = found.__cause__
    return ""
