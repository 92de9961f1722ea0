"""Flags: their names for those of parameters in the library's messages, and lists as values."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from vioapr.cli.parameters import parameters_of
from vioapr.errors import ParameterError, VioAprError


def split_names(text: str) -> list[str]:
    """Split the value of a flag that takes names separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def flag_names(function: Callable[..., Any]) -> dict[str, str]:
    """Map the parameters of a verb, and the fields of its dataclasses, to flags.

    A field is known as `Class.field`, and by its name alone where no other class has it.
    """
    flags: dict[str, str] = {}
    for one in parameters_of(function):
        if one.owner:
            flags[f"{one.owner.__name__}.{one.name}"] = one.flag
        flags[one.name] = one.flag if flags.get(one.name, one.flag) == one.flag else ""
    return {name: flag for name, flag in flags.items() if flag}


def name_flags(error: VioAprError, flags: dict[str, str]) -> str:
    """Compose an error's message with flags for the names of parameters.

    Names count where nothing else can be meant: in backticks, and in a `ParameterError` also
    before its first colon (`seed: expected ...`) and wherever they have an underscore.

    Args:
        error: Of the library.
        flags: From `flag_names`.
    """
    message = fill_flags(str(error), flags)
    if not isinstance(error, ParameterError):
        return message
    head, colon, rest = message.partition(": ")
    words = re.split(r",? and |, ", head)
    if colon and all(word in flags for word in words):
        return re.sub(r"[\w.]+", lambda m: flags.get(m[0], m[0]), head) + colon + _fill(rest, flags)
    return _fill(message, flags)


def fill_flags(text: str, flags: dict[str, str]) -> str:
    """Put flags in place of the names of parameters in backticks.

    Args:
        text: Of the library.
        flags: From `flag_names`.
    """
    return re.sub(r"`([\w.]+)`", lambda m: flags.get(m[1], m[0]), text)


def _fill(text: str, flags: dict[str, str]) -> str:
    """Replace names with an underscore, which are no words and, alone, no paths."""
    pattern = r"(?<![\w./-])[A-Za-z]+(?:\.\w+)?_\w+(?![\w/-]|\.\w)"
    return re.sub(pattern, lambda m: flags.get(m[0], m[0]), text)
