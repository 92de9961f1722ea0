"""Notes of who wrote what: beside results, and beside ground truth."""

from __future__ import annotations

from typing import ClassVar, Literal

import msgspec

from vioapr.schemas.base import Document, Record

Writer = Literal["mapping", "simulator", "importer"]


class WrittenFile(Record, frozen=True):
    """A result that vioapr wrote.

    Attributes:
        sha256: Of its contents, the newest last; two while one replaces the other.
        made_from: Fingerprint of what it was made from; "" where that does not matter.
    """

    sha256: tuple[str, ...]
    made_from: str = ""


class WrittenFiles(Document, frozen=True, kw_only=True):
    """What vioapr wrote into a folder that is the user's; other files in it are not replaced.

    Attributes:
        files: By their paths in the folder, with "/".
    """

    FORMAT: ClassVar[str] = "vioapr written files"

    files: dict[str, WrittenFile] = msgspec.field(default_factory=dict)


class ImportedFrom(Document, frozen=True, kw_only=True):
    """Which import a recording is of, so that the same import, run again, passes over it.

    Attributes:
        importer: Its name.
        made_from: Fingerprint of the source's path and of all options.
        content: Digest of what the source held; "" where an earlier version did not note it.
    """

    FORMAT: ClassVar[str] = "vioapr import"

    importer: str
    made_from: str
    content: str = ""


class GroundTruthOrigin(Document, frozen=True, kw_only=True):
    """Where a recording's ground truth comes from; without this note, from the user.

    Attributes:
        writer: The part of vioapr that wrote it.
        source: What it was made from, e.g. the importer's name; "" where the writer says it all.
        vioapr: The version that wrote it.
        sha256: Of the file that was written, the newest last; two while one replaces the other. A
            file that was changed since is the user's.
    """

    FORMAT: ClassVar[str] = "vioapr ground truth origin"

    writer: Writer
    source: str = ""
    vioapr: str = ""
    sha256: tuple[str, ...] = ()
