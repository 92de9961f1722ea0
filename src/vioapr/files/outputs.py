"""Outputs, looked at before the work: none may destroy an input, or a result that is kept."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from vioapr.errors import AlreadyExistsError, ParameterError, UnwritableError
from vioapr.files.atomic import own_descriptor

STANDARD_STREAM = Path("-")
"""How a user names standard input or output."""


def check_outputs(
    outputs: Iterable[Path | None],
    inputs: Iterable[Path | None] = (),
    *,
    overwrite: bool = False,
) -> None:
    """See that files may be written: to be called before the work that makes their content.

    Two paths are the same file whatever they are called: through links, through other spellings,
    and as hard links. Pipes and devices, such as `/dev/stdout`, may always be written.

    Args:
        outputs: Files to be written; None for those that were not asked for.
        inputs: Files that the work reads, and folders all of whose files it may read.
        overwrite: Whether files that exist may be replaced; inputs never are.

    Raises:
        ParameterError: An output is an input, or another output.
        AlreadyExistsError: An output exists, and is not to be replaced.
        UnwritableError: An output is a folder or cannot be looked at, or its folder is a file.
    """
    read = [path for path in inputs if path is not None and not is_stream(path)]
    seen: list[Path] = []
    for output in outputs:
        if output is None or is_stream(output):
            continue
        if (given := _find_same(output, read)) is not None:
            named = "the input" if given == output else f"the input {given}"
            raise ParameterError(f"{output} is {named}: write to another file")
        if (folder := _find_around(output, read)) is not None and output.exists():
            raise ParameterError(f"{output} is a part of the input {folder}: write to another file")
        if (other := _find_same(output, seen)) is not None:
            named = "also" if other == output else f"the same file as {other},"
            raise ParameterError(f"{output} is {named} another output: give each a file of its own")
        _check_free(output, overwrite)
        seen.append(output)


def is_stream(path: Path) -> bool:
    """Whether a path means a stream rather than a file: `-`, `/dev/stdout`, a pipe, a device."""
    if path == STANDARD_STREAM or own_descriptor(path) is not None:
        return True
    try:
        return path.exists() and not path.is_file() and not path.is_dir()
    except OSError:
        return False


def is_same_file(one: Path, other: Path) -> bool:
    """Whether two paths lead to one file, that may not be there yet."""
    try:
        if os.path.realpath(one) == os.path.realpath(other):
            return True
        return one.exists() and other.exists() and one.samefile(other)
    except OSError:
        return False


def _find_same(path: Path, others: Sequence[Path]) -> Path | None:
    return next((other for other in others if is_same_file(path, other)), None)


def _find_around(path: Path, others: Sequence[Path]) -> Path | None:
    """The first of some folders that a path lies in."""
    above = Path(os.path.realpath(path)).parents
    return next((other for other in others if Path(os.path.realpath(other)) in above), None)


def _check_free(output: Path, overwrite: bool) -> None:
    """See that a file can be written, and that none is replaced that is to be kept."""
    try:
        if output.is_dir():
            raise UnwritableError(output, "cannot be written: it is a folder")
        if output.exists() and not overwrite:
            raise AlreadyExistsError(output, "exists: choose another name, or give `overwrite`")
    except OSError as error:
        raise UnwritableError(output, f"cannot be looked at: {error.strerror}") from None
    above = next((folder for folder in output.parents if folder.exists()), None)
    if above is not None and not above.is_dir():
        raise UnwritableError(output, f"cannot be written: {above} is no folder")
