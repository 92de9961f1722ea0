"""Writing a file so that it is, whatever happens, either the old one or the new one.

What is written goes to a temporary file in the same folder, reaches the disk, and then takes the
place of the old file in one step. This is the only such code in the package.
"""

from __future__ import annotations

import glob
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from vioapr.errors import AlreadyExistsError, UnwritableError

try:
    import fcntl
except ImportError:  # Windows: leftovers are not told from files that are being written
    fcntl = None

PARTIAL_SUFFIX = ".partial"
"""Of the names of temporary files and folders; they begin with a dot."""

_OWN_FILE = re.compile(r"/dev/(stdin|stdout|stderr)|/(?:dev|proc/self)/fd/(\d+)")


def write_atomically(path: Path, content: bytes, *, overwrite: bool = True) -> None:
    """Write a whole file in one step; folders are made as needed.

    Raises:
        AlreadyExistsError: It exists, without `overwrite`.
        UnwritableError: It cannot be written; what was there stays.
    """
    with replacing(path, overwrite=overwrite) as partial:
        partial.write_bytes(content)


@contextmanager
def replacing(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Give a temporary path to write a file to, which then replaces `path` in one step.

    For libraries that write to a path. If the block raises, nothing is replaced, and the
    temporary file is removed. Through a link, the file that it leads to is replaced. A file of
    the process's own (`/dev/stdout`) gets the content at its end, whatever it leads to; a pipe
    or a device is written directly.

    A file that is replaced keeps its permissions; a new one has those that the umask says. The
    temporary files of processes that died while they wrote this very file are removed.

    Args:
        path: The file; folders are made as needed.
        overwrite: Whether to replace a file that is there when the new one is whole, as another
            process may have written it meanwhile.

    Yields:
        An empty file in the same folder, whose name does not end as the file's.

    Raises:
        AlreadyExistsError: It exists, without `overwrite`.
        UnwritableError: It cannot be written; what was there stays.
    """
    try:
        if (number := own_descriptor(path)) is not None:
            yield from _copied_to(number)
        # Asked of the path itself: what leads to a pipe has no other path.
        elif path.exists() and not path.is_file():
            yield path
        else:
            yield from _moved_to(Path(os.path.realpath(path)), overwrite)
    except OSError as error:
        raise UnwritableError.of(path, error) from None


def came_meanwhile(path: Path) -> AlreadyExistsError:
    """The error for an output that another process wrote while this one did its work."""
    return AlreadyExistsError(
        path, "exists now, and did not before: choose another name, or give `overwrite`"
    )


def own_descriptor(path: Path) -> int | None:
    """The number of the process's own open file that a path means, as `/dev/stdout`, or None."""
    if found := _OWN_FILE.fullmatch(os.fspath(path)):
        return {"stdin": 0, "stdout": 1, "stderr": 2}.get(found[1]) or int(found[2] or 0)
    return None


def _copied_to(number: int) -> Iterator[Path]:
    """Yield a temporary file, and write its content to an open file of the process."""
    with tempfile.TemporaryDirectory() as folder:
        partial = Path(folder) / "content"
        partial.touch()
        yield partial
        sys.stdout.flush()  # what was printed before comes before it
        # Opening /dev/stdout would empty a file that the output is appended to.
        with os.fdopen(os.dup(number), "wb") as target, partial.open("rb") as content:
            shutil.copyfileobj(content, target)


def _moved_to(target: Path, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary file beside a file; put it in its place once it has reached the disk."""
    target.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(target)
    partial, held = _create_beside(target)
    try:
        mode = target.stat().st_mode if target.exists() else os.fstat(held).st_mode
        yield partial
        # Libraries may have made the file again, with permissions of their own.
        partial.chmod(stat.S_IMODE(mode))
        sync(partial)
        if overwrite:
            partial.replace(target)
        else:
            put_new(partial, target)
        sync(target.parent)
    finally:
        partial.unlink(missing_ok=True)
        os.close(held)


def put_new(partial: Path, target: Path) -> None:
    """Put a temporary file in its place, which no other process can take meanwhile.

    Raises:
        AlreadyExistsError: A file is there.
    """
    try:
        try:
            os.link(partial, target)
        except FileExistsError:
            raise
        except OSError:  # file systems without hard links: an empty file keeps the place
            os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
            _replace_empty(partial, target)
    except FileExistsError:
        raise came_meanwhile(target) from None


def _replace_empty(partial: Path, target: Path) -> None:
    try:
        partial.replace(target)
    except OSError:
        target.unlink(missing_ok=True)
        raise


def _create_beside(target: Path) -> tuple[Path, int]:
    """Make a temporary file, readable as the umask says, that is locked while it is open."""
    while True:
        partial = partial_beside(target)
        held = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        if fcntl is None:
            return partial, held
        with suppress(OSError):  # file systems without locks
            fcntl.flock(held, fcntl.LOCK_EX)
        if partial.exists():  # else it was taken for a leftover before it was locked
            return partial, held
        os.close(held)


def _remove_leftovers(target: Path) -> None:
    """Remove what processes that died left beside a file; living ones hold a lock on theirs."""
    for leftover in leftovers_beside(target):
        if fcntl is None:
            return
        with suppress(OSError):
            held = os.open(leftover, os.O_RDONLY)
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()
            finally:
                os.close(held)


@contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """Give a temporary folder beside a path; it is removed in the end, with what is left in it.

    Those that processes left that died are removed too; living ones hold a lock on theirs.

    Args:
        path: A file or folder, which need not exist; folders above it are made as needed.

    Yields:
        An empty folder.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(path)
    folder = partial_beside(path)
    folder.mkdir()
    held = None
    try:
        if fcntl is not None:
            held = os.open(folder, os.O_RDONLY)
            with suppress(OSError):  # file systems without locks
                fcntl.flock(held, fcntl.LOCK_EX)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if held is not None:
            os.close(held)


def replace_folder(folder: Path, partial: Path) -> None:
    """Put a finished folder in the place of another one, if there is one.

    All that is in it reaches the disk first. Two renames are needed: a crash between them leaves
    the old folder whole, named `.<name>.old`; `restore_folder` puts it back.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    old = _old_of(folder)
    try:
        sync_folder(partial)
        restore_folder(folder)
        if folder.exists():
            folder.replace(old)
        partial.replace(folder)
        sync(folder.parent)
    except OSError as error:
        if old.exists() and not folder.exists():
            old.replace(folder)
        raise UnwritableError.of(folder, error) from None
    shutil.rmtree(old, ignore_errors=True)


def restore_folder(folder: Path) -> None:
    """Bring a folder back that a crash of `replace_folder` left under another name.

    Where the new folder had taken its place already, the old one is removed.

    Raises:
        UnwritableError: It cannot be moved.
    """
    old = _old_of(folder)
    try:
        if old.exists() and not folder.exists():
            old.replace(folder)
    except OSError as error:
        raise UnwritableError.of(folder, error) from None
    shutil.rmtree(old, ignore_errors=True)


def _old_of(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.old")


def partial_beside(path: Path) -> Path:
    """A name for a temporary file or folder in the same folder, unlike any other's."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}{PARTIAL_SUFFIX}")


def leftovers_beside(path: Path) -> list[Path]:
    """The temporary files or folders that interrupted writes of a path left beside it."""
    pattern = f".{glob.escape(path.name)}.{'[0-9a-f]' * 8}{PARTIAL_SUFFIX}"
    return sorted(path.parent.glob(pattern))


def sync(path: Path) -> None:
    """Wait until a file's content, or the names in a folder, have reached the disk."""
    if os.name == "nt" and path.is_dir():  # folders cannot be opened there
        return
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def sync_folder(folder: Path) -> None:
    """Wait until all files in a folder, and in folders of it, have reached the disk."""
    everything = [folder, *folder.rglob("*")]
    # Several at once: the system writes them together.
    with ThreadPoolExecutor(8) as pool:
        for _ in pool.map(sync, (path for path in everything if not path.is_symlink())):
            pass
