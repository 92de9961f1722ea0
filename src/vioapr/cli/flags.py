"""Flags: their names for those of parameters in the library's messages, and lists as values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from typing import Any, get_args, get_type_hints

from vioapr.errors import ParameterError, VioAprError


def split_names(text: str) -> list[str]:
    """Split the value of a flag that takes names separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def flag_names(function: Callable[..., Any]) -> dict[str, str]:
    """Map the parameters of a verb, and the fields of its dataclasses, to flags.

    A field is known as `Class.field`, and by its name alone where no other class has it.
    """
    flags: dict[str, str] = {}
    for owner, name, flag in _parameters(function):
        if owner:
            flags[f"{owner}.{name}"] = flag
        flags[name] = flag if flags.get(name, flag) == flag else ""
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


def _parameters(owner: Any) -> Iterator[tuple[str, str, str]]:
    """Yield class (or ""), name and flag of every parameter, as the parser names it."""
    for name, hint in get_type_hints(owner, include_extras=True).items():
        kind, *extras = get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
        if isinstance(kind, type) and is_dataclass(kind):
            yield from _parameters(kind)
        elif name != "return":
            given = [getattr(extra, "name", None) for extra in extras]
            flag = f"--{next(filter(None, given), name.strip('_').replace('_', '-'))}"
            if "Positional" in map(repr, extras):
                metavars = [getattr(extra, "metavar", None) for extra in extras]
                flag = next(filter(None, metavars), name.upper())
            yield owner.__name__ if isinstance(owner, type) else "", name, flag
