"""What the command line prints with: two consoles, plain lines and progress bars."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
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

from vioapr.errors import SuspectTrackError

if TYPE_CHECKING:
    from vioapr.formats.notes import ReadingNote
    from vioapr.formats.track_warnings import TrackWarning

# Tables must not be cut where the output goes to a file or a pipe.
_WIDTH = None if sys.stdout.isatty() else max(160, shutil.get_terminal_size().columns)

# Of several training processes, the first one speaks for all.
_IS_FIRST = all(os.environ.get(name, "0") == "0" for name in ("LOCAL_RANK", "NODE_RANK"))

console = Console(width=_WIDTH, highlight=False, quiet=not _IS_FIRST)
error_console = Console(stderr=True, highlight=False, quiet=not _IS_FIRST)


def say(text: str, style: str = "") -> None:
    """Print a line as it is, however long: a path must not be broken, nor its brackets read.

    Args:
        text: Usually "path: fact about it".
        style: Of rich, e.g. "bold" or "yellow".
    """
    console.print(Text(text, style=style), soft_wrap=True)


def warn(text: str) -> None:
    """Print a warning as one line on standard error, so that results can be piped.

    Args:
        text: Of the library; names of parameters in backticks become flags.
    """
    error_console.print(Text(f"WARNING {with_flags(text)}", style="yellow"), soft_wrap=True)


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


@contextmanager
def progress(title: str, total: int) -> Iterator[Callable[..., None]]:
    """Show a progress bar with ETA on standard error.

    Args:
        title: Of the work.
        total: Number of its steps.

    Yields:
        A function to call at every step, or, with their number, after several.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("ETA"),
        TimeRemainingColumn(),
    )
    is_shown = error_console.is_terminal and _IS_FIRST
    with Progress(*columns, console=error_console, transient=True, disable=not is_shown) as bar:
        task = bar.add_task(title, total=total)
        yield lambda steps=1: bar.advance(task, steps)
