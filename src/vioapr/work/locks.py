"""Locks of folders: two processes must not write into one at the same time."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from vioapr.errors import FormatError, LockedError, UnwritableError
from vioapr.schemas.base import Record, decode, encode

try:
    import fcntl
except ImportError:  # Windows: folders are not locked there
    fcntl = None

LOCK_FILE = ".lock"


class Holder(Record, frozen=True):
    """The process that holds a lock, as the lock's file says.

    Attributes:
        pid: Its number.
        host: The machine that it runs on.
        command: Its command line.
        since: When it took the lock, ISO 8601, UTC.
    """

    pid: int
    host: str
    command: str
    since: str


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; the folder is made if needed.

    The system holds the lock as long as the process lives (`flock`), so one that died, however
    it died, holds none, and no lock is ever to be deleted by hand. The file says who holds it;
    its holder removes it in the end, and who gets the lock of a file that was removed meanwhile
    tries again. On network file systems the lock counts across machines where the file system
    supports it, as NFS does under Linux.

    Raises:
        LockedError: Another process holds it; says which, and what to do.
        UnwritableError: The folder, or the lock's file, cannot be written.
    """
    path = folder / LOCK_FILE
    with _open_locked(path) as file:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        holder = Holder(
            pid=os.getpid(), host=socket.gethostname(), command=" ".join(sys.argv), since=now
        )
        try:
            file.truncate(0)
            file.write(encode(holder))
            file.flush()
        except OSError as error:
            raise UnwritableError.of(path, error) from None
        try:
            yield
        finally:
            if fcntl is not None:
                path.unlink(missing_ok=True)


def _open_locked(path: Path) -> TextIO:
    """Open a lock's file and take the lock; see `locked_folder`."""
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # "a": what another process wrote stays until the lock is ours.
            file = path.open("a", encoding="utf-8")
        except OSError as error:
            raise UnwritableError.of(path.parent, error) from None
        if fcntl is None:
            return file
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and os.path.samestat(path.stat(), os.fstat(file.fileno())):
                return file
        except BlockingIOError:
            file.close()
            raise LockedError(path.parent, describe_holder(path)) from None
        except OSError as error:
            file.close()
            raise UnwritableError.of(path, error) from None
        file.close()  # its holder has just removed it


def describe_holder(path: Path) -> str:
    """Say who holds a lock, by its file, and what to do."""
    try:
        holder = decode(path, path.read_text(encoding="utf-8"), Holder)
    except (OSError, ValueError, FormatError):  # between taking the lock and saying who
        return "in use by another process: wait until it has ended, or end it"
    return (
        f"in use by process {holder.pid} on {holder.host} ({holder.command}), since "
        f"{holder.since}: wait until it has ended, or end it"
    )
