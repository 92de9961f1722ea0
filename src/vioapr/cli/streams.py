"""`-` as the name of a file: standard input or output.

Formats are recognized, and files are replaced, by path. So what comes in is put into a temporary
file first, and what goes out comes from one. While data go to standard output, messages go to
standard error.
"""

from __future__ import annotations

import inspect
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

from vioapr.cli.console import call_paths, send_messages_aside
from vioapr.errors import ParameterError, UnwritableError

STANDARD = Path("-")
"""The name that stands for standard input or output."""


class Stream(Enum):
    """What `-` means as the value of a parameter."""

    INPUT = "standard input"
    OUTPUT = "standard output"


InputFile = Annotated[Path, Stream.INPUT]
"""A file to read, or `-`."""
OutputFile = Annotated[Path, Stream.OUTPUT]
"""A file to write, or `-`."""


@contextmanager
def connected(function: Callable[..., None], call: partial[None]) -> Iterator[Callable[[], None]]:
    """Put temporary files in the place of `-`, and connect them with the standard streams.

    Args:
        function: The verb's.
        call: The same with all its parameters.

    Yields:
        The call to make. After it, what was written goes to standard output.

    Raises:
        ParameterError: `-` is given where it means nothing, or twice.
        UnwritableError: There is no room for a temporary file.
    """
    hints = get_type_hints(function, include_extras=True)
    bound = inspect.signature(function).bind(*call.args, **call.keywords)
    given = bound.arguments
    users = {name: _stream(hints[name]) for name in given if _has_standard(given[name])}
    for name, stream in users.items():
        if stream is None:
            raise ParameterError(f"`{name}`: expected a path: - has no meaning here")
    for stream in Stream:
        names = [f"`{name}`" for name, one in users.items() if one is stream]
        if stream is Stream.OUTPUT and given.get("form") in ("csv", "json"):
            names.append("`form`")
        if len(names) > 1:
            raise ParameterError(f"expected {stream.value} once, got it for {' and '.join(names)}")
        if names and stream is Stream.OUTPUT:
            send_messages_aside()
    if not users:
        yield partial(function, *bound.args, **bound.kwargs)
        return
    with tempfile.TemporaryDirectory(prefix="vioapr-") as folder:
        paths = {stream: Path(folder, stream.name.lower()) for stream in Stream}
        call_paths({str(path): stream.value for stream, path in paths.items()})
        for name, stream in users.items():
            assert stream is not None  # refused above
            given[name] = _replace_standard(given[name], paths[stream])
        if Stream.INPUT in users.values():
            _spool(paths[Stream.INPUT])
        yield partial(function, *bound.args, **bound.kwargs)
        _print(paths[Stream.OUTPUT])


def _spool(path: Path) -> None:
    try:
        with path.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
    except OSError as error:
        raise UnwritableError.of(path, error) from None


def _print(path: Path) -> None:
    if path.is_dir():
        raise ParameterError("expected a format of one file for standard output, got a folder")
    if path.is_file():
        sys.stdout.flush()
        with path.open("rb") as file:
            shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.buffer.flush()


def _stream(hint: Any) -> Stream | None:
    """The stream that a type says, wherever in it."""
    for inner in (*getattr(hint, "__metadata__", ()), *get_args(hint)):
        found = inner if isinstance(inner, Stream) else _stream(inner)
        if found is not None:
            return found
    return None


def _has_standard(value: object) -> bool:
    return value == STANDARD or (isinstance(value, tuple) and STANDARD in value)


def _replace_standard(value: Any, path: Path) -> Any:
    if isinstance(value, tuple):
        return tuple(path if one == STANDARD else one for one in value)
    return path
