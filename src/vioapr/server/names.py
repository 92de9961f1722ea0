"""Names of the files that clients may put: what is not one of these is never a path."""

from __future__ import annotations

import re

_CAPTURE = re.compile(
    r"capture\.json|(?:frames|imu|gnss|heading)-\d{5}\.csv"
    r"|images/[A-Za-z0-9][A-Za-z0-9_-]{0,63}\.(?:jpg|jpeg|png)"
)
_PART = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9 ._()+-]{0,118}[A-Za-z0-9_()+-])?")
_MAX_DEPTH = 8


def is_capture_name(name: str) -> bool:
    """Whether a file may be part of a capture: `capture.json`, a segment of a log, an image."""
    return _CAPTURE.fullmatch(name) is not None


def is_upload_name(name: str) -> bool:
    """Whether a file may be part of another app's export: a relative path of plain parts."""
    parts = name.split("/")
    return len(parts) <= _MAX_DEPTH and all(_PART.fullmatch(part) for part in parts)
