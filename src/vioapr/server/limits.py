"""How much a client may ask of the server."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Bounds of requests; the defaults are far above what the page needs.

    Attributes:
        max_file_bytes: Of a file that is put.
        max_json_bytes: Of a request's JSON.
        max_files: Of a capture or an upload.
        idle_s: How long a body may send nothing.
        min_free_bytes: Of the disk, below which no file is taken.
    """

    max_file_bytes: int = 32 << 20
    max_json_bytes: int = 8 << 20
    max_files: int = 60_000
    idle_s: float = 30.0
    min_free_bytes: int = 512 << 20
