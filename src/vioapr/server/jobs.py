"""Verbs of the command line that the server runs: a folder each, whose files say how they stand.

Jobs of one lane run one after the other, e.g. imports into one scene. Every job runs in a session
of its own under `job_runner`, which goes on when the server ends. A lock that its processes hold
tells a running job from one that died; nothing relies on process numbers.
"""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from vioapr.errors import FileError, FileMissingError, ParameterError
from vioapr.files.text import read_text
from vioapr.scene.scene import check_id
from vioapr.schemas.base import decode
from vioapr.schemas.jobs import JobDocument, ProgressDocument
from vioapr.schemas.server import JobAnswer
from vioapr.server.job_runner import (
    LOCK_FILE,
    LOG_FILE,
    PROGRESS_FILE,
    now,
    read_job,
    write_job,
)
from vioapr.work.held import hold, is_held

_DIED = "its process died, or the machine went down"
ENDED = ("done", "failed", "stopped", "interrupted")


class Jobs:
    """The jobs of a served folder; safe to call from several threads."""

    def __init__(
        self,
        folder: Path,
        root: Path,
        program: Sequence[str] = (sys.executable, "-m", "vioapr"),
    ) -> None:
        """Take up what is there: queued jobs are queued again, running ones are watched.

        Args:
            folder: A folder a job; made if needed.
            root: The folder that is served.
            program: The command line's, before the verb.
        """
        self._folder, self._root, self._program = folder, root.resolve(), program
        self._change = threading.RLock()
        self._runners: dict[str, subprocess.Popen[bytes]] = {}
        self._asked: set[str] = set()
        self._ended: list[JobDocument] = []
        folder.mkdir(parents=True, exist_ok=True)
        self._jobs: dict[str, JobDocument] = {}
        for path in sorted(folder.iterdir()):
            with suppress(FileError):  # killed before the job's first note: it never was
                self._jobs[path.name] = read_job(path)

    def submit(
        self, kind: str, arguments: Sequence[str], *, scene: str = "", id_: str | None = None
    ) -> JobDocument:
        """Queue a verb.

        Args:
            kind: What it is for; jobs of a kind and scene run one after the other.
            arguments: Of `vioapr`, the verb first; paths are from the served folder.
            scene: The scene's id.
            id_: The job's, from `new_id`; one that is there already stays as it is.

        Raises:
            UnwritableError: It cannot be noted.
        """
        with self._change:
            id_ = id_ or self.new_id()
            if id_ in self._jobs:
                return self._jobs[id_]
            job = JobDocument(
                id=id_, kind=kind, scene=scene, arguments=tuple(arguments), created_at=now()
            )
            return self._note(job)

    def find_open(self, kind: str, scene: str) -> JobDocument | None:
        """A job of a kind and scene that has not ended, or None."""
        with self._change:
            open_jobs = [job for job in self._jobs.values() if job.state not in ENDED]
            found = [job for job in map(self._refreshed, open_jobs) if job.state not in ENDED]
            return next((job for job in found if (job.kind, job.scene) == (kind, scene)), None)

    @staticmethod
    def new_id() -> str:
        """An id that no other job has; later ones sort behind earlier ones."""
        return f"{datetime.now(UTC):%Y%m%d-%H%M%S-%f}-{secrets.token_hex(3)}"

    def all(self) -> list[JobAnswer]:
        """All jobs, the newest first."""
        with self._change:
            return [self.get(id_) for id_ in sorted(self._jobs, reverse=True)]

    def get(self, id_: str) -> JobAnswer:
        """A job, as it stands.

        Raises:
            FileMissingError: There is none of this id.
        """
        with self._change:
            job = self._refreshed(self._known(id_))
            folder = self._folder / id_
            log = folder / LOG_FILE
            progress = None
            if job.state == "running":
                with suppress(FileError):
                    path = folder / PROGRESS_FILE
                    progress = decode(path, read_text(path), ProgressDocument)
            size = log.stat().st_size if log.exists() else 0
            return JobAnswer(job=job, progress=progress, log_bytes=size)

    def read_log(self, id_: str, offset: int, most: int) -> bytes:
        """A part of a job's log, from a byte.

        Raises:
            FileMissingError: There is no such job.
        """
        self._known(id_)
        path = self._folder / id_ / LOG_FILE
        if not path.exists():
            return b""
        with path.open("rb") as file:
            file.seek(offset)
            return file.read(most)

    def stop(self, id_: str) -> JobDocument:
        """Ask a job to end; a second time, end it.

        Raises:
            FileMissingError: There is none of this id.
        """
        with self._change:
            job = self._refreshed(self._known(id_))
            if job.state == "queued":
                return self._note(msgspec.structs.replace(job, state="stopped", ended_at=now()))
            pid = self._runners[id_].pid if id_ in self._runners else job.pid
            if job.state == "running" and pid:
                self._asked.add(id_)
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGTERM)
            return job

    def again(self, id_: str) -> JobDocument:
        """Queue a job again that has ended; verbs go on where they were.

        Raises:
            FileMissingError: There is none of this id.
            ParameterError: It has not ended.
        """
        with self._change:
            job = self._refreshed(self._known(id_))
            if job.state not in ENDED:
                raise ParameterError(f"expected a job that has ended, got one that is {job.state}")
            self._asked.discard(id_)
            fresh = JobDocument(
                id=id_, kind=job.kind, scene=job.scene, arguments=job.arguments, created_at=now()
            )
            return self._note(fresh)

    def advance(self) -> list[JobDocument]:
        """Note what has ended, and start what may begin.

        Returns:
            The jobs that have ended since the last call.
        """
        with self._change:
            open_jobs = [job for job in self._jobs.values() if job.state not in ENDED]
            fresh = [self._refreshed(job) for job in open_jobs]
            busy = {_lane(job) for job in fresh if job.state == "running"}
            for job in sorted(fresh, key=lambda job: job.created_at + job.id):
                if job.state == "queued" and _lane(job) not in busy:
                    busy.add(_lane(job))
                    self._start(job)
            # Also those whose end was seen when somebody asked for them.
            ended, self._ended = self._ended, []
            return ended

    def _start(self, job: JobDocument) -> None:
        folder = self._folder / job.id
        lock = hold(folder / LOCK_FILE)
        try:
            self._note(msgspec.structs.replace(job, state="running", started_at=now()))
            words = [sys.executable, "-m", "vioapr.server.job_runner"]
            self._runners[job.id] = subprocess.Popen(
                [*words, str(folder.resolve()), str(self._root), str(lock), *self._program],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=(lock,),
                start_new_session=True,
            )
        finally:
            os.close(lock)

    def _refreshed(self, job: JobDocument) -> JobDocument:
        """A job as its runner has noted it; interrupted if nobody runs it any more."""
        if job.state != "running":
            return job
        folder = self._folder / job.id
        # The lock first: a runner that ends in between has noted the end already.
        is_alive = is_held(folder / LOCK_FILE)
        noted = read_job(folder)
        if noted.state == "running" and not is_alive:
            # Asked to stop before it could say so itself, or nobody knows.
            state, why = ("stopped", "") if job.id in self._asked else ("interrupted", _DIED)
            noted = msgspec.structs.replace(noted, state=state, message=why)
            self._note(noted)
        if noted.state in ENDED:
            self._ended.append(noted)
            if job.id in self._runners:
                self._runners.pop(job.id).wait()
        self._jobs[job.id] = noted
        return noted

    def _note(self, job: JobDocument) -> JobDocument:
        folder = self._folder / job.id
        folder.mkdir(exist_ok=True)
        write_job(folder, job)
        self._jobs[job.id] = job
        return job

    def _known(self, id_: str) -> JobDocument:
        job = self._jobs.get(check_id(id_))
        if job is None:
            raise FileMissingError(id_, "expected a job, found none of this id")
        return job


def _lane(job: JobDocument) -> tuple[str, str]:
    # A capture is imported too: both write recordings of the scene.
    return ("import" if job.kind == "capture" else job.kind), job.scene
