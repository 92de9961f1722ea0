"""From a transfer that is complete to the job that makes a recording of it."""

from __future__ import annotations

import threading
from contextlib import suppress
from pathlib import Path

from vioapr.errors import AlreadyExistsError, FileMissingError, ParameterError
from vioapr.schemas.jobs import JobDocument, JobState
from vioapr.schemas.server import CaptureCompletion, ImportRequest, TransferDocument
from vioapr.server.jobs import Jobs
from vioapr.server.layout import ServedFolder
from vioapr.server.refusals import Refusal
from vioapr.server.scenes import check_recording_free
from vioapr.server.transfers import Transfers

CAPTURE, IMPORT = "capture", "import"
_CAPTURE_FILE, _ANONYMIZE = "capture.json", "--anonymize"


class Handovers:
    """Hands transfers over to jobs; whatever is killed, each exactly once."""

    def __init__(
        self, served: ServedFolder, captures: Transfers, uploads: Transfers, jobs: Jobs
    ) -> None:
        """Stand between transfers and jobs."""
        self._served, self._jobs = served, jobs
        self._captures, self._uploads = captures, uploads
        self._one_by_one = threading.Lock()

    def take_up(self) -> None:
        """Go on where a killed server was: submit what was complete, and run again what died."""
        for transfers in (self._captures, self._uploads):
            for id_ in transfers.ids():
                done = transfers.completion(id_)
                if done is None:
                    continue
                self._submit(done)
                if self._state_of(done) == "interrupted":
                    self._jobs.again(done.job)
        self.remove_imported()

    def complete_capture(self, id_: str, wanted: CaptureCompletion) -> JobDocument:
        """Make a recording of a capture that is whole.

        Raises:
            Refusal: Files are missing, or it is complete already with others.
            FileMissingError: There is no such scene.
            AlreadyExistsError: The recording's id is taken.
        """
        folder = self._captures.place(id_)
        arguments = (
            "import", CAPTURE, self._path(folder), "--out", wanted.scene, "--id", wanted.recording,
            "--split", wanted.split, "--images", "link",
            *([_ANONYMIZE] if wanted.anonymize else []),
        )  # fmt: skip
        document = TransferDocument(
            files=wanted.files, scene=wanted.scene, recording=wanted.recording,
            job=Jobs.new_id(), kind=CAPTURE, arguments=arguments,
        )  # fmt: skip
        if _CAPTURE_FILE not in wanted.files:
            raise Refusal(409, f"expected {_CAPTURE_FILE} among the files", (_CAPTURE_FILE,))
        return self._complete(self._captures, id_, document)

    def complete_upload(self, scene: str, wanted: ImportRequest) -> JobDocument:
        """Import an upload that is whole.

        Raises:
            Refusal: Files are missing, or it is complete already with others.
            FileMissingError: There is no such scene.
            AlreadyExistsError: The recording's id is taken.
        """
        folder = self._uploads.place(wanted.upload)
        source = self._path(folder / find_source(wanted.files))
        arguments = ["import", wanted.format, source, "--out", scene, "--images", "link"]
        if wanted.split is not None:
            arguments += ["--split", wanted.split]
        if wanted.recording is not None:
            arguments += ["--id", wanted.recording]
        if wanted.anonymize:
            arguments.append(_ANONYMIZE)
        document = TransferDocument(
            files=wanted.files, scene=scene, recording=wanted.recording or "",
            job=Jobs.new_id(), kind=IMPORT, arguments=tuple(arguments),
        )  # fmt: skip
        return self._complete(self._uploads, wanted.upload, document)

    def remove_imported(self) -> None:
        """Remove what is in the scene by now: uploads, and pictures that showed faces.

        Other captures stay as they came. Their pictures take no place, as the scene's are links.
        """
        for transfers in (self._uploads, self._captures):
            for id_ in transfers.ids():
                done = transfers.completion(id_)
                if done is None or self._state_of(done) != "done":
                    continue
                if done.kind == IMPORT:
                    transfers.remove(id_)
                elif _ANONYMIZE in done.arguments:
                    transfers.empty(id_)

    def require_idle(self, transfers: Transfers, id_: str) -> None:
        """See that no job needs a transfer.

        Raises:
            Refusal: One does.
        """
        done = transfers.completion(id_)
        if done is not None and self._state_of(done) in ("queued", "running"):
            raise Refusal(409, f"{id_} is needed by job {done.job}: stop it first")

    def _complete(self, transfers: Transfers, id_: str, document: TransferDocument) -> JobDocument:
        """Note that a transfer is complete, and submit its job; once, however often asked."""
        with self._one_by_one:
            before = transfers.completion(id_)
            if before is not None:
                if before.files != document.files or before.scene != document.scene:
                    raise Refusal(409, f"{id_} is complete already, with other files or a scene")
                return self._submit(before)
            missing = transfers.find_missing(id_, document.files)
            if missing or not document.files:
                raise Refusal(409, f"{len(missing)} files are missing", tuple(missing))
            scene = self._served.scene(document.scene)
            if document.recording:
                check_recording_free(scene, document.recording)
                self._check_unclaimed(document)
            transfers.complete(id_, document)
            return self._submit(document)

    def _submit(self, document: TransferDocument) -> JobDocument:
        return self._jobs.submit(
            document.kind, document.arguments, scene=document.scene, id_=document.job
        )

    def _check_unclaimed(self, document: TransferDocument) -> None:
        """See that no other transfer is about to become the same recording."""
        claimed = document.scene, document.recording
        for transfers in (self._captures, self._uploads):
            for id_ in transfers.ids():
                done = transfers.completion(id_)
                is_same = done is not None and (done.scene, done.recording) == claimed
                if done is not None and is_same and self._state_of(done) in ("queued", "running"):
                    text = f"expected the id of a new recording: {id_} becomes this one"
                    raise AlreadyExistsError(document.recording, text)

    def _state_of(self, done: TransferDocument) -> JobState:
        """The state of a transfer's job, which may be about to be submitted."""
        with suppress(FileMissingError):
            return self._jobs.get(done.job).job.state
        return "queued"

    def _path(self, path: Path) -> str:
        return path.relative_to(self._served.folder).as_posix()


def find_source(files: dict[str, str]) -> str:
    """What of an upload is to be imported: its only file, the first of its pieces, or all.

    Raises:
        ParameterError: There are several files, and some are pieces.
    """
    pieces = sorted(name for name in files if name.rpartition(".")[2].isdecimal())
    stems = {name.rpartition(".")[0] for name in pieces}
    if len(pieces) == len(files) and len(stems) == 1:
        return pieces[0]
    if pieces and len(stems) == 1 and len(pieces) > 1:
        raise ParameterError("files: expected pieces of one file alone, found others beside them")
    return next(iter(files)) if len(files) == 1 else ""
