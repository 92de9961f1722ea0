"""Writing a file so that it is, whatever happens, either the old one or the new one.

What is written goes to a temporary file in the same folder, reaches the disk, and then takes the
place of the old file in one step. This is the only such code in the package.
"""

from __future__ import annotations

import glob
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vioapr.errors import UnwritableError

PARTIAL_SUFFIX = ".partial"
"""Of the names of temporary files and folders; they begin with a dot."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write a whole file in one step; folders are made as needed.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    with replacing(path) as partial:
        partial.write_bytes(content)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path to write a file to, which then replaces `path` in one step.

    For libraries that write to a path. If the block raises, nothing is replaced, and the
    temporary file is removed. Through a link, the file that it leads to is replaced; what is no
    regular file (`/dev/stdout`) is written directly.

    Args:
        path: The file; folders are made as needed.

    Yields:
        An empty file in the same folder, whose name does not end as the file's.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    partial: Path | None = None
    try:
        # Asked of the path itself: what /dev/stdout leads to has no path where it is a pipe.
        if path.exists() and not path.is_file():
            yield path
            return
        target = Path(os.path.realpath(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = partial_beside(target)
        # Readable as the umask says, and never somebody else's.
        os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield partial
        sync(partial)
        partial.replace(target)
    except OSError as error:
        raise UnwritableError.of(path, error) from None
    finally:
        if partial is not None:
            partial.unlink(missing_ok=True)


def replace_folder(folder: Path, partial: Path) -> None:
    """Put a finished folder in the place of another one, if there is one.

    Two renames are needed: a crash between them leaves the old folder whole, named
    `.<name>.old`.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    old = folder.with_name(f".{folder.name}.old")
    try:
        shutil.rmtree(old, ignore_errors=True)
        if folder.exists():
            folder.replace(old)
        partial.replace(folder)
    except OSError as error:
        if old.exists() and not folder.exists():
            old.replace(folder)
        raise UnwritableError.of(folder, error) from None
    shutil.rmtree(old, ignore_errors=True)


def partial_beside(path: Path) -> Path:
    """A name for a temporary file or folder in the same folder, unlike any other's."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}{PARTIAL_SUFFIX}")


def leftovers_beside(path: Path) -> list[Path]:
    """The temporary files or folders that interrupted writes of a path left beside it."""
    pattern = f".{glob.escape(path.name)}.{'[0-9a-f]' * 8}{PARTIAL_SUFFIX}"
    return sorted(path.parent.glob(pattern))


def sync(path: Path) -> None:
    """Wait until a file's content has reached the disk."""
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)
