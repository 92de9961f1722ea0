"""Tracks that verbs are given, read with what their readers say."""

from __future__ import annotations

from pathlib import Path

from vioapr.cli.console import warn
from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import read_with_notes
from vioapr.trajectory import Trajectory


def read_track(
    path: Path, format_name: str | None, options: ReadOptions, parameter: str
) -> Trajectory:
    """Read a track, and say on standard error what its reader warns of.

    Args:
        path: The file.
        format_name: Its format, if known.
        options: Unit of time, strictness.
        parameter: The verb's, with which a user can choose the format.

    Raises:
        VioAprError: It cannot be read.
    """
    reading = read_with_notes(path, format_name, options, parameter=parameter)
    for note in reading.notes:
        if note.is_warning:
            if options.strict:
                raise FormatError(path, note.text)
            warn(f"{path}: {note.text}")
    return reading.trajectory
