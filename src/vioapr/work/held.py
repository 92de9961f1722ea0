"""A lock that passes from process to process, and so tells whether any of them is alive."""

from __future__ import annotations

import os
from pathlib import Path

from vioapr.errors import LockedError, UnwritableError, VioAprError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None


def require_locks(feature: str) -> None:
    """See that the system has locks.

    Raises:
        VioAprError: It has none: Windows.
    """
    if fcntl is None:
        raise VioAprError(f"{feature} needs Linux or macOS; on Windows, use WSL")


def hold(path: Path) -> int:
    """Take a lock; it is held until every copy of the returned descriptor is closed.

    A process that is started with the descriptor (`pass_fds`) holds it too. Processes that died,
    however they died, hold nothing.

    Returns:
        The descriptor.

    Raises:
        LockedError: It is held.
        UnwritableError: The file cannot be made.
    """
    assert fcntl is not None  # by `require_locks`
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise UnwritableError.of(path, error) from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(file)
        raise LockedError(path, "in use by another process") from None
    return file


def is_held(path: Path) -> bool:
    """Whether a living process holds a lock."""
    if not path.exists():
        return False
    try:
        os.close(hold(path))
    except LockedError:
        return True
    return False
