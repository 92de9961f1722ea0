"""Recordings and labels that are a folder with a file a frame."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileMissingError, FormatError, UnreadableError
from vioapr.files.tables import Rows, parse_rows
from vioapr.files.text import natural_key, read_text
from vioapr.formats.base import ReadOptions
from vioapr.formats.poses import rigid_of_file
from vioapr.geometry.rigid import Rigid3
from vioapr.plurals import count_of


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


def read_matrix_files(
    path: Path, files: Sequence[Path], options: ReadOptions
) -> tuple[Rows, Rigid3]:
    """Read files of a 4x4 matrix each.

    Args:
        path: The folder, for messages about single matrices.
        files: The files, in order.
        options: Where to say that the matrices are transposed.

    Returns:
        A row a file; the matrices as they are, in whatever convention, shape (n,).

    Raises:
        FileError: A file cannot be read or holds no 4x4 matrix, naming it and the line.
    """
    matrices: list[NDArray[np.float64]] = []
    for file in files:
        table = parse_rows(file, read_text(file), range(4, 5), what="a row of a 4x4 matrix")
        if len(table) != 4:
            raise FormatError(file, f"expected a 4x4 matrix, got {count_of(len(table), 'row')}")
        matrices.append(table.numbers(slice(0, 4)))
    rows = Rows.numbered(path, len(files))
    return rows, rigid_of_file(rows, np.array(matrices), options)
