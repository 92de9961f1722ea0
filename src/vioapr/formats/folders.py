"""Recordings and labels that are a folder with a file a frame."""

from __future__ import annotations

import re
from pathlib import Path

from vioapr.errors import FileMissingError, FormatError, UnreadableError
from vioapr.files.text import natural_key


def find_frames(folder: Path, pattern: str) -> list[Path]:
    """Find the files of a folder whose whole names match, in natural order.

    Args:
        folder: Where to look; no files are found where it is none.
        pattern: A regular expression.

    Raises:
        UnreadableError: The folder cannot be looked at.
    """
    matches = re.compile(pattern).fullmatch
    try:
        found = [file for file in folder.iterdir() if matches(file.name)]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise UnreadableError.of(folder, error) from None
    return sorted(found, key=lambda file: natural_key(file.name))


def has_frames(folder: Path, pattern: str) -> bool:
    """Whether a folder has such files; false also where it cannot be looked at."""
    try:
        return bool(find_frames(folder, pattern))
    except UnreadableError:
        return False


def require_frames(path: Path, files: list[Path], wanted: str) -> list[Path]:
    """The files that were found.

    Args:
        path: The folder that a user gave.
        files: What was found in it.
        wanted: What it should hold, for messages.

    Raises:
        FileMissingError: There is no such folder.
        FormatError: There are none in it.
    """
    if files:
        return files
    try:
        exists, is_file = path.exists(), path.is_file()
    except OSError as error:
        raise UnreadableError.of(path, error) from None
    if not exists:
        raise FileMissingError(path, f"expected {wanted}, found nothing of this name")
    if is_file:
        raise FormatError(path, f"expected {wanted}, found a file: give the folder it is in")
    raise FormatError(path, f"expected {wanted}, found none")
