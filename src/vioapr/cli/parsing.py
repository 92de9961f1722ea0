"""From words to a verb with its parameters; and what is wrong with the words, in one line."""

from __future__ import annotations

import functools
import inspect
import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from vioapr.cli.parameters import Parameter, parameters_of
from vioapr.cli.suggestions import suggest
from vioapr.errors import VioAprError


def parse_flags(
    name: str, function: Callable[..., None], arguments: Sequence[str]
) -> functools.partial[None]:
    """Bind a verb to its flags without running it, so that only parsing errors are rewritten.

    Args:
        name: A key of `vioapr.cli.verbs.VERBS`.
        function: The verb's.
        arguments: What follows the verb.

    Raises:
        VioAprError: They are not the verb's flags.
    """
    import tyro

    see = f"(see vioapr {name} --help)"
    parameters = list(parameters_of(function))
    if problem := find_problem(arguments, parameters):
        raise VioAprError(f"{problem} {see}")

    @functools.wraps(function)
    def bind(*args: object, **kwargs: object) -> functools.partial[None]:
        return functools.partial(function, *args, **kwargs)

    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            call = tyro.cli(bind, prog=f"vioapr {name}", args=arguments, add_help=False)
    except SystemExit:
        raise VioAprError(f"{summarize_parser_message(messages.getvalue())} {see}") from None
    if given := [one for one in given_parameters(arguments, parameters) if one.owner is not None]:
        from vioapr.cli.method_params import find_foreign_flag  # the verb has such flags

        values = inspect.signature(function).bind(*call.args, **call.keywords).arguments
        if problem := find_foreign_flag(given, values):
            raise VioAprError(f"{problem} {see}")
    return call


def find_problem(arguments: Sequence[str], parameters: Sequence[Parameter]) -> str:
    """Find the first unknown flag, or the first value that is none of a flag's choices.

    Returns:
        What is wrong, or nothing.
    """
    by_flag = {flag: one for one in parameters for flag in one.flags}
    if problem := _find_empty_path(arguments, by_flag):
        return problem
    for number, word in _find_flags(arguments):
        given, has_value, value = word.partition("=")
        flag = given.replace("_", "-")
        if flag not in by_flag:
            return f"unknown flag {given}{suggest(given, by_flag)}"
        if not has_value:
            value = arguments[number + 1] if number + 1 < len(arguments) else None
        choices = _choices(by_flag[flag].kind)
        if choices and value is not None and not value.startswith("--") and value not in choices:
            expected = f"expected one of {', '.join(choices)}, got {value!r}"
            return f"{flag}: {expected}{suggest(value, choices)}"
    return ""


def given_parameters(arguments: Sequence[str], parameters: Sequence[Parameter]) -> list[Parameter]:
    """The parameters whose flags are given, whatever the values."""
    by_flag = {flag: one for one in parameters for flag in one.flags}
    flags = (word.partition("=")[0].replace("_", "-") for _, word in _find_flags(arguments))
    return [by_flag[flag] for flag in flags if flag in by_flag]


def _find_flags(arguments: Sequence[str]) -> Iterator[tuple[int, str]]:
    """The words that are flags, with their places."""
    for number, word in enumerate(arguments):
        if word == "--":
            return
        if word.startswith("--") or re.match(r"-[A-Za-z]", word):
            yield number, word


def _find_empty_path(arguments: Sequence[str], by_flag: dict[str, Parameter]) -> str:
    """Find a path that is an empty text: it would mean the current folder.

    Nobody writes that: a shell does, where a variable is not set.
    """
    before = ""
    for word in arguments:
        given, has_value, value = word.partition("=")
        one = by_flag.get(given.replace("_", "-") if has_value else before.replace("_", "-"))
        is_path = "Path" in str(one.kind) if one is not None else not before.startswith("--")
        if is_path and (word == "" or (has_value and one is not None and value == "")):
            flag = f"{one.flag}: " if one is not None else ""
            return f"{flag}expected a path, got an empty text: is a variable of the shell not set?"
        before = word
    return ""


def _choices(kind: Any) -> list[str]:
    """The values that a type of choices has; nothing for other types."""
    if get_origin(kind) is Literal:
        return [str(value) for value in get_args(kind)]
    if get_origin(kind) in (Union, UnionType):
        return [choice for one in get_args(kind) for choice in _choices(one)]
    return []


def summarize_parser_message(box: str) -> str:
    """Say in one line what the parser says in a box of several, drawn or plain.

    Args:
        box: A title, then sections with lines between them: the message, then hints.
    """
    lines = [line.strip("│╭╮╰╯").rstrip() for line in box.splitlines()[1:]]  # without the title
    margin = min(len(line) - len(line.lstrip()) for line in lines if line.strip(" ─-"))
    message: list[str] = []
    for line in lines:
        if line.strip(" ─-"):
            message.append(line[margin:])
        elif line.strip() and message:
            break
    if message[0].startswith("Missing from"):
        found = [re.match(r" {4}(\S+)", line) for line in message[1:]]
        return f"missing {', '.join(match[1] for match in found if match)}"
    text = " ".join(line.strip() for line in message).rstrip(".")
    if found := re.match(r"Missing value for argument '(\S+)'", text):
        return f"{found[1]}: expected a value after it, got none"
    if found := re.match(r"Error parsing (\S+): could not convert string to float: (.*)", text):
        return f"{found[1]}: expected a number, got {found[2]}"
    if found := re.match(r"Error parsing (\S+): invalid literal for int\(\) .*: (.*)", text):
        return f"{found[1]}: expected a whole number, got {found[2]}"
    if found := re.match(r"Unrecognized options: (.*)", text):
        return f"expected no more than the files that the verb takes, got also {found[1]}"
    return text
