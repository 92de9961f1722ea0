"""A job of the server, on disk and over HTTP, and how far its verb has come."""

from __future__ import annotations

from typing import ClassVar, Literal

import msgspec

from vioapr.schemas.base import Document

JobState = Literal["queued", "running", "done", "failed", "stopped", "interrupted"]
"""Interrupted: its process died without saying how it ended, as when the machine went down."""


class JobDocument(Document, frozen=True, kw_only=True):
    """A verb of the command line that the server runs in a process of its own.

    Attributes:
        id: Its id.
        kind: What it is for: `capture`, `import` or `build`.
        scene: The scene's id; "" for none.
        arguments: Of `vioapr`; paths are from the served folder.
        state: How it stands.
        created_at: When it was asked for, ISO 8601, UTC.
        started_at: When it began; "" before.
        ended_at: When it ended; "" before, and where nobody saw it end.
        exit_code: Of the verb; None before its end.
        message: In a line: the verb's error, or its last word; "" before its end.
        pid: Of the process that watches over the verb; 0 before its start.
    """

    FORMAT: ClassVar[str] = "vioapr job"
    VERSION: ClassVar[int] = 1

    id: str
    kind: str
    scene: str = ""
    arguments: tuple[str, ...]
    state: JobState = "queued"
    created_at: str
    started_at: str = ""
    ended_at: str = ""
    exit_code: int | None = None
    message: str = ""
    pid: int = 0


class ProgressDocument(Document, frozen=True, kw_only=True):
    """How far a verb has come, for who started it.

    Attributes:
        title: Of the stage that it is in.
        done: Steps that are done.
        total: Steps of the stage; 0 if not known.
        stages: How many stages have begun.
    """

    FORMAT: ClassVar[str] = "vioapr progress"
    VERSION: ClassVar[int] = 1

    title: str
    done: int = 0
    total: int = 0
    stages: int = msgspec.field(default=1)
