"""The help of a verb: what it does, what it needs first, then everything else, and an example."""

from __future__ import annotations

import inspect
import re
import shutil
import textwrap
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import docstring_parser

from vioapr.cli.parameters import Parameter, parameters_of

_INDENT, _TEXT_AT = 2, 24
_WIDEST = 100
"""Columns beyond which lines are hard to read."""
_WITH_STATUSES = ("fuse", "localize")
_METAVARS = {int: "INT", float: "NUMBER", str: "TEXT", Path: "PATH"}


def describe_verb(name: str, function: Callable[..., None]) -> str:
    """Compose the help of a verb from its signature and docstring.

    Args:
        name: A key of `vioapr.cli.verbs.VERBS`.
        function: The verb's.
    """
    width = min(shutil.get_terminal_size().columns, _WIDEST)
    parameters = list(parameters_of(function))
    about, examples = _read_docstring(function)[::2]
    texts = {(one.owner, one.name): text for one, text in describe_parameters(function)}
    own = [one for one in parameters if one.owner is None]
    groups = {
        "needed": [one for one in own if one.is_required or one.is_positional],
        "options": [one for one in own if not (one.is_required or one.is_positional)],
    }
    for one in parameters:
        if one.owner is not None:
            groups.setdefault(_title_of(one.owner), []).append(one)
    parts = [_usage(name, own, width), *(_wrap(text, width) for text in about)]
    for title, members in groups.items():
        if members:
            entries = (_entry(one, texts[one.owner, one.name], width) for one in members)
            parts.append("\n".join([_wrap(f"{title}:", width), *entries]))
    if name in _WITH_STATUSES:
        parts.append(_statuses(width))
    if examples:
        parts.append("\n".join(["example:" if len(examples) == 1 else "examples:", *examples]))
    return "\n\n".join(parts)


def describe_parameters(function: Callable[..., None]) -> Iterator[tuple[Parameter, str]]:
    """Give the parameters of a verb, each with its text; "" where it has none."""
    arguments = _read_docstring(function)[1]
    fields: dict[type, dict[str, str]] = {}
    for one in parameters_of(function):
        if one.owner is None:
            yield one, arguments.get(one.name, "")
        else:
            known = fields.setdefault(one.owner, {}) or _read_fields(one.owner)
            fields[one.owner] = known
            yield one, known.get(one.name, "")


def _statuses(width: int) -> str:
    """What the statuses in a fused CSV mean."""
    from vioapr.fusion.types import Status

    lines = ["statuses (where a frame's pose comes from):"]
    for status in Status:
        text = _wrap(status.meaning, width - _TEXT_AT).splitlines()
        lines.append(f"  {status.label}".ljust(_TEXT_AT) + text[0])
        lines += [" " * _TEXT_AT + line for line in text[1:]]
    return "\n".join(lines)


def _usage(name: str, own: Iterable[Parameter], width: int) -> str:
    words = [one.flag for one in own if one.is_positional]
    words += [f"{one.flag} {_metavar(one)}" for one in own if one.is_required and one.flags]
    return textwrap.fill(
        " ".join([f"usage: vioapr {name}", *words, "[OPTIONS]"]),
        width, subsequent_indent=" " * 7, break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _entry(one: Parameter, text: str, width: int) -> str:
    """A parameter with its text beside it, or below it where it is long."""
    text = " ".join([text, *_notes(one)]).strip()
    head = " " * _INDENT + (", ".join(one.flags) or one.flag)
    if one.flags and one.kind is not bool:
        head += f" {_metavar(one)}"
    lines = _wrap(text, width - _TEXT_AT).splitlines()
    if len(head) < _TEXT_AT - 1 and lines:
        head += " " * (_TEXT_AT - len(head)) + lines.pop(0)
    elif len(head) > width:
        head = textwrap.fill(head, width, subsequent_indent=" " * 6, break_long_words=False)
    return "\n".join([head, *(" " * _TEXT_AT + line for line in lines)])


def _notes(one: Parameter) -> list[str]:
    """What is not said in a parameter's text: the default, unless that is "none" or "no"."""
    default = one.default
    if one.is_required or default in (None, "", ()) or default is inspect.Parameter.empty:
        return []
    if isinstance(default, bool):
        return [f"(default: {one.flag})"] if default else []
    return [f"(default: {default})"]


def _metavar(one: Parameter) -> str:
    for marker in one.markers:
        if metavar := getattr(marker, "metavar", None):
            return str(metavar)
    return _metavar_of(one.kind)


def _metavar_of(kind: Any) -> str:
    if hasattr(kind, "__metadata__"):
        return _metavar_of(get_args(kind)[0])
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        return f"{{{','.join(map(str, inner))}}}"
    if origin in (Union, UnionType):
        return "|".join(_metavar_of(one) for one in inner if one is not NoneType)
    if origin is tuple:
        return " ".join(_metavar_of(one) for one in inner if one is not Ellipsis)
    return _METAVARS.get(kind, getattr(kind, "__name__", str(kind)).upper())


def _title_of(owner: type) -> str:
    """A heading for a dataclass's fields: its name in words, and its first paragraph."""
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", owner.__name__.removesuffix("Params")).lower()
    text = " ".join((inspect.getdoc(owner) or "").split("\n\n")[0].split()).rstrip(".")
    return f"{name} ({text[:1].lower()}{text[1:]})"


def _read_docstring(function: Callable[..., Any]) -> tuple[list[str], dict[str, str], list[str]]:
    """Split a docstring into paragraphs, the arguments' texts, and the lines of examples."""
    text, *sections = re.split(
        r"^(Args|Raises|Returns|Example):\n", inspect.getdoc(function) or "", flags=re.M
    )
    by_title = dict(zip(sections[::2], sections[1::2], strict=True))
    about = [paragraph for paragraph in text.strip().split("\n\n") if paragraph.strip()]
    arguments: dict[str, list[str]] = {}
    for line in textwrap.dedent(by_title.get("Args", "")).splitlines():
        if found := re.match(r"(\w+): (.*)", line):
            arguments[found[1]] = [found[2]]
        elif arguments and line.strip():
            arguments[list(arguments)[-1]].append(line.strip())
    examples = textwrap.dedent(by_title.get("Example", "")).rstrip()
    shown = [f"  {line}" for line in examples.splitlines() if line.strip()]
    return about, {name: " ".join(lines) for name, lines in arguments.items()}, shown


def _read_fields(owner: type) -> dict[str, str]:
    """The texts of a dataclass's fields, in its docstring or below each."""
    parsed = docstring_parser.parse_from_object(owner)
    return {one.arg_name: " ".join((one.description or "").split()) for one in parsed.params}


def _wrap(text: str, width: int) -> str:
    return textwrap.fill(
        " ".join(text.split()), width, break_long_words=False, break_on_hyphens=False
    )
