"""All formats, and reading a file of any of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from vioapr.errors import FileError, FormatError, ParameterError
from vioapr.files.paths import AnyPath
from vioapr.files.text import has_suffix, is_folder, looks_utf16, plain_name, read_head
from vioapr.formats import (
    ace,
    advio,
    aria,
    arkitscenes,
    bundler,
    cambridge,
    colmap,
    colmap_binary,
    data_loggers,
    euroc,
    gaussian_splatting,
    hloc,
    hrapr,
    ios_logger,
    kapture,
    kitti,
    marvin,
    meshroom,
    metashape,
    mstransformer,
    nerfstudio,
    open3d_log,
    opensfm,
    polycam,
    realitycapture,
    record3d,
    scancapture,
    scannerapp,
    scannet,
    scannetpp,
    sevenscenes,
    spectacular,
    stray,
    table,
    tum,
)
from vioapr.formats.base import HEAD_BYTES, Format, ReadOptions
from vioapr.formats.notes import LeftOutRow, ReadingNote, ReadingNotes
from vioapr.formats.table_guess import (
    NEEDED_COLUMNS,
    explain_table,
    is_in_degrees,
    unknown_header,
)
from vioapr.trajectory import Trajectory

_ALL = (
    tum.FORMAT,
    table.FORMAT,
    euroc.FORMAT,
    kitti.FORMAT,
    colmap.FORMAT,
    colmap_binary.FORMAT,
    hloc.FORMAT,
    ace.FORMAT,
    marvin.FORMAT,
    marvin.VIO_FORMAT,
    hrapr.FORMAT,
    mstransformer.FORMAT,
    cambridge.FORMAT,
    sevenscenes.FORMAT,
    nerfstudio.FORMAT,
    advio.FORMAT,
    advio.VIO_FORMAT,
    stray.FORMAT,
    record3d.FORMAT,
    scancapture.FORMAT,
    aria.FORMAT,
    data_loggers.ARKIT_FORMAT,
    data_loggers.ARCORE_FORMAT,
    polycam.FORMAT,
    scannerapp.FORMAT,
    ios_logger.FORMAT,
    spectacular.FORMAT,
    arkitscenes.FORMAT,
    scannet.FORMAT,
    scannetpp.FORMAT,
    kapture.FORMAT,
    kapture.LAMAR_FORMAT,
    gaussian_splatting.FORMAT,
    open3d_log.FORMAT,
    metashape.FORMAT,
    realitycapture.FORMAT,
    meshroom.FORMAT,
    opensfm.FORMAT,
    bundler.FORMAT,
    bundler.NVM_FORMAT,
)

_MOST_LOOKED_AT = 50

LEAST_CONFIDENCE = 0.6
"""A format that is less sure is not read without being asked for."""

FORMATS: dict[str, Format] = {format_.name: format_ for format_ in _ALL}


def get_format(name: str) -> Format:
    """Find the format of a name.

    Raises:
        ParameterError: There is none; the message lists them.
    """
    if name not in FORMATS:
        raise ParameterError(f"unknown format {name!r}: expected one of {', '.join(FORMATS)}")
    return FORMATS[name]


def rank_formats(path: Path) -> list[tuple[Format, float]]:
    """Rank the formats that a file may be, likeliest first, each with a confidence of 0 to 1.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is empty.
    """
    head = b"" if is_folder(path) else _read_head(path)
    if ranked := _rank_whole(path, head) or _vote_by_rows(path, head):
        return ranked
    return [] if b"\0" in head else _rank_by_name(path, head)


def _read_head(path: Path) -> bytes:
    head = read_head(path, HEAD_BYTES)
    if not head.strip():
        raise FormatError(path, "expected a trajectory, got an empty file")
    return head


def _rank_whole(path: Path, head: bytes) -> list[tuple[Format, float]]:
    """Rank by all that was read; a last line that was cut off in writing does not count."""
    ranked = _rank(path, head)
    if ranked or len(head) >= HEAD_BYTES or head[-1:] in (b"", b"\n", b"\r"):
        return ranked
    return _rank(path, head[: head.rfind(b"\n") + 1])


def _vote_by_rows(path: Path, head: bytes) -> list[tuple[Format, float]]:
    """Formats that some of the first rows fit, at most 50 % sure.

    Their readers can then say which row is wrong.
    """
    if is_in_degrees(head):
        return []
    rows = [row for row in head.splitlines() if row.strip() and not row.startswith(b"#")][:20]
    votes: dict[str, float] = {}
    for row in rows:
        for format_, confidence in _rank(path, row + b"\n"):
            votes[format_.name] = votes.get(format_.name, 0.0) + confidence / len(rows)
    ranked = [(FORMATS[name], share / 2) for name, share in votes.items() if share > 0.3]
    return sorted(ranked, key=lambda r: -r[1])


def _rank_by_name(path: Path, head: bytes) -> list[tuple[Format, float]]:
    """Formats that a file's name promises, whatever its content.

    Names of fields make a reader of JSON or XML sure, also of fields that come late in a file.
    """
    promised = [
        format_
        for format_ in FORMATS.values()
        if any(has_suffix(path, suffix) for suffix in format_.default_for)
    ]
    # A whole name, as cameras.json, promises more than an ending, as .json.
    promised.sort(key=lambda format_: plain_name(path) not in format_.default_for)
    ranked = [(format_, 0.1) for format_ in promised]
    if promised and head.lstrip()[:1] in (b"{", b"[", b"<"):
        try:
            promised[0].read(path, ReadOptions(notes=ReadingNotes()))
        except (FormatError, ParameterError):
            return ranked
        ranked[0] = (promised[0], LEAST_CONFIDENCE)
    return ranked


def _rank(path: Path, head: bytes) -> list[tuple[Format, float]]:
    ranked = [(format_, format_.sniff(path, head)) for format_ in FORMATS.values()]
    return sorted((r for r in ranked if r[1] > 0), key=lambda r: -r[1])


@dataclass(frozen=True)
class FileReading:
    """A trajectory and what its reader said of the file.

    Attributes:
        trajectory: The poses.
        format: The format that it was read as.
        confidence: How sure its recognition was, 0 to 1; 1 for a format that was given.
        notes: Sentences about the file, in order.
        left_out: Rows that gave no pose.
    """

    trajectory: Trajectory
    format: Format
    confidence: float
    notes: tuple[ReadingNote, ...]
    left_out: tuple[LeftOutRow, ...]

    @property
    def warnings(self) -> list[str]:
        """The sentences of the notes that are warnings."""
        return [note.text for note in self.notes if note.is_warning]


def read_trajectory(
    path: AnyPath, format_name: str | None = None, options: ReadOptions | None = None
) -> Trajectory:
    """Read a trajectory of a given format, or of the likeliest one.

    Warnings, as of rows without a pose, go to the log "vioapr.formats".

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is malformed, or its format is not recognized or uncertain.
        ParameterError: There is no format of that name.
    """
    path = Path(path)
    format_ = recognize(path) if format_name is None else get_format(format_name)
    return format_.read(path, options or ReadOptions())


def read_with_notes(
    path: AnyPath,
    format_name: str | None = None,
    options: ReadOptions | None = None,
    *,
    parameter: str = "format_name",
) -> FileReading:
    """Read a trajectory, and keep what its reader says of the file.

    Args:
        path: A trajectory file, or a folder of a format that is one.
        format_name: Its format, if known.
        options: Rate, sequence, unit and strictness; its `notes` are not used.
        parameter: The caller's, with which a user can choose the format.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is malformed, or its format is not recognized or uncertain.
        ParameterError: There is no format of that name.
    """
    path = Path(path)
    if format_name is None:
        format_, confidence = recognize_surely(path, parameter)
    else:
        format_, confidence = get_format(format_name), 1.0
    notes = ReadingNotes()
    trajectory = format_.read(path, replace(options or ReadOptions(), notes=notes))
    return FileReading(trajectory, format_, confidence, tuple(notes.notes), tuple(notes.left_out))


def write_trajectory(path: AnyPath, trajectory: Trajectory, format_name: str | None = None) -> None:
    """Write a trajectory in a given format, or in the one that the file's name means.

    Raises:
        ParameterError: There is no such format, the name means none, the format is only read, or
            it needs what the trajectory does not have.
        UnwritableError: The file cannot be written.
    """
    path = Path(path)
    format_ = format_of_name(path) if format_name is None else get_format(format_name)
    require_writer(format_)(path, trajectory)


def require_writer(
    format_: Format, parameter: str = "format_name"
) -> Callable[[Path, Trajectory], None]:
    """The writer of a format.

    Args:
        format_: The format to write.
        parameter: The caller's, with which a user can choose a format.

    Raises:
        ParameterError: The format is only read; the message lists those that are written.
    """
    if format_.write is None:
        written = ", ".join(f.name for f in FORMATS.values() if f.write is not None)
        raise ParameterError(
            f"{format_.name} files are only read: choose another format with `{parameter}`: "
            f"{written}"
        )
    return format_.write


def format_of_name(path: Path, parameter: str = "format_name") -> Format:
    """Find the format that a file's name means: a whole name before an ending.

    Args:
        path: The file or folder to write.
        parameter: The caller's, with which a user can choose a format.

    Raises:
        ParameterError: It means none; the message lists those that fit.
    """
    name = plain_name(path)
    for matches in (name.__eq__, name.endswith):
        for format_ in FORMATS.values():
            if any(matches(known) for known in format_.default_for):
                return format_
    ending = Path(name).suffix  # without one, it may be a file or a folder
    written = [format_ for format_ in FORMATS.values() if format_.write is not None]
    fitting = [format_ for format_ in written if ending and ending in format_.extensions]
    raise ParameterError(
        f"{path}: the name does not tell which format to write: choose one with `{parameter}`: "
        + ", ".join(format_.name for format_ in fitting or written)
    )


def recognize(path: Path, parameter: str = "format_name") -> Format:
    """Find the format that a file most likely has; see `recognize_surely`."""
    return recognize_surely(path, parameter)[0]


def recognize_surely(path: Path, parameter: str = "format_name") -> tuple[Format, float]:
    """Find the format that a file has, and how sure that is.

    Args:
        path: A trajectory file, or a folder of a format that is one.
        parameter: The caller's, with which a user can choose the format.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It looks like none, or like several: the message lists them.
    """
    head = b"" if is_folder(path) else _read_head(path)
    ranked = _rank_whole(path, head)
    if ranked and ranked[0][1] >= LEAST_CONFIDENCE:
        return ranked[0]
    if ranked:
        raise _uncertain(path, head, ranked, parameter)
    if is_in_degrees(head):
        raise FormatError(
            path,
            f"expected positions in metres, but its header names degrees on the globe "
            f"({unknown_header(head)}): convert them to metres first",
        )
    if head and (voted := _vote_by_rows(path, head)):
        raise _why_not(path, head, voted, parameter)
    promised = _rank_by_name(path, head) if head and b"\0" not in head else []
    if promised and promised[0][1] >= LEAST_CONFIDENCE:
        return promised[0]
    table = explain_table(head)
    if table is not None and table[0] not in (format_.name for format_, _ in promised):
        raise FormatError(
            path,
            f"not recognized: the nearest format is {table[0]}, but {table[1]}; see "
            f"docs/guide/formats.md, or choose with `{parameter}`",
        )
    if promised:
        raise _why_not(path, head, promised, parameter)
    raise FormatError(path, f"expected a trajectory, got {_what_instead(path, head)}")


def _what_instead(path: Path, head: bytes) -> str:
    """What a file or folder is that is of no format, and what to do."""
    if not head:
        held = _trajectories_in(path)
        return f"a folder that is of no format; {held}see docs/guide/formats.md"
    if looks_utf16(head):
        return "text in UTF-16 without a mark: save it as UTF-8"
    what = "binary content" if b"\0" in head else "text of no known format"
    return f"{what}; see docs/guide/formats.md for those that are read"


def _trajectories_in(folder: Path) -> str:
    """The files of a folder that are surely trajectories, for people."""
    found: list[str] = []
    for path in sorted(folder.iterdir())[:_MOST_LOOKED_AT]:
        try:
            ranked = [] if path.is_dir() else _rank(path, _read_head(path))
        except FileError:
            continue
        if ranked and ranked[0][1] >= LEAST_CONFIDENCE:
            found.append(f"{path.name} ({ranked[0][0].name})")
    return f"it holds {', '.join(found[:3])}: give that file; " if found else ""


def _uncertain(
    path: Path, head: bytes, ranked: list[tuple[Format, float]], parameter: str
) -> FormatError:
    """The refusal of a guess: which formats it may be, and how to choose."""
    names = ", ".join(f"{format_.name} ({share:.0%})" for format_, share in ranked)
    what, remedy = "", ""
    if header := unknown_header(head):
        what = f"its header does not name {NEEDED_COLUMNS}, but {header}, and "
        remedy = "rename its columns, or "
    return FormatError(
        path,
        f"{what}its format is uncertain: it may be {names}: {remedy}choose with `{parameter}`",
    )


def _why_not(
    path: Path, head: bytes, ranked: list[tuple[Format, float]], parameter: str
) -> FormatError:
    """Why a file is not of the nearest format; a reader that takes it does not make it sure."""
    nearest = ranked[0][0]
    try:
        nearest.read(path, ReadOptions(notes=ReadingNotes()))
    except FormatError as error:
        return FormatError(
            error.path,
            f"{error.problem} (not recognized: the nearest format is {nearest.name}; see "
            f"docs/guide/formats.md, or choose with `{parameter}`)",
            error.line,
        )
    return _uncertain(path, head, ranked, parameter)
