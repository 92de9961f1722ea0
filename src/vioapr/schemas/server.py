"""What clients and the server say to each other; docs/reference/server.md has it in words."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from vioapr.schemas.base import Document, Record
from vioapr.schemas.contract import Contract
from vioapr.schemas.jobs import JobDocument, ProgressDocument

Sha256 = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
SplitName = Literal["train", "test", "none"]
IdText = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")]


class ServerInfo(Document, frozen=True, kw_only=True):
    """Which server this is.

    Attributes:
        vioapr: Version of the program.
    """

    FORMAT: ClassVar[str] = "vioapr server"
    VERSION: ClassVar[int] = 1

    vioapr: str


class Problem(Record, frozen=True):
    """Why a request was refused.

    Attributes:
        error: What was expected and what was found.
        missing: Of a completion: the files that are not there, or have other content.
    """

    error: str
    missing: tuple[str, ...] = ()


class NewScene(Record, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A scene to make.

    Attributes:
        id: Name of its folder.
        name: For people; the id if "".
        is_outdoor: Outdoors or indoors.
    """

    id: IdText
    name: str = ""
    is_outdoor: bool


class SceneEntry(Record, frozen=True, kw_only=True):
    """A scene in short.

    Attributes:
        id: Name of its folder.
        name: For people.
        is_outdoor: Outdoors or indoors.
        recordings: Splits of its recordings by id: "train", "test", "excluded" or "".
        has_map: Whether it is mapped.
        has_anchors: Whether it has content.
        problem: Why it cannot be read, or "".
    """

    id: str
    name: str
    is_outdoor: bool = False
    recordings: dict[str, str] = msgspec.field(default_factory=dict)
    has_map: bool = False
    has_anchors: bool = False
    problem: str = ""


class LocalizerEntry(Record, frozen=True, kw_only=True):
    """An exported localizer.

    Attributes:
        path: From the served folder; part of its address.
        scene: Id of the scene whose folder it is in, or "".
        size_bytes: Of the file.
        sha256: Of the file; also its ETag.
        contract: Its contract.
    """

    path: str
    scene: str
    size_bytes: int
    sha256: str
    contract: Contract


class TransferState(Record, frozen=True, kw_only=True):
    """A capture or an upload, as far as it has come.

    Attributes:
        id: Its id.
        files: Bytes of every file that is there, by name; of a complete one, they may be gone.
        is_complete: Whether the client has said that these are all.
        scene: The scene that it goes to; "" before it is complete.
        recording: The recording that it becomes; "" before, or if the importer chooses.
        job: Id of the job that makes the recording; "" before.
    """

    id: str
    files: dict[str, int]
    is_complete: bool = False
    scene: str = ""
    recording: str = ""
    job: str = ""


class CaptureCompletion(Record, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A client's word that a capture is whole.

    Attributes:
        files: SHA-256 of every file, by name.
        scene: Id of the scene that it goes to.
        split: Of the recording.
        recording: Id that the recording gets.
        anonymize: Whether faces are blurred; the pictures that were sent are then removed.
    """

    files: dict[str, Sha256]
    scene: IdText
    split: SplitName = "train"
    recording: IdText
    anonymize: bool = False


class ImportRequest(Record, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An upload that is whole, and is to be imported.

    Attributes:
        upload: Its id.
        files: SHA-256 of every file, by name.
        format: The app or data set, as `vioapr import` names it; `auto` looks at the files.
        split: Of the recordings; None leaves it to the importer.
        recording: Id that the recording gets; None leaves it to the importer.
        anonymize: Whether faces are blurred.
    """

    upload: IdText
    files: dict[str, Sha256]
    format: Annotated[str, msgspec.Meta(pattern="^[a-z0-9][a-z0-9-]{0,31}$")] = "auto"
    split: SplitName | None = None
    recording: IdText | None = None
    anonymize: bool = False


class BuildRequest(Record, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A localizer that is to be built of a scene.

    Attributes:
        refine: Whether to make another one (points, where their weights are installed), while the
            first can be used, and keep the better.
    """

    refine: bool = False


class TransferDocument(Document, frozen=True, kw_only=True):
    """What the server notes of a transfer that is complete.

    Attributes:
        files: SHA-256 of every file, by name.
        scene: Id of the scene that it goes to.
        recording: Id that the recording gets; "" if the importer chooses.
        job: Id of the job that makes the recording.
        kind: The job's kind.
        arguments: The job's arguments.
    """

    FORMAT: ClassVar[str] = "vioapr transfer"
    VERSION: ClassVar[int] = 1

    files: dict[str, Sha256]
    scene: str
    recording: str
    job: str
    kind: str
    arguments: tuple[str, ...]


class JobAnswer(Record, frozen=True, kw_only=True):
    """A job, and how far it has come.

    Attributes:
        job: The job.
        progress: None before the first word, and after the end.
        log_bytes: Length of its log.
    """

    job: JobDocument
    progress: ProgressDocument | None = None
    log_bytes: int = 0
