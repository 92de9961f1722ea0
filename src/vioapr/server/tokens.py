"""The token that clients must know, and files that only their owner can read."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from vioapr.errors import FormatError, ParameterError, UnreadableError, UnwritableError

MIN_TOKEN_LENGTH = 16


def check_token(token: str) -> str:
    """See that a token is long enough, and fits a header and an address.

    Raises:
        ParameterError: It is not, or does not.
    """
    is_plain = token.isascii() and token.replace("-", "").replace("_", "").isalnum()
    if len(token) < MIN_TOKEN_LENGTH or not is_plain:
        raise ParameterError(
            f"token: expected at least {MIN_TOKEN_LENGTH} letters, digits, '-' and '_'"
        )
    return token


def keep_token(path: Path, given: str | None) -> str:
    """The token of a folder: the given one, else the one that is kept, else a new one.

    Args:
        path: Where it is kept, readable for its owner alone.
        given: By the user, or None.

    Raises:
        ParameterError: The given one is too short.
        FileError: It cannot be read or written.
    """
    if given is None and path.exists():
        try:
            return check_token(path.read_text(encoding="ascii").strip())
        except (ParameterError, ValueError):
            raise FormatError(path, "expected a token: remove the file for a new one") from None
        except OSError as error:
            raise UnreadableError.of(path, error) from None
    token = secrets.token_urlsafe(24) if given is None else check_token(given)
    write_secret(path, token.encode() + b"\n")
    return token


def write_secret(path: Path, content: bytes) -> None:
    """Write a file that only its owner can read, at no time anybody else.

    Raises:
        UnwritableError: It cannot be written.
    """
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(file, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise UnwritableError.of(path, error) from None
