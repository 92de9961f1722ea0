"""What a reader says of a file beside its poses: rows left out, units and columns found."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class ReadingNote:
    """One sentence about how a file was read.

    Attributes:
        text: The sentence, as a user shall read it; it names lines where there are any.
        is_warning: Whether something may be wrong, rather than only worth knowing.
        lines: The 1-based lines (entries, for files that are no text) that it is about.
    """

    text: str
    is_warning: bool = False
    lines: tuple[int, ...] = ()


@dataclass(frozen=True)
class LeftOutRow:
    """A row of a file that gave no pose.

    Attributes:
        path: The file.
        line: Its 1-based line (entry, for files that are no text).
        problem: What is wrong with it: expected and got.
        name: Its image, where the format has names.
        timestamp_s: Its time, where the format has times and the row's is a number.
    """

    path: Path
    line: int
    problem: str
    name: str | None = None
    timestamp_s: float | None = None


@dataclass
class ReadingNotes:
    """Collects what readers say; give one with `ReadOptions` to have it.

    Attributes:
        notes: In the order in which they came up.
        left_out: Rows that gave no pose, so that an importer can mark their frames lost.
    """

    notes: list[ReadingNote] = field(default_factory=list["ReadingNote"])
    left_out: list[LeftOutRow] = field(default_factory=list["LeftOutRow"])

    @property
    def warnings(self) -> list[str]:
        """The sentences of the notes that are warnings."""
        return [note.text for note in self.notes if note.is_warning]

    @property
    def remarks(self) -> list[str]:
        """The sentences of the other notes."""
        return [note.text for note in self.notes if not note.is_warning]
