"""The entry point: parses, runs a verb, and turns users' errors into one line and an exit code.

Only the chosen verb's module is imported, and the parser only once a verb is known: help and
mistyped verbs should not wait for NumPy.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from vioapr._version import __version__
from vioapr.cli.going_on import describe_full_disk, describe_stop, exit_code_of
from vioapr.cli.verbs import FAMILIES, VERBS, describe_family, describe_verbs
from vioapr.errors import FileMissingError, VioAprError
from vioapr.work.stopping import raise_on_signals

DONE, MENDABLE = 0, 2
"""Exit codes. A fault of ours ends with a traceback and 1, a signal with `exit_code_of`."""

_HELP, _VERSION = ("-h", "--help"), ("-V", "--version")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Without the program's name; None for the process's own.

    Returns:
        Exit code: 0; 2 where the user can mend what is wrong; 128 and the signal's number where
        one ended it, as 130 for Ctrl-C.
    """
    if arguments is None:
        raise_on_signals()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # a sign that it has not is no reason to fail
                stream.reconfigure(errors="backslashreplace")
    words = sys.argv[1:] if arguments is None else list(arguments)
    try:
        run(words)
        sys.stdout.flush()
    except VioAprError as error:
        print(f"error: {error}{describe_full_disk(error, words)}", file=sys.stderr)
        return MENDABLE
    except BrokenPipeError:  # the reader of our output has gone, e.g. `| head`
        close_stdout()
        return DONE
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
            raise
        close_stdout()
        where = error.filename or "standard output"
        print(f"error: {where}: cannot be written: {error.strerror}", file=sys.stderr)
        return MENDABLE
    except KeyboardInterrupt as stop:
        print(describe_stop(stop, words), file=sys.stderr)
        return exit_code_of(stop)
    return DONE


def close_stdout() -> None:
    """Give up standard output: what is still to be written would fail again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def run(arguments: list[str]) -> None:
    """Run the verb that the arguments name, or print the help or version that they ask for.

    Raises:
        VioAprError: There is no such verb, its flags cannot be parsed, or it fails.
    """
    while arguments[:1] == ["help"]:  # `help help` too
        arguments = [*arguments[1:], "--help"]
    first, *rest = arguments or ["--help"]
    flags = arguments[: arguments.index("--")] if "--" in arguments else arguments
    name = next((name for n in (2, 1) if (name := " ".join(arguments[:n])) in VERBS), None)
    if name is None and first in FAMILIES:
        if rest and not rest[0].startswith("-"):
            raise VioAprError(unknown_verb(" ".join(arguments[:2])))
    elif name is None and not first.startswith("-"):
        raise VioAprError(unknown_verb(first))
    if any(flag in flags for flag in _VERSION):
        print(f"vioapr {__version__}")
    elif name is not None:
        run_verb(name, arguments[len(name.split()) :])
    elif first in FAMILIES and (not rest or rest[0] in _HELP):
        print(describe_family(first))
    elif first in _HELP:
        print(describe_verbs())
    else:
        word = rest[0] if first in FAMILIES else first
        raise VioAprError(f"expected a verb before flags, got {word} (see vioapr --help)")


def run_verb(name: str, arguments: list[str]) -> None:
    """Run a verb, or print its help.

    Raises:
        VioAprError: Its flags cannot be parsed, or it fails; the message names flags.
    """
    function = VERBS[name].load()
    flags = arguments[: arguments.index("--")] if "--" in arguments else arguments
    if any(flag in flags for flag in _HELP):
        from vioapr.cli.help import describe_verb

        print(describe_verb(name, function))
        return
    from vioapr.cli.console import renamed, start_verb
    from vioapr.cli.parsing import parse_flags
    from vioapr.cli.streams import connected

    start_verb(flags)
    try:
        with connected(function, parse_flags(name, function, arguments)) as call:
            call()
    except VioAprError as error:
        from vioapr.cli.flags import flag_names, name_flags
        from vioapr.cli.suggestions import suggest_choice, suggest_path

        message = renamed(name_flags(error, flag_names(function)))
        if isinstance(error, FileMissingError):
            message += suggest_path(Path(error.path))
        raise VioAprError(message + suggest_choice(message)) from error
    except MemoryError as error:
        raise VioAprError(f"not enough memory: {error or 'the machine has no more'}") from error
    finally:
        start_verb()


def unknown_verb(given: str) -> str:
    """Say that there is no such verb, and which ones were perhaps meant, or else all."""
    from vioapr.cli.suggestions import similar_names

    family, _, second = given.rpartition(" ")
    if family:
        known = [name for name in VERBS if name.split()[0] == family]
        meant = {name.split()[1]: name for name in known}
    else:  # a verb of two words may be meant by either of them
        known = list(VERBS)
        meant = {name.split()[-1]: name for name in known} | {one: one for one in FAMILIES}
    perhaps = [meant[name] for name in similar_names(second, meant)]
    if not perhaps:
        return f"unknown verb {given!r}: expected one of {', '.join(known)} (see vioapr --help)"
    return f"unknown verb {given!r}: perhaps {' or '.join(perhaps)} (see vioapr --help)"
