"""The type of a trajectory format, and of the options of reading one."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from vioapr.errors import ParameterError
from vioapr.formats.notes import LeftOutRow, ReadingNote, ReadingNotes
from vioapr.trajectory import Trajectory

TimeUnit = Literal["s", "ms", "us", "ns"]
"""Units of a file's times."""

_LOGGER = logging.getLogger("vioapr.formats")

HEAD_BYTES = 65536
"""How much of a file is read to recognize its format."""


@dataclass(frozen=True)
class ReadOptions:
    """Facts that a file does not say of itself.

    Attributes:
        rate_hz: Frames per second of image names' frame numbers (or of rows, for formats
            without names), for formats without timestamps. None leaves them untimed.
        sequence: For files that hold several sequences, the name of the one to read: the
            folder part of its image names, e.g. "seq-03"; or a device of kapture's, a chunk of
            Metashape's, a track of Spectacular AI's.
        time_unit: Unit of the file's times, where the format does not fix it; found from the
            values by default.
        strict: Raise an error at the first row that gives no pose, rather than leave it out.
        notes: Where to collect what the reader says of the file. By default its warnings go to
            the log "vioapr.formats".
    """

    rate_hz: float | None = None
    sequence: str | None = None
    time_unit: TimeUnit | None = None
    strict: bool = False
    notes: ReadingNotes | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ParameterError(f"`rate_hz`: expected a rate above 0 Hz, got {self.rate_hz}")
        units = get_args(TimeUnit)
        if self.time_unit is not None and self.time_unit not in units:
            raise ParameterError(
                f"time_unit: expected one of {', '.join(units)}, got {self.time_unit!r}"
            )

    def note(self, path: Path, text: str, *, is_warning: bool, lines: Sequence[int] = ()) -> None:
        """Say something of a file: to the collector, or else to the log."""
        if self.notes is not None:
            self.notes.notes.append(ReadingNote(text, is_warning, tuple(lines)))
        else:
            level = logging.WARNING if is_warning else logging.INFO
            _LOGGER.log(level, "%s: %s", path, text)

    def leave_out(self, rows: Sequence[LeftOutRow]) -> None:
        """Add rows that gave no pose to the collector, if there is one."""
        if self.notes is not None:
            self.notes.left_out.extend(rows)


@dataclass(frozen=True)
class Format:
    """A foreign file format.

    Attributes:
        name: Short name for the command line, e.g. "tum".
        title: For people, e.g. "TUM RGB-D trajectory".
        convention: Columns, directions, axes and quaternion order, in one line.
        extensions: File name endings it is usually written with, without ".gz".
        sniff: From a path and the first bytes (decompressed; b"" for a directory), how sure
            one can be that it is this format: 0 (it is not) to 1.
        read: Reads a file into our conventions; raises a FileError.
        write: Writes a trajectory in the format's conventions; None for a format that is only
            read, as recordings of an app are.
        has_times: Whether a file says when each pose was.
        has_names: Whether a file says of which image each pose is.
        name_pattern: Pattern of the image names that a written file holds; others are lost.
            By default it holds any.
        up: The axis of the world that is up by definition, however the camera was held.
        default_for: File names and endings, without ".gz", that mean this format.
        parts: Patterns of the files in a folder that are its poses, for formats that write one.
    """

    name: str
    title: str
    convention: str
    extensions: tuple[str, ...]
    sniff: Callable[[Path, bytes], float]
    read: Callable[[Path, ReadOptions], Trajectory]
    write: Callable[[Path, Trajectory], None] | None = None
    has_times: bool = False
    has_names: bool = False
    name_pattern: str = ""
    default_for: tuple[str, ...] = ()
    up: Literal["+y", "+z"] | None = None
    parts: tuple[str, ...] = ()

    def keeps_names(self, names: Iterable[str]) -> bool:
        """Whether a written file holds these image names."""
        fits = re.compile(self.name_pattern).fullmatch if self.name_pattern else bool
        return self.has_names and all(fits(name) for name in names)
