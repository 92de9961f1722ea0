"""What the command line prints with: data, messages, and how far work has come."""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from vioapr.cli.progress_lines import ProgressLines
from vioapr.errors import SuspectTrackError
from vioapr.work.noted_progress import noted_progress
from vioapr.work.processes import is_first_process
from vioapr.work.progress import Advance

if TYPE_CHECKING:
    from vioapr.formats.notes import ReadingNote
    from vioapr.formats.track_warnings import TrackWarning

# Of several training processes, the first one speaks for all.
_IS_FIRST = is_first_process()

_console = Console(highlight=False, quiet=not _IS_FIRST)
error_console = Console(stderr=True, highlight=False, quiet=not _IS_FIRST)
_is_data_on_stdout = False
_called: dict[str, str] = {}
_flags: frozenset[str] = frozenset()
"""Temporary files, and what they are called in messages and data."""


def is_watched() -> bool:
    """Whether somebody looks at standard error as it is written, and it can be overwritten."""
    return error_console.is_terminal and not error_console.is_dumb_terminal and _IS_FIRST


def width() -> int:
    """Columns to print in: `COLUMNS`, else the terminal's, else 80."""
    return max(shutil.get_terminal_size().columns, 20)


def say(text: str, style: str = "") -> None:
    """Print a line as it is, however long: a path must not be broken, nor its brackets read.

    Args:
        text: Usually "path: fact about it".
        style: Of rich, e.g. "bold" or "yellow".
    """
    _messages().print(Text(renamed(text), style=style), soft_wrap=True)


def explain(text: str, style: str = "") -> None:
    """Print a text that explains, wrapped at the terminal's width; words stay whole."""
    wrapped = textwrap.fill(text, width(), break_long_words=False, break_on_hyphens=False)
    say(wrapped, style)


def warn(text: str) -> None:
    """Print a warning as one line on standard error, so that results can be piped.

    Args:
        text: Of the library; names of parameters in backticks become flags.
    """
    text = f"WARNING {renamed(with_flags(text))}"
    error_console.print(Text(text, style="yellow"), soft_wrap=True)


def warn_of_tracks(warnings: Sequence[TrackWarning], *, strict: bool = False) -> None:
    """Print what looks wrong with tracks.

    Args:
        warnings: Of `check_track` and `check_pair`.
        strict: Whether the first one is an error.

    Raises:
        SuspectTrackError: There is one, and `strict`.
    """
    for warning in warnings:
        if strict:
            raise SuspectTrackError(str(warning))
        warn(str(warning))


def say_notes(path: Path, notes: Sequence[ReadingNote]) -> None:
    """Print what a reader says of a file: warnings in yellow, the rest as it is.

    Args:
        path: The file.
        notes: Of `read_with_notes`.
    """
    for note in notes:
        text = f"{path}: {with_flags(note.text)}"
        if note.is_warning:
            say(f"WARNING {text}", "yellow")
        else:
            say(text)


def with_flags(text: str) -> str:
    """Put flags for the parameters that a note of the library names in backticks."""
    return re.sub(r"`(\w+)`", lambda m: "--" + m[1].replace("_", "-"), text)


def emit(text: str) -> None:
    """Print data on standard output, and nothing but them; they are UTF-8 whatever it is."""
    if _IS_FIRST:
        sys.stdout.flush()
        sys.stdout.buffer.write(renamed(text).encode())
        sys.stdout.buffer.flush()


def send_messages_aside() -> None:
    """Print messages on standard error until the verb ends: standard output is for data."""
    global _is_data_on_stdout
    _is_data_on_stdout = True


def start_verb(arguments: Sequence[str] = ()) -> None:
    """Print messages on standard output again, and call all files by their names.

    Args:
        arguments: What follows the verb; `is_given` asks for them.
    """
    global _is_data_on_stdout, _flags
    _is_data_on_stdout = False
    _called.clear()
    words = [word.partition("=")[0].replace("_", "-") for word in arguments]
    _flags = frozenset(word for word in words if word.startswith("--"))


def is_given(flag: str) -> bool:
    """Whether the user has given a flag, be it with the value that it has by default."""
    return flag in _flags


def call_paths(names: Mapping[str, str]) -> None:
    """Call temporary files by what they stand for, in all that is printed until the verb ends."""
    _called.update(names)


def renamed(text: str) -> str:
    """A text in which temporary files are called by what they stand for."""
    for path, name in _called.items():
        text = text.replace(path, name)
    return text


def _messages() -> Console:
    return error_console if _is_data_on_stdout else _console


@contextmanager
def progress(title: str, total: int) -> Iterator[Advance]:
    """Show on standard error how far work has come, and when it will end.

    A terminal gets a bar; a file or a pipe gets a line after ten seconds, and then now and then.
    The file that `VIOAPR_PROGRESS_FILE` names, if it does, says the same as JSON.

    Args:
        title: Of the work.
        total: Number of its steps.

    Yields:
        A function to call at every step, or, with their number, after several.
    """
    with _shown(title, total) as advance, noted_progress(title, total) as note:

        def count(steps: int = 1, /) -> None:
            advance(steps)
            note(steps)

        yield count


@contextmanager
def _shown(title: str, total: int) -> Iterator[Advance]:
    """Show people how far work has come; see `progress`."""
    if not is_watched():
        with ProgressLines(title, total, log) as lines:
            yield lines.advance
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("ETA"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=error_console, transient=True) as bar:
        task = bar.add_task(title, total=total)

        def advance(steps: int = 1, /) -> None:
            bar.advance(task, steps)

        yield advance


def log(text: str) -> None:
    """Print a line about how work goes on standard error."""
    error_console.print(Text(text), soft_wrap=True)
