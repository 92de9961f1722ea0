"""Locks of folders: two processes must not write into one at the same time."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

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
    it stays when the lock is free, because deleting it would race with the next process. On
    network file systems the lock counts across machines where the file system supports it, as
    NFS does under Linux.

    Raises:
        LockedError: Another process holds it; says which, and what to do.
        UnwritableError: The folder, or the lock's file, cannot be written.
    """
    path = folder / LOCK_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # "a": what another process wrote stays until the lock is ours.
        file = path.open("a", encoding="utf-8")
    except OSError as error:
        raise UnwritableError.of(folder, error) from None
    with file:
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise LockedError(folder, describe_holder(path)) from None
            except OSError as error:
                raise UnwritableError.of(path, error) from None
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
        yield


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
