"""The entry point: parses, runs a verb, and turns users' errors into one line and exit code 2.

Only the chosen verb's module is imported, and the parser only once a verb is known: help and
mistyped verbs should not wait for NumPy.
"""

from __future__ import annotations

import functools
import io
import os
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr

from vioapr._version import __version__
from vioapr.cli.verbs import VERBS, describe_verbs
from vioapr.errors import VioAprError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Without the program's name; None for the process's own.

    Returns:
        Exit code: 0, or 2 where the user can mend what is wrong.
    """
    try:
        run(sys.argv[1:] if arguments is None else list(arguments))
        sys.stdout.flush()
    except VioAprError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output has gone, e.g. `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def run(arguments: list[str]) -> None:
    """Run the verb that the arguments name, or print the list of verbs.

    Raises:
        VioAprError: There is no such verb, its flags cannot be parsed, or it fails.
        SystemExit: The verb's own help was asked for, and is printed.
    """
    for words in (2, 1):  # `scene check` is a verb of two words
        name = " ".join(arguments[:words])
        if name in VERBS:
            function = VERBS[name].load()
            try:
                parse_flags(name, function, arguments[words:])()
            except VioAprError as error:
                from vioapr.cli.flags import flag_names, name_flags

                raise VioAprError(name_flags(error, flag_names(function))) from error
            return
    first, *rest = arguments or ["--help"]
    prefix = next((first for name in VERBS if name.split()[0] == first), "")
    if (rest[0] if prefix and rest else first) in ("-h", "--help"):
        print(
            f"usage: vioapr {prefix or 'VERB'} ...\n\n"
            "Robust absolute poses from a pose regressor and a phone's visual-inertial odometry."
            f"\n\n{describe_verbs(prefix)}\n\n"
            "vioapr VERB --help explains a verb and its flags."
        )
    elif first == "--version":
        print(f"vioapr {__version__}")
    else:
        known = [name for name in VERBS if not prefix or name.split()[0] == prefix]
        raise VioAprError(
            f"unknown verb {' '.join(arguments[: 2 if prefix else 1])!r}: expected one of "
            f"{', '.join(known)} (see vioapr --help)"
        )


def parse_flags(
    name: str, function: Callable[..., None], arguments: Sequence[str]
) -> Callable[[], None]:
    """Bind a verb to its flags without running it, so that only parsing errors are rewritten.

    Args:
        name: A key of `VERBS`.
        function: The verb's.
        arguments: What follows the verb.

    Raises:
        VioAprError: They are not the verb's flags.
        SystemExit: Help was asked for, and is printed.
    """
    import tyro

    @functools.wraps(function)
    def bind(*args: object, **kwargs: object) -> Callable[[], None]:
        return functools.partial(function, *args, **kwargs)

    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            return tyro.cli(bind, prog=f"vioapr {name}", args=arguments)
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        problem = summarize_parser_message(messages.getvalue())
        raise VioAprError(f"{problem} (see vioapr {name} --help)") from None


def summarize_parser_message(box: str) -> str:
    """Say in one line what the parser says in a box of several, drawn or plain.

    Args:
        box: A title, then sections with lines between them: the message, then hints.
    """
    lines = [line.strip("│╭╮╰╯").rstrip() for line in box.splitlines()[1:]]  # without the title
    margin = min(len(line) - len(line.lstrip()) for line in lines if line.strip(" ─-"))
    sections: list[list[str]] = [[]]
    for line in lines:
        if line.strip(" ─-"):
            sections[-1].append(line[margin:])
        elif line.strip():
            sections.append([])
    message, *hints = (section for section in sections if section)
    if message[0].startswith("Missing from"):
        return f"missing {', '.join(_names_in(message))}"
    similar = [
        name
        for hint in hints
        if hint[0].startswith(("Perhaps you meant", "Arguments similar"))
        for name in _names_in(hint)
    ]
    text = " ".join(line.strip() for line in message).rstrip(".")
    return f"{text}; perhaps {' or '.join(similar)}" if similar else text


def _names_in(section: list[str]) -> list[str]:
    """Flags and positional arguments that a section lists; their texts are indented further."""
    found = [re.match(r" {4}(\S+)", line) for line in section[1:]]
    return [match[1] for match in found if match]
