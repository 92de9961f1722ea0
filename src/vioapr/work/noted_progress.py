"""How far work has come, in a small file for the program that started it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from vioapr.errors import FileError
from vioapr.files.text import write_text
from vioapr.schemas.base import encode
from vioapr.schemas.jobs import ProgressDocument
from vioapr.work.processes import is_first_process
from vioapr.work.progress import Advance, ignore

VARIABLE = "VIOAPR_PROGRESS_FILE"
"""The environment's variable that names the file."""

_EVERY_S = 0.5

_stages = 0


@contextmanager
def noted_progress(title: str, total: int) -> Iterator[Advance]:
    """Note how far a stage of the work has come, at most twice a second.

    Nothing is noted without a file's name in the environment, nor by processes that train beside
    the first. A file that cannot be written is no reason to fail.

    Args:
        title: Of the stage.
        total: Number of its steps.
    """
    global _stages
    name = os.environ.get(VARIABLE)
    if not name or not is_first_process():
        yield ignore
        return
    _stages += 1
    stage, done, noted_s = _stages, 0, time.monotonic()

    def note() -> None:
        said = ProgressDocument(title=title, done=done, total=total, stages=stage)
        with suppress(FileError):
            write_text(Path(name), encode(said, indent=None))

    def advance(steps: int = 1, /) -> None:
        nonlocal done, noted_s
        done += steps
        if time.monotonic() - noted_s >= _EVERY_S:
            noted_s = time.monotonic()
            note()

    note()
    yield advance
