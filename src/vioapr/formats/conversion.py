"""From one trajectory file to another of any format."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from vioapr.errors import (
    AlreadyExistsError,
    FormatError,
    ParameterError,
    SuspectTrackError,
    UnreadableError,
)
from vioapr.files.outputs import check_outputs, is_same_file
from vioapr.files.paths import AnyPath
from vioapr.formats.anomalies import check_track
from vioapr.formats.base import ReadOptions
from vioapr.formats.corrections import Corrections
from vioapr.formats.notes import ReadingNote
from vioapr.formats.registry import (
    FORMATS,
    format_of_name,
    get_format,
    read_with_notes,
    require_writer,
)
from vioapr.formats.track_warnings import TrackWarning
from vioapr.work.results import ResultFolder, replacing_output


@dataclass(frozen=True)
class Conversion:
    """A conversion that was done.

    Attributes:
        source_format: Name of the format read.
        target_format: Name of the format written.
        poses: Number of poses.
        lost: What the target format cannot hold, in words.
        notes: What the reader said of the source.
        warnings: What looks wrong with the poses as written.
        kept: Files in the target's folder that vioapr did not write; they were left as they were.
    """

    source_format: str
    target_format: str
    poses: int
    lost: tuple[str, ...]
    notes: tuple[ReadingNote, ...] = ()
    warnings: tuple[TrackWarning, ...] = ()
    kept: tuple[Path, ...] = ()


def convert_file(
    source: AnyPath,
    target: AnyPath,
    source_format: str | None = None,
    target_format: str | None = None,
    options: ReadOptions | None = None,
    *,
    corrections: Corrections | None = None,
    overwrite: bool = False,
) -> Conversion:
    """Read a file and write it in another format.

    A folder that is overwritten holds the new poses alone, and the files that vioapr did not write.

    Args:
        source: The file or folder to read.
        target: The one to write; never the source.
        source_format: Name of the source's format; by default the likeliest.
        target_format: Name of the target's format; by default the one its name means.
        options: Rate, sequence, unit and strictness.
        corrections: What to change of the poses: another convention, scale or clock.
        overwrite: Write over an existing file or folder.

    Raises:
        FileMissingError: The source is missing.
        UnreadableError: The source cannot be read.
        FormatError: The source is malformed.
        AlreadyExistsError: The target exists; or it is a folder with poses that vioapr did not
            write, and that would be read with the new ones.
        LockedError: Another process writes into the target's folder.
        UnwritableError: The target cannot be written.
        ParameterError: No such format, none that the target's name means, one that is only read,
            the target is the source, or its format needs what the trajectory does not have.
        SuspectTrackError: The poses look wrong, and the options are strict.
    """
    source, target = Path(source), Path(target)
    by_name = "target_format"  # the parameter to mention where the name means no format
    writer = get_format(target_format) if target_format else format_of_name(target, by_name)
    write = require_writer(writer, by_name)
    check_target(source, target, overwrite=overwrite)
    reading = read_with_notes(source, source_format, options, parameter="source_format")
    if reading.warnings and options is not None and options.strict:
        raise FormatError(source, reading.warnings[0])
    trajectory = (corrections or Corrections()).apply(reading.trajectory)
    warnings = tuple(check_track(trajectory))
    if warnings and options is not None and options.strict:
        raise SuspectTrackError(f"{source}: {warnings[0]}")
    # A folder of poses of two formats would be read as one of them.
    parts = {pattern for format_ in FORMATS.values() for pattern in format_.parts}
    with replacing_output(target, overwrite=overwrite, patterns=parts) as partial:
        write(partial, trajectory)
    kept = []
    if target.is_dir():
        kept = ResultFolder(Path(os.path.realpath(target)), is_noted_beside=True).find_others()
    lost: list[str] = []
    if trajectory.is_timed and not writer.has_times:
        lost.append("timestamps")
    if trajectory.names is not None and not writer.keeps_names(trajectory.names):
        lost.append("image names")
    return Conversion(
        reading.format.name,
        writer.name,
        len(trajectory),
        tuple(lost),
        reading.notes,
        warnings,
        tuple(kept),
    )


def check_target(source: Path, target: Path, *, overwrite: bool) -> None:
    """See that a file or folder may be written; one that exists with nothing in it may be.

    Raises:
        ParameterError: It is the source, or a part of it, or the source is a part of it.
        AlreadyExistsError: It exists, and is not to be overwritten.
        UnreadableError: It cannot be looked at.
        UnwritableError: Its folder is a file.
    """
    try:
        if not target.is_dir():
            check_outputs([target], [source], overwrite=overwrite)
        elif is_same_file(source, target):
            raise ParameterError(f"{target} is the input: write to another folder")
        elif any(target.iterdir()) and not overwrite:
            raise AlreadyExistsError(target, "exists: choose another name, or give `overwrite`")
    except OSError as error:
        raise UnreadableError(target, f"cannot be looked at: {error.strerror}") from None
    # A reader takes the whole folder, and a writer may write anywhere in it.
    one, other = Path(os.path.realpath(source)), Path(os.path.realpath(target))
    if (one in other.parents and target.exists()) or (other in one.parents and target.is_dir()):
        raise ParameterError(f"{target} and the input {source} are in each other: write elsewhere")
