"""Watches over one job's verb, and notes how it ends: `python -m vioapr.server.job_runner`.

It outlives the server, so that a restart of the server neither ends a job nor loses its result.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType

import msgspec

from vioapr.files.text import read_text, write_text
from vioapr.schemas.base import decode, encode
from vioapr.schemas.jobs import JobDocument, JobState
from vioapr.work.noted_progress import VARIABLE

JOB_FILE, LOG_FILE, PROGRESS_FILE, LOCK_FILE = "job.json", "log.txt", "progress.json", "lock"
_TAIL_BYTES = 4096


def run_job(job: Path, root: Path, lock: int, program: Sequence[str]) -> None:
    """Run a job's verb to its end.

    Args:
        job: The job's folder.
        root: The folder that is served; the verb runs in it.
        lock: Descriptor of the job's lock, which the verb gets too.
        program: The command line's, before the verb.
    """
    document = read_job(job)
    environment = {
        **os.environ,
        VARIABLE: str(job / PROGRESS_FILE),
        "PYTHONUNBUFFERED": "1",
        "NO_COLOR": "1",
    }
    verb: subprocess.Popen[bytes] | None = None
    asked = 0

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        asked += 1
        if verb is not None:
            verb.send_signal(signal.SIGTERM if asked == 1 else signal.SIGKILL)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with (job / LOG_FILE).open("ab") as log:
        verb = subprocess.Popen(
            [*program, *document.arguments],
            cwd=root,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            pass_fds=(lock,),
        )
    if asked:  # before there was a verb
        verb.send_signal(signal.SIGTERM)
    document = msgspec.structs.replace(document, pid=os.getpid())
    write_job(job, document)
    code = verb.wait()
    (job / PROGRESS_FILE).unlink(missing_ok=True)
    state: JobState = "done" if code == 0 else "stopped" if asked else "failed"
    write_job(
        job,
        msgspec.structs.replace(
            document,
            state=state,
            exit_code=code,
            ended_at=now(),
            message=last_word(job / LOG_FILE, is_error=code != 0),
        ),
    )


def last_word(log: Path, *, is_error: bool) -> str:
    """The last line of a log that says something; of a failed verb, its error."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - _TAIL_BYTES))
        lines = [line for line in file.read().decode("utf-8", "replace").splitlines() if line]
    errors = [line for line in lines if line.startswith("error: ")]
    chosen = errors[-1:] if is_error and errors else lines[-1:]
    return chosen[0].removeprefix("error: ") if chosen else ""


def read_job(job: Path) -> JobDocument:
    """Read what is noted of a job.

    Raises:
        FileError: It cannot be read.
    """
    return decode(job / JOB_FILE, read_text(job / JOB_FILE), JobDocument)


def write_job(job: Path, document: JobDocument) -> None:
    """Note how a job stands.

    Raises:
        UnwritableError: It cannot be noted.
    """
    write_text(job / JOB_FILE, encode(document))


def now() -> str:
    """The time, ISO 8601, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


if __name__ == "__main__":
    run_job(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4:])
